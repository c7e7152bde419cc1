"""A program that records is killed; the file is readable up to its last second."""

import time
from pathlib import Path

import pytest

from lidario.recording.files import open_stored
from tests.support.children import BOUND, child, line_of
from tests.support.whole import assert_export_makes_it_whole

PROGRAM = """
import asyncio, sys, time
import lidario

async def main():
    async with lidario.open_lidar("sim://rplidar-s2") as lidar:
        async with lidar.record(sys.argv[1]), lidar.scans() as stream:
            async for scan in stream:
                print(time.monotonic_ns(), flush=True)

asyncio.run(main())
"""


@pytest.mark.long
def test_kill_9_costs_the_last_second(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    with child(PROGRAM, str(path)) as process:
        lines = [int(line_of(process.stdout))]
        while lines[-1] - lines[0] < 1.6e9:
            lines.append(int(line_of(process.stdout)))
        process.kill()
        process.wait(BOUND)
        killed_ns = time.monotonic_ns()
    recording = open_stored(path)
    assert recording.damage == "the file was cut"
    last_ns = max(piece.at_ns for piece in recording.pieces())
    # A second in the chunk, the quarter of one until the thread looks, and what a busy machine adds.
    assert killed_ns - last_ns < 2e9
    assert last_ns > lines[0]
    assert_export_makes_it_whole(path, tmp_path / "whole.mcap")
