"""A lidar that nobody reads is at rest: a second behind its opening, and behind whatever is asked of it.

Some models turn as soon as their port is opened, or as they have power. They are not stopped at once: mostly a
stream is wanted soon, and need not wait for the rotor then. Some hear nothing while DTR is cleared: asked at rest
they respond, and rest again after it.
"""

import asyncio
from contextlib import suppress
from functools import partial

import pytest

from lidario import LidarError, Unsupported
from lidario.basics.model import HealthStatus
from lidario.families.ydlidar.simulated.device import PROFILES
from lidario.session.lidar import Lidar
from tests.support.devices import EVERY_KIND, Rig, call, is_off, left_still, make_rig, names, take
from tests.support.discards import all_obeyed
from tests.support.loop import at_each, driven_loop, run_driven
from tests.support.samples import long_but_some
from tests.support.times import begun

LINGER_S = 1.0
"""How long what nobody reads goes on."""
TURN_UNASKED = ("rplidar-a1", "ydlidar-x2", "ldrobot-ld14p", "hlds")
"""One of each way to be stopped: DTR asserted, DTR cleared, a request, a letter."""
ONLY_TALK = ("ldrobot", "neato", "camsense", "irobotix")
STOPPED = tuple(dict.fromkeys((*TURN_UNASKED, *(kind for kind in EVERY_KIND if kind not in ONLY_TALK))))
"""One of each family that can be stopped, and of each way to switch a motor."""
CALLS = (
    *("get_info", "get_health", "get_modes", "get_sample_rate", "get_scan_frequency", "get_scan_frequency_range"),
    *("set_scan_frequency", "get_zero_offset", "set_zero_offset", "set_power_down_protection"),
    *("get_network_address", "set_network_address", "set_baudrate", "reset", "scan", "stop"),
)
TURNED_BY = {"reset": "rplidar-a1"}
"""The motor of an A1 hangs on DTR, which a reset does not touch."""


@pytest.mark.parametrize("rig", TURN_UNASKED, indirect=True)
async def test_what_turns_unasked_is_stopped_a_second_behind_its_opening(rig: Rig) -> None:
    async with rig.open() as lidar:
        await asyncio.sleep(LINGER_S - 0.1)
        assert rig.device.motor_on
        await asyncio.sleep(0.5)
        assert is_off(rig.device)
        assert len(await lidar.scan()) > 100


async def test_a_stream_that_begins_in_that_second_finds_its_rotor_turning() -> None:
    rig = make_rig("rplidar-a1")
    async with rig.open() as lidar, lidar.scans() as stream:
        opened = len(names(rig))
        for _ in range(20):
            await anext(stream)
        assert rig.device.motor_on
        assert "stop" not in names(rig)[opened:]


async def test_nothing_is_written_amid_a_restart_that_takes_longer() -> None:
    rig = make_rig("rplidar-a1")
    rig.device.boot_s = 2.5
    async with rig.open() as lidar:
        await asyncio.sleep(0.1)
        began = len(names(rig))
        await lidar.reset()
        assert set(names(rig)[began + 1 :]) <= {"stop", "get_info", "get_health"}
        await asyncio.sleep(0.1)
        assert not rig.device.motor_on


MOMENTS_S = (0.5, 0.05, 0.02, 0.01, 0.002, 0.0)


@pytest.mark.parametrize(
    ("rig", "before_s"),
    long_but_some(
        *((kind, MOMENTS_S[(number + 3 * half) % 6]) for number, kind in enumerate(STOPPED) for half in (0, 1))
    ),
    indirect=["rig"],
)
async def test_a_question_as_a_stream_is_given_up_is_answered(rig: Rig, before_s: float) -> None:
    """Some are asked by listening to them, and must turn for that. Behind it they are stopped."""
    async with rig.open() as lidar:
        await lidar.scan()
        await asyncio.sleep(LINGER_S - before_s)
        assert (await lidar.get_info()).family == rig.family
        await asyncio.sleep(LINGER_S + 0.5)
        assert not lidar.is_scanning
        assert left_still(rig), names(rig)[-6:]


