"""Another speed of the line: measured by the device, confirmed by the host, and never asked for while probing.

Also while other tasks cancel, stop, or want yet another one.
"""

import asyncio
from typing import Any

import pytest

from lidario import ConnectFailed, InvalidValue, ResponseTimeout, Unsupported, open_lidar
from lidario.families.rplidar.commands import GET_HEALTH, STOP
from lidario.families.rplidar.speed import MeasuredSpeed, confirm
from lidario.port.port import Port
from lidario.session.talking.readiness import UNCONFIRMED_S
from tests.support.cable import cable_to
from tests.support.devices import Rig, left_still, make_rig, names, take
from tests.support.loop import driven_loop, run_driven
from tests.support.rplidar_device import A1, C1, identified


def test_the_documented_confirmation() -> None:
    assert confirm(115_200).data == bytes.fromhex("a59008 5f5f 00c20100 0000 fe")


@pytest.mark.long
@pytest.mark.parametrize("scanning", [False, True])
async def test_device_and_port_change_together(rplidar: Rig, scanning: bool) -> None:
    async with rplidar.open() as lidar:
        stream = lidar.scans()
        if scanning:
            await anext(stream)
        await lidar.set_baudrate(1_500_000)
        assert (lidar.baudrate, rplidar.device.baudrate) == (1_500_000, 1_500_000)
        scans = [await anext(stream) for _ in range(3)]
        assert all(len(scan) > 3000 and not scan.lost_packets for scan in scans)
        # Nobody goes back: it was confirmed.
        await asyncio.sleep(2.0)
        assert (await lidar.get_health()).ok
    assert "new_baudrate_confirm" in names(rplidar, obeyed=True)


def test_an_unconfirmed_speed_is_given_up_by_the_device() -> None:
    rig = make_rig("rplidar")
    rig.device.set_host_baudrate(256_000, 1)
    for at in range(10):
        rig.device.receive(b"A" * 16, 1 + at * 50_000_000)
    told = rig.device.transmit(600_000_000)
    assert int.from_bytes(told, "little") == pytest.approx(256_000, rel=0.01)
    assert rig.device.baudrate == 256_000
    rig.device.transmit(2_000_000_000)
    assert rig.device.baudrate == 1_000_000


@pytest.mark.parametrize(
    ("told", "is_near"), [(243_200, True), (268_800, True), (243_199, False), (268_801, False)]
)
def test_a_measured_speed_may_be_off_by_what_a_line_tolerates(told: int, is_near: bool) -> None:
    """5 %, the error that a receiver of ten bits stands."""
    response = bytearray(told.to_bytes(4, "little"))
    assert MeasuredSpeed(256_000).intact(response, 0, 4) is is_near


@pytest.mark.parametrize("how", ["too slow", "other bytes", "scanning"])
def test_what_is_no_measurement_leaves_the_speed(how: str) -> None:
    rig = make_rig("rplidar")
    if how == "scanning":
        rig.device.receive(b"\xa5\x20", 1)
    rig.device.set_host_baudrate(256_000, 2)
    for at in range(40):
        data = b"A" * (4 if how == "too slow" else 16)
        rig.device.receive(b"\x42" + data if how == "other bytes" else data, 3 + at * 50_000_000)
    assert rig.device.baudrate == 1_000_000


@pytest.mark.parametrize("rig", ["rplidar-a1", "rplidar-old-firmware"], indirect=True)
async def test_old_firmware_is_not_asked(rig: Rig) -> None:
    async with rig.read() as (lidar, stream):
        with pytest.raises(Unsupported, match="too old"):
            await lidar.set_baudrate(921_600)
        assert lidar.stats.interruptions == 0
        await anext(stream)


@pytest.mark.parametrize("model", [A1, C1])
def test_newer_firmware_is_asked(model: int) -> None:
    """From 1.30 on; a C1 begins to count anew (rplidar_more.md 4)."""
    device = identified(model, (1, 30) if model == A1 else (1, 1))
    assert next(device.set_baudrate(230_400, 115_200)) == STOP


async def test_the_speed_that_the_line_has_already_is_not_measured(rplidar: Rig) -> None:
    """Also where another task has changed it to that speed meanwhile."""
    async with rplidar.open() as lidar:
        await lidar.set_baudrate(1_000_000)
        assert "new_baudrate_confirm" not in names(rplidar)
        await asyncio.gather(*(lidar.set_baudrate(921_600) for _ in range(3)))
        assert names(rplidar, obeyed=True).count("new_baudrate_confirm") == 1
        assert lidar.baudrate == rplidar.device.baudrate == 921_600


