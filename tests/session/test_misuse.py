"""What a user may write by mistake, and the sentence that says what to write instead."""

import asyncio
import copy
import logging
import pickle
from collections.abc import Awaitable, Callable
from contextlib import suppress
from itertools import pairwise
from pathlib import Path
from queue import Queue
from threading import Event, Thread
from typing import Any

import numpy as np
import pytest

import lidario
from lidario import Busy, InternalError, InvalidValue, LocalProtocolError, SessionClosed
from lidario.network.fleet import list_remote_lidars
from lidario.network.router import Router
from lidario.ros import Fleet, Share
from lidario.session.streaming.control import StreamControl
from lidario.session.streaming.modes import Wanted
from lidario.session.talking.trouble import Trouble
from tests.support.devices import Rig, left_still, take
from tests.support.ports import PATIENCE_S
from tests.support.times import begun, cancelled


def test_open_lidar_is_neither_for_a_plain_with_nor_iterated() -> None:
    with pytest.raises(LocalProtocolError, match=r"async with.*open_sync"), lidario.open_lidar("sim://rplidar-s2"):
        raise AssertionError("never here")
    with pytest.raises(LocalProtocolError, match=r"async with.*open_sync"):
        iter(lidario.open_lidar("sim://rplidar-s2"))
    with pytest.raises(LocalProtocolError, match=r"async with.*scans\(\)"):
        aiter(lidario.open_lidar("sim://rplidar-s2"))


async def test_one_opening_is_entered_by_one_block_at_a_time() -> None:
    opening = lidario.open_lidar("sim://rplidar-s2?via=memory")
    async with opening as first:
        with pytest.raises(LocalProtocolError, match="is in use already"):
            async with opening:
                raise AssertionError("never here")
        await first.scan()
    with pytest.raises(SessionClosed):
        await first.scan()
    both = await asyncio.gather(opening.__aenter__(), opening.__aenter__(), return_exceptions=True)
    assert [type(each).__name__ for each in both] == ["Lidar", "LocalProtocolError"]
    await opening.__aexit__(None, None, None)
    await cancelled(opening.__aenter__())
    async with opening as third:
        await third.scan()


async def test_a_lidar_and_a_recording_are_not_for_a_plain_with(rplidar: Rig, tmp_path: Path) -> None:
    async with rplidar.open() as lidar:
        with pytest.raises(LocalProtocolError, match=r"lidar\.scans\(\)"):
            aiter(lidar)
        with pytest.raises(LocalProtocolError, match="async with"), lidar:
            raise AssertionError("never here")
        with (
            pytest.raises(LocalProtocolError, match=r"async with lidar\.record"),
            lidar.record(tmp_path / "x.mcap"),
        ):
            raise AssertionError("never here")
        for each in (lidar, lidar.scans(), lidar.sectors()):
            with pytest.raises(LocalProtocolError, match="async for"):
                iter(each)
            with pytest.raises(LocalProtocolError, match="async"), each:
                raise AssertionError("never here")


@pytest.mark.parametrize(
    "begin",
    [
        lambda: lidario.open_lidar("sim://rplidar-s2?via=memory"),
        lidario.list_lidars,
        lambda: Fleet("robots/*/scan").start(),
        list_remote_lidars,
        Router.open,
    ],
)
def test_without_an_asyncio_loop_one_sentence_says_so(begin: Callable[[], Awaitable[object]]) -> None:
    """As under trio, which runs coroutines without asyncio."""
    with pytest.raises(LocalProtocolError, match=r"anyio\.run"):
        next(begin().__await__())


async def test_what_is_open_is_neither_copied_nor_sent_to_another_process(rplidar: Rig, tmp_path: Path) -> None:
    """A copy would use the same line, and leave the device still when the first one is garbage."""
    async with rplidar.open() as lidar:
        streams = (lidar.scans(), lidar.sectors(), lidario.merged(lidar, mounts=[lidario.Mount()]))
        for held in (lidar, *streams, lidar.line_changes(), lidar.record(tmp_path / "a.mcap")):
            for way in (copy.copy, copy.deepcopy, pickle.dumps):
                with pytest.raises(LocalProtocolError, match="another process: send its scans"):
                    way(held)


async def test_values_that_cannot_be_right(rig: Rig) -> None:
    async with rig.open() as lidar:
        calls: list[Callable[[Any], Any]] = [lidar.set_scan_frequency, lidar.set_motor_speed]
        for wrong in ("x", None, float("nan"), -1.0, 1e9, [1]):
            for call in calls:
                with pytest.raises(InvalidValue):
                    await call(wrong)
        depth: Any
        for depth in (0, -1, "x", None, 1.5):
            with pytest.raises(InvalidValue):
                lidar.scans(depth=depth)
        assert await lidar.set_scan_frequency(np.float32(9.0)) == pytest.approx(9.0)  # type: ignore[arg-type]
        assert not lidar.is_scanning


