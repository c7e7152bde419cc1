"""Rules that a lidar must keep, and what tries them on one: `lidario report` and the pytest suite use the same.

::

    async with await open_bench("/dev/ttyUSB0") as bench:
        for verdict in await bench.judge(RULES, on_verdict=print):
            ...

Which rules apply is told by what the device can do, and never by its name. `docs/testing.md` tells how to run them.
"""

from __future__ import annotations

from lidario.conformance.bench import Bench, open_bench
from lidario.conformance.news import Seen, news_of, seen_reports
from lidario.conformance.report import Report, Reporter, Tried, read_report
from lidario.conformance.rule import Figure, Need, Origin, Outcome, Rule, Verdict
from lidario.conformance.rules import RULES, rule_named

__all__ = [
    "RULES",
    "Bench",
    "Figure",
    "Need",
    "Origin",
    "Outcome",
    "Report",
    "Reporter",
    "Rule",
    "Seen",
    "Tried",
    "Verdict",
    "news_of",
    "open_bench",
    "read_report",
    "rule_named",
    "seen_reports",
]
