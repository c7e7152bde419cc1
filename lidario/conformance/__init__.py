"""Rules that a lidar must keep, and what tries them on one: `lidario report` and the pytest suite use the same.

::

    async with await open_bench("/dev/ttyUSB0") as bench:
        for verdict in await bench.judge(RULES, on_verdict=print):
            ...

A `Rule` is one plain sentence, where it is known from, what a device needs for it, and a check. A `Verdict` says
whether it held, by how much it did not, or why it was not tried. Which rules apply is told by what the device can
do, and never by its name. `docs/testing.md` tells how to run them.
"""

from __future__ import annotations

from lidario.conformance.bench import Bench, open_bench
from lidario.conformance.rule import Need, Origin, Outcome, Rule, Verdict
from lidario.conformance.rules import RULES, rule_named

__all__ = ["RULES", "Bench", "Need", "Origin", "Outcome", "Rule", "Verdict", "open_bench", "rule_named"]
