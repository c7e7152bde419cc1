"""A process that `multiprocessing` has started ends by `os._exit`: its lidar is still all the same."""

import pytest

from tests.cli.processes import served
from tests.support.children import UNDISTURBED, ended, is_still, requests, until, was_stopped

PROGRAM = """
import multiprocessing, sys

if __name__ == "__main__":
    arguments = sys.argv[2], {"source": sys.argv[3]}
    work = multiprocessing.get_context(sys.argv[1]).Process(target=exec, args=arguments)
    work.start()
    work.join()
    sys.exit(work.exitcode)
"""
BLOCKING = """
import lidario

lidar = lidario.open_sync(source)
scans = iter(lidar.scans())
next(scans)
raise SystemExit(5)
"""
ASYNC = """
import asyncio
import lidario

async def hold():
    global lidar, scans
    lidar = await lidario.open_lidar(source)
    scans = lidar.scans()
    await anext(scans)

asyncio.run(hold())
raise SystemExit(5)
"""
LEFT = {"blocking": BLOCKING, "async": ASYNC}


@pytest.mark.long
@pytest.mark.parametrize("method", ["fork", "forkserver", "spawn"])
@pytest.mark.parametrize("left", LEFT)
def test_it_ends_without_closing(left: str, method: str) -> None:
    with served("rplidar-s2") as server:
        process = ended(UNDISTURBED + PROGRAM, method, UNDISTURBED + LEFT[left], server.path)
        assert (process.returncode, process.stderr) == (5, "")
        until(lambda: is_still(server), lambda: requests(server)[-5:])
        assert was_stopped(server)
