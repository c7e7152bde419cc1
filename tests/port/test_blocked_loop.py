"""A program that blocks its event loop loses nothing: neither bytes nor revolutions, and stamps stay right."""

from __future__ import annotations

import asyncio
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from lidario.model import Stats
from lidario.scan import Scan
from lidario.session.opening import open_lidar
from tests.support.devices import FAMILIES
from tests.support.ports import PATIENCE_S

ROOT = Path(__file__).resolve().parents[2]
BLOCK_S = 0.6
"""Longer than a pseudo-terminal's 20 KiB last, at either family's rate."""
BLOCKS = 2
ATTEMPTS = 5
"""A machine with too much to do keeps this whole process waiting, and then the line loses bytes whoever reads.
Where the loop alone reads, it loses them each time."""
TURN_S = {"rplidar": 0.1, "ydlidar": 1 / 7}
DEVICE = """
import sys
from lidario.sim.serve import PtyServer
from tests.support.devices import make_rig

with PtyServer(make_rig(sys.argv[1]).device, chunk=64) as server:
    print(server.path, flush=True)
    sys.stdin.readline()
    print(server.lost, flush=True)
"""


class Device:
    """A device played by another process: what blocks this one does not block it."""

    def __init__(self, process: subprocess.Popen[str]) -> None:
        self._process = process
        self.path = self._line()

    def _line(self) -> str:
        assert self._process.stdout is not None
        return self._process.stdout.readline().strip()

    def lost(self) -> int:
        """End it, and return how many bytes the terminal could not take."""
        assert self._process.stdin is not None
        self._process.stdin.write("\n")
        self._process.stdin.flush()
        return int(self._line())


@contextmanager
def played(family: str) -> Iterator[Device]:
    with subprocess.Popen(
        [sys.executable, "-c", DEVICE, family],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
        cwd=ROOT,
        env={"PYTHONPATH": str(ROOT)},
    ) as process:
        yield Device(process)


def sleep(seconds: float) -> None:
    time.sleep(seconds)


def compute(seconds: float) -> None:
    until = time.perf_counter() + seconds
    while time.perf_counter() < until:
        sum(range(200))


WAYS = {"sleep": sleep, "compute": compute}
"""Ways to block a loop: one lets other threads run, the other makes them wait for the interpreter."""


async def read_blocked(family: str, block: Callable[[float], None]) -> tuple[list[Scan], Stats, int]:
    """All scans of a program that blocks its loop, what it was told, and the bytes that the line lost."""
    scans: list[Scan] = []
    with played(family) as device:
        async with open_lidar(device.path, family=family) as lidar:
            stream = lidar.scans(depth=100)
            while len(scans) < 3:
                scans.append(await anext(stream))
            for _ in range(BLOCKS):
                block(BLOCK_S)
                # Up to a revolution that was measured after the block.
                unblocked = time.monotonic_ns()
                async with asyncio.timeout(PATIENCE_S):
                    while scans[-1].stamp_ns < unblocked:
                        scans.append(await anext(stream))
            stats = lidar.stats
        return scans, stats, device.lost()


@pytest.mark.long
@pytest.mark.exhaustive(
    "case",
    sample=["rplidar-compute"],
    full=[f"{family}-{how}" for family in FAMILIES for how in WAYS],
)
async def test_a_blocked_loop_loses_nothing(case: str) -> None:
    family, _, how = case.partition("-")
    for _ in range(ATTEMPTS):
        scans, stats, lost = await read_blocked(family, WAYS[how])
        missing = (lost, stats.lost_packets, stats.broken_scans, stats.skipped_bytes, stats.dropped_scans)
        if not any(missing):
            break
    assert not any(missing), missing
    assert [scan.seq for scan in scans] == list(range(scans[0].seq, scans[0].seq + len(scans)))
    assert len(scans) >= BLOCKS * BLOCK_S / TURN_S[family]
    # How even their stamps are is tested on a driven clock (tests/session).
