"""Stopping at every moment, by every way: the device is still, waiters end at once, nothing is discarded."""

import asyncio
import gc
import math
from collections.abc import Awaitable, Callable
from contextlib import nullcontext, suppress
from itertools import count

import pytest

from lidario import InvalidValue, Lidar, LidarError, LocalProtocolError, Unsupported
from tests.session.test_unasked import SOME as TALKERS
from tests.support.devices import (
    SWITCHED,
    Rig,
    both_families,
    hears_only,
    leave_streaming,
    left_still,
    make_rig,
    names,
    scanning,
    some,
    take,
)
from tests.support.loop import now, now_ns
from tests.support.times import begun

Call = Callable[[Lidar], Awaitable[object]]


@pytest.mark.long
@pytest.mark.exhaustive("stride", sample=[4], full=[1])
@both_families
async def test_every_stop_is_followed_by_the_pause_it_demands(family: str, stride: int) -> None:
    """A start is cancelled at every step, and the next request is written as soon as the session allows."""
    for steps in range(1, 60, stride):
        rig = make_rig(family)
        async with rig.open() as lidar:
            async with lidar.scans() as stream:
                (await begun(stream.__anext__(), steps)).cancel()
            assert await lidar.set_scan_frequency(9.0) == pytest.approx(9.0)
            assert await lidar.get_scan_frequency() == pytest.approx(9.0)
            assert (await take(lidar, 2))[-1].rpm == pytest.approx(540, rel=0.02)


async def test_the_stop_requests_are_written_three_times_and_no_more(rig: Rig) -> None:
    """Nothing acknowledges them, so it is told twice; then it is asked whether it hears, and told a last time."""
    async with rig.open() as lidar:
        await take(lidar, 2)
        heard = len(rig.device.log)
    assert left_still(rig)
    again = names(rig)[heard:]
    obeyed = [each.name for each in rig.device.log]
    began = max(at for at, name in enumerate(obeyed) if "scan" in name)
    told = ["motor_speed_ctrl", "stop"] if rig.family == "rplidar" else ["forced_stop", "stop"]
    assert again == [*told, "get_health", *told]
    assert obeyed[began + 1 :] == [*told, *again]


@pytest.mark.parametrize(("lost", "more"), [(0, 0), (1, 0), (2, 0), (3, 0), (4, 6), (5, 0), (6, 0)])
async def test_one_of_the_stop_requests_may_be_lost(rig: Rig, lost: int, more: int) -> None:
    """Or the question between them: then all are written again, and once more where it has a response."""
    written = count()
    async with rig.read():
        hears_only(rig, lambda _: next(written) != lost)
    assert next(written) == 7 + more
    assert left_still(rig)


async def test_what_follows_a_stop_is_heard_by_a_device_that_is_deaf_for_longer_than_its_manual_says(
    rig: Rig,
) -> None:
    """Behind each stop request for 40 ms; the manual of an RPLIDAR says 10."""
    stop = {"rplidar": b"\xa5\x25", "ydlidar": b"\xa5\x65"}[rig.family]
    deaf_until, lost = 0.0, list[bytes]()

    def hears(data: bytes) -> bool:
        nonlocal deaf_until
        if now() < deaf_until:
            lost.append(data)
            return False
        deaf_until = now() + 0.04 if data == stop else 0.0
        return True

    async with rig.read() as (lidar, _):
        hears_only(rig, hears)
        await lidar.stop()
        assert deaf_until > 0
        await lidar.get_health()
        assert not lost


async def test_a_stream_left_by_break_stops_the_device_within_two_seconds(rig: Rig) -> None:
    async with rig.open() as lidar:
        async for _ in lidar.scans():
            break
        gc.collect()
        assert rig.device.scanning
        await asyncio.sleep(2.0)
        assert left_still(rig)
        assert not lidar.is_scanning
        assert len(await take(lidar, 2)) == 2


async def test_single_scans_in_a_row_do_not_restart_the_rotor(rig: Rig) -> None:
    async with rig.open() as lidar:
        scans = [await lidar.scan() for _ in range(5)]
        assert [scan.seq for scan in scans] == [0, 1, 2, 3, 4]
        assert sum("scan" in name for name in names(rig)) == 1
        before = names(rig)
        await lidar.get_health()
        assert lidar.stats.interruptions == 1
        await asyncio.sleep(2.0)
        # No stream was begun again behind the question: nobody reads.
        assert "get_health" in names(rig)[len(before) :]
        assert not any("scan" in name for name in names(rig)[len(before) :])
        assert left_still(rig)


def set_speed(hertz: float) -> Call:
    return lambda lidar: lidar.set_scan_frequency(hertz)


