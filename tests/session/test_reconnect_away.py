"""While the device is away: questions, new streams, stop; the user's limit, and what is not come back from."""

import asyncio
import itertools
import logging
import math
from typing import Any

import pytest

from lidario import DeviceLost, InvalidValue, LidarError, Reconnect, SessionClosed
from lidario.basics.source import Source
from lidario.session.finding.discovery import PortInfo
from lidario.session.finding.places import Places
from lidario.session.talking.dialogue import Dialogue
from tests.support.cable import next_after, on_a_cable
from tests.support.devices import Rig, both_families, end_of, left_still, make_rig, scanning, take
from tests.support.loop import now, now_ns
from tests.support.times import takes


def causes(error: BaseException) -> list[BaseException]:
    cause = error.__cause__
    return [] if cause is None else [cause, *causes(cause)]


@both_families
async def test_it_gives_up_at_the_limit_with_the_first_error(family: str) -> None:
    async with on_a_cable(family, reconnect=Reconnect(limit_s=10.0)) as (cable, lidar):
        async with scanning(lidar) as stream:
            cable.pull()
            with takes(10.2, more_than_s=9.8):
                lost = await end_of(stream, DeviceLost, r"did not come back within 10 s .*no such port")
        assert any("unplugged" in str(each) for each in causes(lost))
        with pytest.raises(DeviceLost, match="did not come back"):
            await lidar.get_health()
        with pytest.raises(DeviceLost, match="did not come back"):
            await anext(lidar.scans())
        assert not lidar.is_connected
        # It backs off: each wait is twice as long as the one before, up to half a second.
        waits = [after - before for before, after in itertools.pairwise(cable.attempts[1:])]
        assert waits == pytest.approx([0.1, 0.2, 0.4, *[0.5] * (len(waits) - 3)], abs=0.01)


@pytest.mark.parametrize(
    ("policy", "reconnects"),
    [
        (Reconnect(limit_s=30.0), range(3, 20)),
        # It also waits where the device was back and no scan came.
        (Reconnect(limit_s=40.0, first_wait_s=10.0, longest_wait_s=10.0), range(2, 5)),
    ],
)
async def test_a_device_that_responds_but_never_scans_does_not_put_the_limit_off(
    rig: Rig, policy: Reconnect, reconnects: range
) -> None:
    async with rig.open(reconnect=policy) as lidar:
        async with scanning(lidar) as stream:
            rig.device.reboot(now_ns())
            rig.device.spin_up_s = 1e6
            # A start that is under way at the limit is waited for: five seconds without a packet, and the questions
            # that follow them.
            with takes(policy.limit_s + 10.0):
                await end_of(stream, DeviceLost, f"did not come back within {policy.limit_s:.0f} s")
        assert lidar.stats.reconnects in reconnects


async def test_a_loss_behind_scans_has_all_the_time_again(rig: Rig) -> None:
    async with on_a_cable(rig, reconnect=Reconnect(limit_s=10.0)) as (cable, lidar), lidar.scans() as stream:
        for count in (1, 2):
            await anext(stream)
            cable.pull()
            asyncio.get_running_loop().call_later(6.0, cable.plug)
            while lidar.stats.reconnects < count:
                await anext(stream)


async def test_questions_end_at_once_while_it_is_away(rig: Rig) -> None:
    async with on_a_cable(rig) as (cable, lidar):
        modes = await lidar.get_modes()
        async with scanning(lidar) as stream:
            asked = asyncio.ensure_future(lidar.get_health())
            waits = asyncio.ensure_future(lidar.get_info())
            await asyncio.sleep(0.0005)
            cable.pull()
            began = now()
            with pytest.raises(DeviceLost):
                await asked
            with pytest.raises(DeviceLost, match="before this request was sent: ask again"):
                await waits
            for call in (lidar.get_health, lidar.get_scan_frequency, lidar.reset):
                with pytest.raises(DeviceLost, match=r"has been away for 0\.0 s; .* ask again") as caught:
                    await call()
                assert any("unplugged" in str(each) for each in causes(caught.value))
            with pytest.raises(DeviceLost):
                await lidar.set_scan_frequency(8.0)
            assert now() - began < 0.1
            assert await lidar.get_modes() == modes
            assert "away" in repr(lidar)
            cable.plug()
            await next_after(stream, began)
            assert (await lidar.get_health()).ok


