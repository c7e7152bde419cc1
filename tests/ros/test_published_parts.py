"""A recording in parts is published by its pattern, as one file would be."""

import re
from pathlib import Path

import pytest

from tests.cli.processes import invoke
from tests.support.recorded import record
from tests.support.router import Router

SCANS = 30


@pytest.mark.long
def test_all_parts_are_published(tmp_path: Path, router: Router) -> None:
    made = record(tmp_path / "run.mcap", "sim://rplidar-s2", SCANS, split_s=1.0)
    assert made.files > 1
    done = invoke("publish", f"{made.source}?rate=0", "--zenoh", "parts/scan", "--router", router.address, code=0)
    told = re.search(r"^(\d+) scans published", done.stderr, re.MULTILINE)
    assert told is not None, done.stderr
    assert SCANS <= int(told[1]) <= SCANS + 1
