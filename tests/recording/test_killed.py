"""A program that records is killed; the file is readable up to its last second.

How long that is: `tests/recording/test_power_cut.py`.
"""

from contextlib import suppress
from pathlib import Path

import pytest

import lidario
from lidario.recording.files import open_stored
from tests.support.children import BOUND, child, line_of, until
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


def last_ns(path: Path) -> int:
    """When the last byte came that can be read in the file; 0 where there is none yet."""
    with suppress(lidario.RecordingError):
        return max((piece.at_ns for piece in open_stored(path).pieces()), default=0)
    return 0


@pytest.mark.long
def test_kill_9_costs_the_last_second(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    with child(PROGRAM, str(path)) as process:
        first_ns = int(line_of(process.stdout))
        until(lambda: last_ns(path) > first_ns + 500_000_000)
        process.kill()
        process.wait(BOUND)
    assert open_stored(path).damage == "the file was cut"
    assert last_ns(path) > first_ns + 500_000_000
    assert_export_makes_it_whole(path, tmp_path / "whole.mcap")