async def test_a_stream_waits_for_a_question_as_the_line_is_lost(rig: Rig, monkeypatch: pytest.MonkeyPatch) -> None:
    """The task that starts it gets its turn when there is no line any more, and does not try again and again."""
    begin, operations = Dialogue.begin, itertools.count()

    def begin_and_count(self: Dialogue) -> None:
        assert next(operations) < 20
        begin(self)

    monkeypatch.setattr(Dialogue, "begin", begin_and_count)
    async with on_a_cable(rig) as (cable, lidar):
        asked = asyncio.ensure_future(lidar.get_health())
        await asyncio.sleep(0.0005)
        async with lidar.scans() as stream:
            reading = asyncio.ensure_future(anext(stream))
            await asyncio.sleep(0)
            assert not asked.done()
            cable.pull()
            with pytest.raises(DeviceLost):
                await asked
            await asyncio.sleep(1.0)
            assert not reading.done()
            assert lidar.is_scanning
            cable.plug()
            began = now()
            assert (await reading).stamp_ns * 1e-9 > began
            assert lidar.stats.reconnects == 1


async def test_a_stream_that_is_begun_while_it_is_away_waits(rig: Rig) -> None:
    async with on_a_cable(rig) as (cable, lidar):
        cable.pull()
        await asyncio.sleep(1.0)
        assert not lidar.is_connected
        waiting = asyncio.ensure_future(lidar.scan())
        await asyncio.sleep(1.0)
        assert not waiting.done()
        assert lidar.is_scanning
        cable.plug()
        scan = await asyncio.wait_for(waiting, 5.0)
        assert scan.seq == 0, "nothing was read before, so nothing was missed"


@both_families
@pytest.mark.parametrize("returns", [True, False])
async def test_stop_while_it_is_away(family: str, returns: bool) -> None:
    rig = make_rig(family)
    async with on_a_cable(rig) as (cable, lidar):
        stream = lidar.scans()
        await anext(stream)
        reader = asyncio.ensure_future(end_of(stream, StopAsyncIteration))
        cable.pull()
        await asyncio.sleep(1.0)
        with takes(0.1):
            await lidar.stop()
        await reader
        assert not lidar.is_scanning
        if returns:
            cable.plug(boots=False)  # it had power all the time, and goes on scanning
            assert rig.device.scanning
            await asyncio.sleep(3.0)
            assert lidar.is_connected
            assert left_still(rig)
            assert len(await take(lidar, 2)) == 2


async def test_a_mistake_of_ours_ends_the_session(monkeypatch: pytest.MonkeyPatch) -> None:
    rplidar = make_rig("rplidar")
    async with on_a_cable(rplidar) as (cable, lidar):

        async def fail(*_: object) -> None:
            raise ZeroDivisionError

        monkeypatch.setattr("lidario.session.finding.places.Places.candidates", fail)
        async with scanning(lidar) as stream:
            cable.pull()
            await end_of(stream, LidarError, "please report this")


@pytest.mark.parametrize(
    "wrong",
    [
        *({"limit_s": 0}, {"limit_s": math.nan}, {"limit_s": "soon"}),
        *({"first_wait_s": 0}, {"first_wait_s": 1.0, "longest_wait_s": 0.5}, {"longest_wait_s": math.inf}),
    ],
)
def test_a_policy_that_cannot_be_right_is_refused(wrong: dict[str, Any]) -> None:
    with pytest.raises(InvalidValue, match="the limit and the waits"):
        Reconnect(**wrong)