async def test_whatever_is_as_good_as_true(ydlidar: Rig) -> None:
    async with ydlidar.open() as lidar:
        yes: Any
        for yes in (True, 1, np.True_):
            assert await lidar.set_power_down_protection(yes) is True
            assert await lidar.set_power_down_protection(not yes) is False
        with pytest.raises(InvalidValue, match="is True or False, not 'off'"):
            await lidar.set_power_down_protection("off")  # type: ignore[arg-type]
        with pytest.raises(InvalidValue, match="is True or False, not 90"):
            await lidar.set_zero_offset(90.0)  # type: ignore[arg-type]


async def test_a_number_of_seconds_is_no_policy() -> None:
    # A limit that nobody keeps would be worse than an error.
    with pytest.raises(InvalidValue, match=r"no Reconnect\(limit_s=…\), is True or False, not 60"):
        lidario.open_lidar("/dev/ttyUSB0", reconnect=60)  # type: ignore[arg-type]


async def test_a_mistake_of_ours_in_a_start_ends_the_session_and_stops_the_device(
    rig: Rig, caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    start = StreamControl.start

    async def blunder(control: StreamControl, wanted: Wanted) -> None:
        await start(control, wanted)
        raise IndexError("a bug")

    monkeypatch.setattr(StreamControl, "start", blunder)
    async with rig.open() as lidar:
        with pytest.raises(InternalError, match=r"IndexError\('a bug'\).*report"):
            await lidar.scan()
        with pytest.raises(InternalError):
            await lidar.get_health()
        await asyncio.sleep(0.5)
        assert left_still(rig)
    assert "a bug" in caplog.text


async def test_states_are_logged_for_who_looks_for_them(rplidar: Rig, caplog: pytest.LogCaptureFixture) -> None:
    caplog.set_level(logging.DEBUG, "lidario")
    async with rplidar.open() as lidar:
        await take(lidar, 1)
    states = [record.getMessage() for record in caplog.records if "->" in record.getMessage()]
    passed = ["idle", "starting", "running", "idle", "closed"]
    assert [line.split(": ")[1] for line in states] == [f"{one} -> {other}" for one, other in pairwise(passed)]
    assert all(record.levelno == logging.DEBUG for record in caplog.records)


def test_trouble_is_told_once_a_second(caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch) -> None:
    now = 100.0
    monkeypatch.setattr("lidario.session.talking.trouble.time.monotonic", lambda: now)
    trouble = Trouble()
    for _ in range(50):
        trouble.tell("revolutions discarded: %d", 3)
    trouble.tell("something else")
    now += 1.5
    trouble.tell("revolutions discarded: %d", 4)
    assert [record.getMessage() for record in caplog.records] == [
        "revolutions discarded: 3",
        "something else",
        "revolutions discarded: 4 (and 49 times more since the last such line)",
    ]


@pytest.mark.long
def test_a_second_thread_that_reads_a_stream_does_not_end_the_first() -> None:
    with lidario.open_sync("sim://rplidar-s2?via=memory") as session, session.scans() as stream:
        read, enough = Queue[int](), Event()

        def reading() -> None:
            while not enough.is_set():
                with suppress(Busy):
                    read.put(next(stream).seq)

        thread = Thread(target=reading)
        thread.start()
        with pytest.raises(Busy, match="two tasks read one stream"):
            while True:
                next(stream)
        seen = [read.get(timeout=PATIENCE_S) for _ in range(read.qsize() + 3)]
        enough.set()
        thread.join(PATIENCE_S)
    assert seen == sorted(set(seen))


@pytest.mark.parametrize("of", ["publisher", "fleet"])
async def test_a_publisher_is_run_and_a_fleet_is_read_by_one_task(of: str) -> None:
    """Of two that run one publisher, each would send every scan."""
    async with lidario.open_lidar("sim://rplidar-s2?via=memory") as lidar:
        share, fleet = Share(lidar, "robots/r7/scan"), Fleet("robots/*/scan")

        async def use() -> None:
            await (share.run() if of == "publisher" else anext(fleet))

        for _ in range(2):
            first = await begun(use())
            with pytest.raises(Busy, match=f"two tasks (run|read) one {of}: give each its own"):
                async with asyncio.timeout(PATIENCE_S):
                    await use()
            first.cancel()
            await asyncio.wait([first])
            assert first.cancelled()
