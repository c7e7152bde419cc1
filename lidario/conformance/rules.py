"""All rules, in the order in which they are tried: first what a device at rest says, at last how it is left."""

from __future__ import annotations

from dataclasses import replace

from lidario.arguments import shown
from lidario.conformance.asking import ASKING
from lidario.conformance.rule import Need, Rule
from lidario.conformance.settings import SETTINGS
from lidario.conformance.stopping import STOPPING
from lidario.conformance.streaming import STREAMING
from lidario.errors import InvalidValue

__all__ = ["RULES", "rule_named"]

_MOVING = tuple(replace(rule, needs=(Need.HEALTH, *rule.needs)) for rule in (*STREAMING, *SETTINGS, *STOPPING))
"""They start the motor, or restart the device; repeated Protection Stops may damage it."""
RULES: tuple[Rule, ...] = (*ASKING, *_MOVING)
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
