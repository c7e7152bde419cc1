"""A day of faults and users in driven time: ``python -m benchmarks.soak --seed 7 --hours 24``, or ``make soak``.

Each hour has a seed of its own, so that one hour is replayed alone: ``--family rplidar --hour 13``. All hours run
in one process: its memory is measured after each, and must be flat. Ends with 1 where an invariant did not hold;
the text names the command that replays it.
"""

from __future__ import annotations

import argparse
import asyncio
import gc
import sys
import time
import warnings
from collections import Counter
from collections.abc import Sequence

from benchmarks.soak.hour import Hour
from benchmarks.soak.life import MODELS, Life
from benchmarks.soak.watch import Broken
from benchmarks.usage import resident_mb
from tests.support.loop import endless_loop

_WARM_UP = 3  # hours in which caches fill
_MOST_GROWTH_MB = 8.0


def live(family: str, seed: int, hour: int, seconds: float = 3600.0, without: Sequence[str] = ()) -> Hour:
    """One hour of one family.

    Raises:
        Broken: An invariant does not hold.
    """
    life = Life(family, 1000 * seed + hour, seconds, without)
    with asyncio.Runner(loop_factory=endless_loop) as runner:
        return runner.run(life.run())


def main(arguments: list[str] | None = None) -> int:
    """Live the hours that were asked for."""
    options = _parser().parse_args(arguments)
    warnings.simplefilter("error")
    families = [options.family] if options.family else list(MODELS)
    hours = range(options.hours) if options.hour is None else [options.hour]
    without = options.without.split(",") if options.without else []
    whole, memory, broken = Hour(), list[float](), 0
    began = time.monotonic()
    for hour in hours:
        for family in families:
            try:
                lived = live(family, options.seed, hour, without=without)
            except Broken as error:
                broken += 1
                command = f"python -m benchmarks.soak --seed {options.seed} --family {family} --hour {hour}"
                command += f" --without '{options.without}'" if without else ""
                print(f"BROKEN: {error}\n  again: {command}", flush=True)
                continue
            _add(whole, lived)
        gc.collect()
        memory.append(resident_mb())
        print(
            f"hour {hour}: {whole.steps} steps, {whole.sessions} sessions, {whole.scans} scans, "
            f"{memory[-1]:.1f} MB, {len(gc.get_objects())} objects, {time.monotonic() - began:.0f} s",
            file=sys.stderr,
            flush=True,
        )
    print(f"seed {options.seed}, {len(hours)} h of {', '.join(families)}, in {time.monotonic() - began:.0f} s:")
    print(f"  {whole.steps} steps, {whole.sessions} sessions, {whole.scans} scans, digest {whole.digest}")
    print(f"  steps: {_told(whole.did)}")
    print(f"  errors, all to be expected: {_told(whole.errors)}")
    grown = _growth_mb(memory)
    print(f"  memory: {memory[0]:.1f} MB after the first hour, {memory[-1]:.1f} after the last")
    if grown > _MOST_GROWTH_MB:
        print(f"BROKEN: memory grew by {grown:.1f} MB")
        broken += 1
    print(f"  broken: {broken or 'nothing'}")
    return 1 if broken else 0


def _add(whole: Hour, lived: Hour) -> None:
    whole.steps += lived.steps
    whole.scans += lived.scans
    whole.sessions += lived.sessions
    whole.did += lived.did
    whole.errors += lived.errors
    whole.digest = f"{(int(whole.digest or '0', 16) * 31 + int(lived.digest, 16)) % (1 << 64):016x}"


def _told(counts: Counter[str]) -> str:
    return ", ".join(f"{name} {count}" for name, count in counts.most_common()) or "none"


def _growth_mb(memory: list[float]) -> float:
    """How much more the last quarter of the hours holds at its least than the first hours behind the warm-up."""
    if len(memory) < 2 * _WARM_UP:
        return 0.0
    return min(memory[-len(memory) // 4 :]) - max(memory[:_WARM_UP])


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.soak", description=__doc__)
    parser.add_argument("--seed", type=int, default=7, help="decides everything")
    parser.add_argument("--hours", type=int, default=24, help="of driven time, for each family")
    parser.add_argument("--hour", type=int, metavar="N", help="only this one")
    parser.add_argument("--family", choices=tuple(MODELS), help="only this one")
    parser.add_argument(
        "--without", metavar="WORDS", help="leave steps and faults out whose names contain one of these"
    )
    return parser


if __name__ == "__main__":
    sys.exit(main())