async def test_a_device_that_does_not_follow_is_reached_at_the_speed_before(
    rplidar: Rig, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(rplidar.device.line_speed, "hear", lambda data, now: b"")
    async with rplidar.open() as lidar:
        began = asyncio.get_running_loop().time()
        with pytest.raises(Unsupported, match="did not respond at 921600 baud"):
            await lidar.set_baudrate(921_600)
        assert asyncio.get_running_loop().time() - began < 1.8
        assert lidar.baudrate == 1_000_000
        assert len(await take(lidar, 2)) == 2


async def test_after_an_attempt_in_vain_it_is_heard_as_soon_as_it_has_gone_back(rplidar: Rig) -> None:
    """It has measured the new speed, and what it responded was lost. Nothing is written while it is deaf."""
    hear, receive, written = rplidar.device.line_speed.hear, rplidar.device.receive, list[bytes]()

    def note(data: bytes, at_ns: int) -> None:
        written.append(data)
        receive(data, at_ns)

    def silent(data: bytes, now: int) -> bytes:
        hear(data, now)
        return b""

    rplidar.device.line_speed.hear = silent
    async with rplidar.open() as lidar:
        await take(lidar, 1)
        with pytest.raises(Unsupported, match="did not respond at 921600 baud"):
            await lidar.set_baudrate(921_600)
        rplidar.device.receive, before = note, len(rplidar.device.log)
        assert (await lidar.get_health()).ok
        # The attempt ends in a stop, behind which it is asked whether it hears; the other one is the program's.
        assert written.count(GET_HEALTH.data) == 2
        assert [each.data for each in rplidar.device.log[before:] if each.obeyed] == written


@pytest.mark.parametrize("cancelled", [False, True])
@pytest.mark.parametrize("lost", [0, 1])
async def test_behind_an_attempt_in_vain_it_is_stopped_as_soon_as_it_has_gone_back(
    rplidar: Rig, monkeypatch: pytest.MonkeyPatch, *, cancelled: bool, lost: int
) -> None:
    """What it may have said at the other speed is not waited for; and the question behind it may be lost once."""
    monkeypatch.setattr(rplidar.device.line_speed, "hear", lambda data, now: b"")
    receive, written = rplidar.device.receive, list[bytes]()

    def note(data: bytes, at_ns: int) -> None:
        written.append(data)
        if data != GET_HEALTH.data or written.count(data) > lost:
            receive(data, at_ns)

    async with rplidar.open() as lidar:
        await take(lidar, 1)
        changing = asyncio.ensure_future(lidar.set_baudrate(921_600))
        await asyncio.wait([changing], timeout=0.2 if cancelled else None)
        changing.cancel()
        await asyncio.wait([changing])
        began, rplidar.device.receive = asyncio.get_running_loop().time(), note
        await lidar.stop()
        assert asyncio.get_running_loop().time() - began < UNCONFIRMED_S + 0.2 + 0.25 * lost
        # Twice before the question, once behind its response; and behind the silence, and what may be late.
        assert written.count(STOP.data) == 3 + 2 * lost


async def test_an_adapter_that_cannot_do_it_is_left_as_it_was(
    rplidar: Rig, monkeypatch: pytest.MonkeyPatch
) -> None:

    def refuse(port: Port, baudrate: int) -> None:
        raise ConnectFailed("it cannot run at that speed", reason="silent")

    async with rplidar.open() as lidar:
        with monkeypatch.context() as patch:
            patch.setattr(Port, "set_baudrate", refuse)
            with pytest.raises(ConnectFailed, match="cannot run"):
                await lidar.set_baudrate(921_600)
        assert (await lidar.get_health()).ok
        assert lidar.baudrate == 1_000_000


async def test_one_that_falls_silent_after_the_confirmation_is_told(rplidar: Rig) -> None:
    async with rplidar.open() as lidar:
        confirmed = rplidar.device.line_speed.confirm

        def forgets(payload: bytes) -> str:
            confirmed(payload)
            rplidar.device.mute = True
            return ""

        rplidar.device.line_speed.confirm = forgets
        with pytest.raises(ResponseTimeout):
            await lidar.set_baudrate(921_600)


@pytest.mark.parametrize("wrong", [0, -1, 300, 5_000_000, 115_200.5, "115200", None])
async def test_what_is_no_speed(rplidar: Rig, wrong: Any) -> None:
    async with rplidar.open() as lidar:
        with pytest.raises(InvalidValue, match=r"9600|whole number"):
            await lidar.set_baudrate(wrong)


async def test_a_line_without_a_speed_has_none_to_change(rplidar: Rig) -> None:
    with cable_to(rplidar) as cable:
        lidar = await rplidar.open()
    async with lidar:
        cable.ports[-1].baudrate = 0
        with pytest.raises(Unsupported, match="no speed"):
            await lidar.set_baudrate(921_600)


@pytest.mark.parametrize("rig", ["ydlidar-4ros", "ldrobot-ld06"], indirect=True)
async def test_other_families_cannot(rig: Rig) -> None:
    async with rig.open() as lidar:
        with pytest.raises(Unsupported, match="cannot be changed"):
            await lidar.set_baudrate(921_600)


async def test_nothing_is_measured_while_a_device_is_looked_for(
    rplidar: Rig, monkeypatch: pytest.MonkeyPatch
) -> None:
    """At any speed, and whoever is there: no byte of the pattern is ever written."""
    rplidar.device.mute = True
    written = bytearray()
    write = Port.write

    def see(port: Port, data: bytes) -> None:
        written.extend(data)
        write(port, data)

    monkeypatch.setattr(Port, "write", see)
    with pytest.raises(ConnectFailed):
        await open_lidar(rplidar.device)
    assert written
    assert b"AA" not in written
    assert b"\xa5\x90\x08" not in written


@pytest.mark.discards("a confirmation that nobody waits for, and one of another speed")
@pytest.mark.parametrize(
    ("measured", "confirmed", "why"),
    [(False, 256_000, "no speed was measured"), (True, 115_200, "not the speed that was measured")],
)
def test_a_confirmation_of_something_else_is_discarded(measured: bool, confirmed: int, why: str) -> None:
    rig = make_rig("rplidar")
    if measured:
        rig.device.set_host_baudrate(256_000, 1)
        for at in range(10):
            rig.device.receive(b"A" * 16, 1 + at * 50_000_000)
    rig.device.transmit(600_000_000)
    rig.device.receive(confirm(confirmed).data, 700_000_000)
    assert rig.device.log[-1].why == why
    rig.device.transmit(3_000_000_000)
    assert rig.device.baudrate == 1_000_000


@pytest.mark.parametrize("after_s", [0.0, 0.34, 0.4, 0.5])
async def test_who_only_waits_for_another_change_and_is_cancelled_leaves_the_speed_alone(
    rplidar: Rig, after_s: float
) -> None:
    async with rplidar.open() as lidar:
        await take(lidar, 1)
        changing = asyncio.ensure_future(lidar.set_baudrate(921_600))
        waiting = asyncio.ensure_future(lidar.set_baudrate(1_500_000))
        await asyncio.sleep(after_s)
        waiting.cancel()
        await changing
        assert (await lidar.get_health()).ok
        assert lidar.baudrate == rplidar.device.baudrate == 921_600


async def test_a_change_in_vain_behind_another_goes_back_to_that_ones_speed(
    rplidar: Rig, monkeypatch: pytest.MonkeyPatch
) -> None:
    hear = rplidar.device.line_speed.hear
    monkeypatch.setattr(
        rplidar.device.line_speed,
        "hear",
        lambda data, now: hear(data, now) if rplidar.device.baudrate == 1_000_000 else b"",
    )
    async with rplidar.open() as lidar:
        first, second = (asyncio.ensure_future(lidar.set_baudrate(each)) for each in (921_600, 1_500_000))
        with pytest.raises(Unsupported, match="stays 921600"):
            await second
        await first
        assert (await lidar.get_health()).ok
        assert lidar.baudrate == rplidar.device.baudrate == 921_600


@pytest.mark.long
@pytest.mark.parametrize("closed", [True, False])
@pytest.mark.parametrize("model", ["rplidar-s2", "rplidar-a2"])
def test_cancelled_at_any_step_it_is_reached_and_left_still_although_it_may_have_taken_the_new_speed(
    model: str, closed: bool
) -> None:
    """Measured and not confirmed, it hears nothing at the speed before until it has gone back, within a second."""

    async def cancelled_at(turn: int) -> int:
        made, loop = make_rig(model), driven_loop()
        async with made.open() as lidar:
            await lidar.scan()
            changing, first = asyncio.ensure_future(lidar.set_baudrate(921_600)), loop.turns
            loop.after(turn, changing.cancel)
            await asyncio.wait([changing])
            took = loop.turns - first
            if not closed:
                await asyncio.sleep(1.5)
                assert not made.device.motor_on, f"cancelled at {turn}"
                assert lidar.baudrate == made.device.baudrate, f"cancelled at {turn}"
                assert (await lidar.get_health()).ok
        assert left_still(made), f"cancelled at {turn}"
        return took

    for turn in range(1 + closed, run_driven(lambda: cancelled_at(0)) + 1, 2):
        run_driven(lambda turn=turn: cancelled_at(turn))  # type: ignore[misc]


@pytest.mark.parametrize("rig", ["rplidar-s2", "rplidar-a2"], indirect=True)
@pytest.mark.parametrize("step", range(1, 20, 2))
async def test_stopped_by_another_task_meanwhile_it_is_stopped_as_soon_as_the_speed_is_decided(
    rig: Rig, step: int
) -> None:
    due = asyncio.Event()
    async with rig.open() as lidar:
        await lidar.scan()
        changing = asyncio.ensure_future(lidar.set_baudrate(921_600))
        driven_loop().after(step, due.set)
        await due.wait()
        await lidar.stop()
        await changing
        assert lidar.baudrate == rig.device.baudrate == 921_600
        await asyncio.sleep(2.0)
        assert left_still(rig), names(rig)[-5:]