@pytest.mark.parametrize("whys", [("no such port",), ("no such port", "it is busy")])
async def test_what_happens_is_logged_once(
    rplidar: Rig, whys: tuple[str, ...], caplog: pytest.LogCaptureFixture
) -> None:
    """And each reason, where these take turns: the device may be in two places, and is in neither."""
    # Which is what a program shows that does nothing about its log.
    caplog.set_level(logging.WARNING, "lidario")
    async with on_a_cable(rplidar) as (cable, lidar):
        cable.whys = whys
        for _ in range(2):
            caplog.clear()
            cable.pull()
            await asyncio.sleep(60.0)
            assert not lidar.is_connected
            cable.plug()
            await asyncio.sleep(3.0)
            lost, *reasons, back = caplog.messages
            assert lost.startswith("the line to the lidar is lost, and the session comes back:")
            assert all(reason.startswith("the lidar is not back yet:") for reason in reasons)
            assert sorted(reason.rpartition(": ")[2] for reason in reasons) == sorted(whys)
            assert "is back on memory, after 6" in back


async def test_a_question_on_the_new_line_ends_at_once_when_the_session_is_closed(rig: Rig) -> None:
    async with on_a_cable(rig) as (cable, lidar):
        async with scanning(lidar) as stream:
            cable.pull()
            pulled = now()
            cable.plug()
            await next_after(stream, pulled)
        await asyncio.sleep(0.1)
        rig.device.mute = True
        asked = asyncio.ensure_future(lidar.get_health())
        await asyncio.sleep(0.02)
        assert not asked.done()
        closing = asyncio.ensure_future(lidar.close())
        with takes(0.001), pytest.raises(SessionClosed):
            await asked
        await closing


@pytest.mark.parametrize("after_s", [0.8, 1.1])
async def test_a_line_that_works_is_asked_no_more_when_it_is_given_up(rig: Rig, after_s: float) -> None:
    """Neither by a question that waits for its turn meanwhile, nor by one behind that: both end at once."""
    async with on_a_cable(rig) as (_, lidar), scanning(lidar) as stream:
        rig.device.mute = True
        fell_silent = now()
        await asyncio.sleep(after_s)
        assert lidar.is_connected is (after_s < 1.0)
        with takes(0.2), pytest.raises(DeviceLost):
            await lidar.get_health()
        rig.device.mute = False
        await next_after(stream, fell_silent)


async def test_where_nothing_responds_other_places_are_looked_at_within_two_seconds() -> None:
    async with on_a_cable("rplidar", reconnect=Reconnect(limit_s=20.0)) as (cable, lidar):
        stream = lidar.scans()
        await anext(stream)
        cable.pull()
        cable.rig.device.mute = True
        cable.plug(boots=False)
        await end_of(stream, DeviceLost, "did not come back")
    assert max(later - earlier for earlier, later in itertools.pairwise(cable.attempts[1:])) < 2.0


async def test_a_port_that_nobody_has_named_is_asked_15_times_in_vain(monkeypatch: pytest.MonkeyPatch) -> None:
    always, other = (PortInfo(f"/dev/{name}", "", "CP2102", "") for name in ("always", "other"))
    ports = [always]
    monkeypatch.setattr("lidario.session.finding.discovery.list_serial_ports", lambda: ports)
    places = Places(Source("/dev/named", "serial", "/dev/named"))
    await places.begin()
    ports.append(other)
    for _ in range(15):
        there = await places.candidates()
        assert there == [Source(port, "serial", port) for port in ("/dev/named", "/dev/other")]
        for place in there:
            places.silent(place)
    assert await places.candidates() == there[:1]
    # What has been away may be what is looked for.
    for there_now, count in (([], 1), ([always, other], 3)):
        ports[:] = there_now
        assert len(await places.candidates()) == count
