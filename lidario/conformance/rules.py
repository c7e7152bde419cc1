"""All rules, in the order in which they are tried: first what a device at rest says, at last how it is left."""

from __future__ import annotations

from lidario.arguments import shown
from lidario.conformance.asking import ASKING
from lidario.conformance.rule import Rule
from lidario.conformance.settings import SETTINGS
from lidario.conformance.stopping import STOPPING
from lidario.conformance.streaming import STREAMING
from lidario.errors import InvalidValue

__all__ = ["RULES", "rule_named"]

RULES: tuple[Rule, ...] = (*ASKING, *STREAMING, *SETTINGS, *STOPPING)
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
