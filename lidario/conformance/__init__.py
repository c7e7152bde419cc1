"""Rules that a lidar must keep, and what tries them on one: `lidario report` and the pytest suite use the same.

::

    async with await open_bench("/dev/ttyUSB0") as bench:
        for verdict in await bench.judge(RULES, on_verdict=print):
            ...

Which rules apply is told by what the device can do, and never by its name. `docs/testing.md` tells how to run them.
"""

from dataclasses import replace
from types import ModuleType

from lidario.basics.arguments import shown
from lidario.conformance import asking, settings, stopping, streaming
from lidario.conformance.bench import Bench, open_bench
from lidario.conformance.news import Seen, news_of, seen_reports
from lidario.conformance.report import Report, Reporter, Tried, read_report
from lidario.conformance.rule import Figure, Need, Origin, Outcome, Rule, Verdict
from lidario.errors import InvalidValue

__all__ = [
    "RULES", "Bench", "Figure", "Need", "Origin", "Outcome", "Report", "Reporter", "Rule", "Seen", "Tried",
    "Verdict", "news_of", "open_bench", "read_report", "rule_named", "seen_reports",
]  # fmt: skip


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
"""Every rule, in the order in which they are tried: first what a device at rest says, at last how it is left."""


def rule_named(name: str) -> Rule:
    """The rule of that name.

    Raises:
        InvalidValue: There is none.
    """
    for rule in RULES:
        if rule.name == name:
            return rule
    raise InvalidValue(f"no rule is called {shown(name)}: {', '.join(rule.name for rule in RULES)}")
