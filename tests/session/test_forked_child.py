"""A child that is forked within a coroutine: the lidar is its parent's, each call says so, and leaving is harmless.

asyncio itself has no running loop there, so that what a child called failed in words that say nothing of it.
"""

import os
from collections.abc import Awaitable, Callable
from pathlib import Path

import pytest

from lidario import Lidar, LocalProtocolError, MergedStream, Mount, Recording, ScanStream, merged
from tests.support.devices import Rig

REFUSED = 7

pytestmark = pytest.mark.filterwarnings("ignore:.*use of fork:DeprecationWarning")


def exit_code_in_a_child(steps: list[Callable[[], Awaitable[object]]], *, refused: bool) -> int:
    """What a forked child ends with that does these steps: 7 where each was refused, or none, as it should be."""
    child = os.fork()
    if child:
        return os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
    code = REFUSED
    for number, step in enumerate(steps, 10):
        try:
            step().__await__().send(None)
        except LocalProtocolError as error:
            if not refused or "fork" not in str(error):
                code = number
        except StopIteration:
            if refused:
                code = number
        except BaseException:
            code = number
    os._exit(code)


async def test_it_is_refused_and_the_parent_goes_on(rig: Rig, tmp_path: Path) -> None:
    async with rig.read() as (lidar, stream):
        changes, clouds = lidar.line_changes(), merged(lidar, mounts=[Mount()])
        await anext(clouds)
        calls: list[Callable[[], Awaitable[object]]] = [
            lidar.scan, lidar.get_health, lidar.stop, lidar.reset, lidar.__aenter__, lambda: anext(stream),
            stream.__aenter__, lambda: anext(changes), lambda: anext(clouds),
            lambda: lidar.record(tmp_path / "run.mcap").start(),
        ]  # fmt: skip
        assert exit_code_in_a_child(calls, refused=True) == REFUSED
        await anext(stream)
        await anext(clouds)
        assert lidar.stats.interruptions == 0
    assert not os.listdir(tmp_path)


@pytest.mark.parametrize("begun", [True, False])
async def test_leaving_is_harmless(rig: Rig, tmp_path: Path, begun: bool) -> None:
    def leave(
        lidar: Lidar, stream: ScanStream, clouds: MergedStream, recording: Recording
    ) -> list[Callable[[], Awaitable[object]]]:
        return [
            stream.aclose, lambda: stream.__aexit__(None, None, None), clouds.close,
            lambda: clouds.__aexit__(None, None, None), recording.close, lidar.close,
        ]  # fmt: skip

    async with rig.read() as (lidar, stream):
        clouds, recording = merged(lidar, mounts=[Mount()]), lidar.record(tmp_path / "run.mcap")
        if begun:
            await anext(clouds)
            await recording.start()
        steps = leave(lidar, stream if begun else lidar.scans(), clouds, recording)
        assert exit_code_in_a_child(steps, refused=False) == REFUSED
        await anext(stream)
        if begun:
            await anext(clouds)
            await recording.close()
        assert lidar.stats.interruptions == 0