SPEEDS: list[Call] = [Lidar.get_scan_frequency, set_speed(8.0)]
IN_MID_SCAN: list[tuple[str, type[LidarError] | None, list[Call]]] = [
    ("ydlidar", None, [Lidar.get_scan_frequency_range, lambda lidar: lidar.set_zero_offset(False)]),
    ("ydlidar", InvalidValue, [set_speed(float("nan")), set_speed(4.9)]),
    ("ydlidar", Unsupported, [Lidar.get_sample_rate]),
    (
        "rplidar",
        Unsupported,
        [
            Lidar.get_zero_offset,
            lambda lidar: lidar.set_zero_offset(True),
            lambda lidar: lidar.set_power_down_protection(True),
        ],
    ),
    *((model, Unsupported, SPEEDS) for model in SWITCHED),
    *((model, Unsupported, [*SPEEDS, Lidar.reset, Lidar.get_sample_rate]) for model in TALKERS),
]
"""The model, with what its calls are refused, and the calls; none of them needs a request."""


@pytest.mark.parametrize(("rig", "refused", "calls"), IN_MID_SCAN, indirect=["rig"])
async def test_what_needs_no_request_interrupts_nothing(
    rig: Rig, refused: type[LidarError] | None, calls: list[Call]
) -> None:
    async with rig.open(keep_spinning=Lidar.reset in calls) as lidar, scanning(lidar, depth=9) as stream:
        heard = len(rig.device.log)
        for each in calls:
            with pytest.raises(refused) if refused else nullcontext():
                await each(lidar)
        assert lidar.stats.interruptions == 0
        assert len(rig.device.log) == heard
        assert (await anext(stream)).seq == 1


async def test_stop_in_every_state_and_twice_at_once(rig: Rig) -> None:
    async with rig.open() as lidar:
        await asyncio.gather(lidar.stop(), lidar.stop())
        stream = lidar.scans()
        await anext(stream)
        await asyncio.gather(lidar.stop(), lidar.stop())
        assert left_still(rig)
        scanning = asyncio.ensure_future(lidar.scan())
        await asyncio.sleep(0.05)
        await lidar.stop()
        with pytest.raises(LocalProtocolError, match="another task stopped the lidar before the scan was complete"):
            await scanning
        await asyncio.gather(lidar.close(), lidar.close())


async def test_a_stream_that_begins_while_a_stop_waits_for_a_question_is_not_stopped(rig: Rig) -> None:
    async with rig.open() as lidar:
        question = await begun(lidar.get_health())
        first = await begun(lidar.scans().__anext__())
        assert not question.done()
        stopped = await begun(lidar.stop())
        async with lidar.scans(depth=99) as stream:
            scans = await some(stream, 20)
        assert stopped.done()
        assert isinstance(first.exception(), StopAsyncIteration)
        assert [scan.seq for scan in scans] == list(range(scans[0].seq, scans[0].seq + 20))


async def test_one_that_streams_though_it_was_still_is_stopped_at_once(rig: Rig) -> None:
    """It begins by itself, 0.6 s after it was told to stop."""
    device, begins_ns = rig.device, 0
    transmit, wakeup = device.transmit, device.wakeup

    def by_itself(now_ns: int) -> bytes:
        nonlocal begins_ns
        if 0 < begins_ns <= now_ns:
            begins_ns = 0
            leave_streaming(device, now_ns)
        sent: bytes = transmit(now_ns)
        return sent

    async with rig.open() as lidar:
        await lidar.scan()
        begins_ns = now_ns() + 600_000_000
        device.transmit, device.wakeup = by_itself, lambda now: min(begins_ns or math.inf, wakeup(now) or math.inf)
        await lidar.stop()
        await asyncio.sleep(0.7)
        assert not begins_ns
        assert left_still(rig)


async def test_noise_from_one_that_is_still_is_not_told_to_stop_for_ever(rig: Rig) -> None:
    """It comes from time to time, and the line is quiet in between."""
    due_ns = 0

    def noise(now_ns: int) -> bytes:
        nonlocal due_ns
        came = bytes(100) if now_ns >= due_ns else b""
        due_ns = now_ns + 500_000_000 if came else due_ns
        return came

    async with rig.open() as lidar:
        await lidar.scan()
        await lidar.stop()
        rig.device.transmit, rig.device.wakeup = noise, lambda now_ns: max(due_ns, now_ns)
        with suppress(LidarError):
            await lidar.get_info()
        await asyncio.sleep(5.0)
        heard, came = names(rig).count("stop"), lidar.stats.bytes_received
        await asyncio.sleep(10.0)
        assert lidar.stats.bytes_received >= came + 2000
        assert names(rig).count("stop") == heard


async def test_a_cancelled_reader_does_not_end_its_stream(rig: Rig) -> None:
    rig.device.spin_up_s = 2.0
    async with rig.open() as lidar, lidar.scans() as stream:
        for _ in range(20):
            with pytest.raises(TimeoutError):
                async with asyncio.timeout(0.05):
                    await anext(stream)
        assert (await anext(stream)).seq == 0
        assert sum("scan" in name for name in names(rig)) == 1
