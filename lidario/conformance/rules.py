"""All rules, in the order in which they are tried: first what a device at rest says, at last how it is left."""

from __future__ import annotations

from dataclasses import replace
from types import ModuleType

from lidario.arguments import shown
from lidario.conformance import asking, settings, stopping, streaming
from lidario.conformance.rule import Need, Rule
from lidario.errors import InvalidValue


def rules_in(module: ModuleType) -> tuple[Rule, ...]:
    """The rules of a module, in the order in which they stand there."""
    return tuple(each for each in vars(module).values() if isinstance(each, Rule))


_MOVING = (
    replace(rule, needs=(Need.HEALTH, *rule.needs))
    for module in (streaming, settings, stopping)
    for rule in rules_in(module)
)
"""They start the motor, or restart the device; repeated Protection Stops may damage it."""
RULES: tuple[Rule, ...] = (*rules_in(asking), *_MOVING)
"""Every rule."""


def rule_named(name: str) -> Rule:
    """The rule of that name.

    Raises:
        InvalidValue: There is none.
    """
    for rule in RULES:
        if rule.name == name:
            return rule
    raise InvalidValue(f"no rule is called {shown(name)}: {', '.join(rule.name for rule in RULES)}")
