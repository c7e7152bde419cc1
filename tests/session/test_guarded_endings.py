"""Programs with `guard=True` that end by themselves, in order or not: no guard is left, and the device is still."""

from __future__ import annotations

import pytest

from tests.cli.processes import served
from tests.support.children import UNDISTURBED, child, is_still, until
from tests.support.guards import guards_of

pytestmark = pytest.mark.discards("a guard cannot know what the program has just written, so it writes again")

OPENS = """
import asyncio, gc, os, sys, warnings
import lidario
def open_it():
    return lidario.open_lidar(sys.argv[1], guard=True)
"""
ENDINGS = {
    "garbage": """
loop = asyncio.new_event_loop()
lidar = loop.run_until_complete(open_it())
scans = lidar.scans()
loop.run_until_complete(anext(scans))
loop.run_until_complete(scans.aclose())
del lidar, scans
for _ in range(3):
    gc.collect()
    loop.run_until_complete(asyncio.sleep(0.2))
loop.close()
""",
    "the loop was closed": """
loop = asyncio.new_event_loop()
lidar = loop.run_until_complete(open_it())
loop.run_until_complete(lidar.scan())
loop.close()
del lidar
gc.collect()
""",
    "never closed": """
warnings.simplefilter("ignore")  # of the loop
loop = asyncio.new_event_loop()
lidar = loop.run_until_complete(open_it())
loop.run_until_complete(lidar.scan())
""",
    "never closed without await": """
lidar = lidario.open_sync(sys.argv[1], guard=True)
lidar.scan()
""",
    "an exception": """
async def main():
    async with open_it() as lidar:
        await lidar.scan()
        raise SystemExit(0)
asyncio.run(main())
""",
}


@pytest.mark.long
@pytest.mark.exhaustive("ending", sample=["garbage", "never closed"], full=ENDINGS)
def test_a_program_that_ends_by_itself_leaves_none(ending: str) -> None:
    with served("rplidar-s2") as server:
        with child(UNDISTURBED + OPENS + ENDINGS[ending], server.path) as process:
            _, said = process.communicate()
            assert (process.returncode, said) == (0, "")
            until(lambda: not guards_of(process.pid))
        until(lambda: is_still(server))
