"""What programs had better not do: nobody waits for ever, errors say why, and the device is still afterwards."""

import asyncio
import threading
from collections.abc import Awaitable, Callable, Iterable
from functools import partial
from typing import Any

import pytest

from lidario import Lidar, LocalProtocolError, Mount, SessionClosed, merged
from tests.support.devices import Rig, call, left_still
from tests.support.loop import DrivenLoop

PATIENCE_S = 30.0
CALLS = ("get_health", "get_modes", "scan", "stop", "reset", "set_scan_frequency")
REFUSED_ELSEWHERE: list[Callable[[Lidar], Awaitable[Any]]] = [
    *(partial(call, name=name) for name in CALLS),
    Lidar.close,
    Lidar.__aenter__,
    lambda lidar: lidar.__aexit__(None, None, None),
    lambda lidar: lidar.record("never.mcap").__aenter__(),
    lambda lidar: anext(lidar.line_changes()),
]
"""In another thread. After the loop was closed, closing is harmless instead."""


@pytest.mark.parametrize("way", ["aclose", "release"])
async def test_a_stream_that_another_task_leaves_ends_for_its_reader(rig: Rig, way: str) -> None:
    async with rig.open() as lidar:
        stream = lidar.scans()
        reading = asyncio.ensure_future(anext(stream))
        await asyncio.sleep(0.05)
        if way == "aclose":
            await stream.aclose()
        else:
            stream.release()
        async with asyncio.timeout(PATIENCE_S):
            with pytest.raises(StopAsyncIteration):
                await reading
        await asyncio.sleep(2.0)
        assert left_still(rig)


def test_a_session_that_is_used_after_its_loop_was_closed(rig: Rig) -> None:
    held: list[Any] = []

    async def first() -> None:
        lidar = await rig.open()
        held.extend([lidar, lidar.scans(), merged(lidar, mounts=[Mount()])])
        for stream in held[1:]:
            await anext(stream)

    async def second() -> None:
        lidar, *streams = held
        for name in CALLS:
            with pytest.raises(SessionClosed, match="event loop"):
                await call(lidar, name)
        for stream in streams:
            async with asyncio.timeout(PATIENCE_S):
                with pytest.raises(LocalProtocolError, match="another event loop"):
                    await anext(stream)
        await streams[1].close()
        await lidar.close()

    for main in (first, second):
        with asyncio.Runner(loop_factory=DrivenLoop) as runner:
            runner.run(main())


def refused_elsewhere(calls: Iterable[Callable[[], Awaitable[Any]]]) -> list[str]:
    """What these calls are refused with in another thread, each in an event loop of its own."""
    refused: list[str] = []

    async def misuse(attempt: Callable[[], Awaitable[Any]]) -> None:
        async with asyncio.timeout(PATIENCE_S):
            await attempt()

    def other() -> None:
        for each in calls:
            try:
                asyncio.run(misuse(each))
            except LocalProtocolError as error:
                refused.append(str(error))

    thread = threading.Thread(target=other)
    thread.start()
    thread.join()
    return refused


async def test_a_session_that_another_thread_uses(rig: Rig) -> None:
    """Refused with the way to do it; the session is not harmed."""
    async with rig.read() as (lidar, stream):
        changes, clouds = lidar.line_changes(), merged(lidar, mounts=[Mount()])
        await anext(clouds)

        async def release() -> None:
            stream.release()

        of_streams = (
            stream.aclose, release, lambda: anext(stream), lambda: anext(changes), clouds.close,
            lambda: anext(clouds),
        )  # fmt: skip
        for calls, says in (
            ([partial(each, lidar) for each in REFUSED_ELSEWHERE], "run_coroutine_threadsafe"),
            (of_streams, "another event loop"),
        ):
            refused = refused_elsewhere(calls)
            assert len(refused) == len(calls)
            assert all(says in text for text in refused)
        async with asyncio.timeout(PATIENCE_S):
            await anext(stream)
            await anext(clouds)
            assert (await anext(changes)).state == "connected"
