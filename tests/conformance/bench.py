"""Rules on a simulated device, on a driven loop: a minute of the device takes a fifth of a second."""

from __future__ import annotations

import asyncio
from collections.abc import Sequence

import lidario
from lidario.conformance import RULES, Outcome, Rule, Verdict, open_bench
from tests.support.loop import DrivenLoop, run_driven

__all__ = ["broken", "judge"]


def judge(device: lidario.SimulatedDevice, rules: Sequence[Rule] = RULES) -> list[Verdict]:
    """The verdicts on a device in memory."""

    async def main() -> list[Verdict]:
        loop = asyncio.get_running_loop()
        assert isinstance(loop, DrivenLoop)
        async with await open_bench(device) as bench:
            bench.pause = loop.block
            return await bench.judge(rules)

    return run_driven(main)


def broken(verdicts: Sequence[Verdict]) -> dict[str, str]:
    """The rules that were not held, and what was measured."""
    return {each.rule.name: each.text for each in verdicts if each.outcome is Outcome.BROKEN}