@pytest.mark.long
@pytest.mark.parametrize("rig", TURN_UNASKED, indirect=True)
async def test_a_question_behind_a_stream_that_was_left_at_once_leaves_the_motor_off(rig: Rig) -> None:
    """It comes while the stop requests are about to be heard, and may wake the device."""
    for turn in range(1, 12):
        async with rig.open() as lidar:
            reading = await begun(take(lidar, 1), turn)
            reading.cancel()
            await lidar.get_info()
            await asyncio.wait([reading])
            await asyncio.sleep(LINGER_S + 0.5)
            assert not rig.device.motor_on, turn


async def cancelled_at(kind: str, name: str, turn: int) -> int:
    """Open, call, and cancel the call when the loop has gone round `turn` times; how often it went round for it."""
    rig, loop = make_rig(kind), driven_loop()
    async with rig.open() as lidar:
        task, first = asyncio.ensure_future(_called(lidar, name)), loop.turns
        loop.after(turn, task.cancel)
        with suppress(asyncio.CancelledError):
            await task
        took = loop.turns - first
        # It streams for a second more, where it was left in the midst of a scan; and a restart takes its time.
        await asyncio.sleep(4 * LINGER_S)
        assert not lidar.is_scanning
        assert not rig.device.motor_on
        assert left_still(rig), names(rig)[-6:]
        assert len(await lidar.scan()) > 0
    all_obeyed([rig.device])
    return took


async def _called(lidar: Lidar, name: str) -> None:
    with suppress(LidarError):
        await call(lidar, name)


@pytest.mark.exhaustive("points", sample=[3], full=[20])
@pytest.mark.exhaustive(
    "what",
    sample=[(name, TURNED_BY.get(name, STOPPED[number % len(STOPPED)])) for number, name in enumerate(CALLS)],
    full=[(name, kind) for name in CALLS for kind in STOPPED],
)
def test_what_is_cancelled_at_any_step_leaves_the_motor_off(what: tuple[str, str], points: int) -> None:
    name, kind = what
    turns = run_driven(lambda: cancelled_at(kind, name, 0))
    at_each(range(1, turns + 1, max(1, turns // points)), partial(cancelled_at, kind, name), name)


DARK = [name for name, profile in PROFILES.items() if profile.by_dtr]


def is_dark(rig: Rig) -> bool:
    return not rig.device.lit and not rig.device.scanning


@pytest.mark.parametrize("stopped", [True, False], ids=["after stop", "after opening"])
@pytest.mark.exhaustive("question", sample=["get_health", "get_info", "get_scan_frequency", "set_scan_frequency"])
@pytest.mark.parametrize("rig", DARK, indirect=True)
async def test_a_question_at_rest_is_heard_and_leaves_it_at_rest(rig: Rig, question: str, stopped: bool) -> None:
    async with rig.open() as lidar:
        if stopped:
            await take(lidar, 2)
            await lidar.stop()
            assert is_dark(rig)
        # Whoever cannot set its speed refuses; nobody is silent.
        with suppress(Unsupported):
            told = await call(lidar, question)
            assert question != "get_health" or told.status is HealthStatus.OK
        if not stopped:
            await lidar.stop()
            assert is_dark(rig)
        await asyncio.sleep(5.0)
        assert is_dark(rig)
        assert len(await take(lidar, 2)) == 2
    assert is_dark(rig)


@pytest.mark.long
@pytest.mark.parametrize("before", ["opened", "stopped", "scanned"])
@pytest.mark.parametrize("rig", DARK, indirect=True)
async def test_a_question_is_heard_although_another_task_stops_the_device_meanwhile(rig: Rig, before: str) -> None:
    """What stops it makes it deaf. It is woken again, and rests behind the question."""
    for turn in range(1 + len(before) % 3, 30, 3):
        async with rig.open() as lidar:
            if before == "scanned":
                await lidar.scan()
            elif before == "stopped":
                await lidar.stop()
            asking = await begun(lidar.get_info(), turn)
            late = asking.done()
            await lidar.stop()
            assert (await asking).family == rig.family
            await asyncio.sleep(0.5)
            assert is_dark(rig), turn
        if late:
            break
