"""A recording in parts is published by its pattern, as one file would be."""

from __future__ import annotations

import re

import pytest

import lidario
from tests.cli.processes import invoke
from tests.support.loop import run_driven
from tests.support.router import Router

SCANS = 30


@pytest.fixture(scope="module")
def parts(tmp_path_factory: pytest.TempPathFactory) -> str:
    """The pattern of a recording in several parts, of 30 scans or one more."""
    path = tmp_path_factory.mktemp("parts") / "run.mcap"

    async def main() -> str:
        async with lidario.open_lidar("sim://rplidar-s2?via=memory") as lidar:
            async with lidar.record(path, split_s=1.0) as recording, lidar.scans(depth=64) as scans:
                for _ in range(SCANS):
                    await anext(scans)
            assert recording.files > 1
            return str(recording.source)

    return run_driven(main)


def test_all_parts_are_published(parts: str, router: Router) -> None:
    done = invoke("publish", f"{parts}?rate=0", "--zenoh", "parts/scan", "--router", router.address)
    assert done.exit_code == 0, done.stderr
    told = re.search(r"^(\d+) scans published", done.stderr, re.MULTILINE)
    assert told is not None, done.stderr
    assert SCANS <= int(told[1]) <= SCANS + 1
