"""Rules on a simulated device, on a driven loop: a minute of the device takes a fifth of a second."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable, Sequence
from pathlib import Path
from typing import TypeVar

import lidario
from lidario.conformance import RULES, Bench, Outcome, Report, Reporter, Rule, Verdict, open_bench
from tests.support.loop import DrivenLoop, run_driven

T = TypeVar("T")


def on_bench(device: lidario.SimulatedDevice, work: Callable[[Bench], Awaitable[T]]) -> T:
    """What comes of the work on a bench with that device in memory."""

    async def main() -> T:
        loop = asyncio.get_running_loop()
        assert isinstance(loop, DrivenLoop)
        async with await open_bench(device) as bench:
            bench.pause = loop.block
            return await work(bench)

    return run_driven(main)


def judge(device: lidario.SimulatedDevice, rules: Sequence[Rule] = RULES) -> list[Verdict]:
    """The verdicts on a device."""
    return on_bench(device, lambda bench: bench.judge(rules))


def make(device: lidario.SimulatedDevice, path: Path, rules: Sequence[Rule] = RULES) -> tuple[str, Report]:
    """The serial number of a device, and its report, written to `path`."""

    async def work(bench: Bench) -> tuple[str, Reporter]:
        async with Reporter(bench, path, {"adapter": "CP2102"}) as reporter:
            await reporter.run(rules)
        return bench.lidar.info.serial, reporter

    serial, reporter = on_bench(device, work)
    return serial, reporter.report()


def broken(verdicts: Sequence[Verdict]) -> dict[str, str]:
    """The rules that were not held, and what was measured."""
    return {each.rule.name: each.text for each in verdicts if each.outcome is Outcome.BROKEN}
