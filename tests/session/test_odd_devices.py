"""Devices that differ from the documents, and lines that flip a bit: they are used all the same."""

import re
from dataclasses import replace

import numpy as np
import pytest

from lidario import Health, HealthStatus, Scan, StreamFailed, Unsupported, open_lidar
from lidario.families.hokuyo.simulated import PROFILES as HOKUYOS
from lidario.families.hokuyo.simulated import SimulatedHokuyo
from lidario.families.rplidar.simulated.device import Profile, SimulatedRplidar
from lidario.families.rplidar.simulated.requests import Request
from lidario.sim.rooms import make_world
from tests.support.devices import Rig, change_info, end_of, make_rig, names, some, take
from tests.support.loop import now_ns
from tests.support.speeds import serial_in_memory

AS_REAL = {
    "ydlidar-tg15": 20_000,
    "ydlidar-x2": 3000,
    "ydlidar-x4": 5000,
    "ydlidar-tmini-pro": 4000,
    "ydlidar-tmini-plus": 4000,
    "ydlidar-4ros-long": 20_000,
}
"""Simulated devices that do what bytes of real ones show, and their samples a second."""
HEADER = "lidario.families.ydlidar.simulated.device.SCAN_HEADER"


@pytest.mark.parametrize("length", [0, 5, 90, 0x3FFF_FFFF])
async def test_the_length_in_a_scan_header_of_the_4ros_is_ignored(
    ydlidar: Rig, length: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    header = b"\xa5\x5a" + (length | 1 << 30).to_bytes(4, "little") + b"\x81"
    monkeypatch.setattr(HEADER, header)
    async with ydlidar.open() as lidar:
        scans = await take(lidar, 3)
        assert [len(scan.ranges) > 1000 for scan in scans] == [True] * 3
        assert lidar.stats.skipped_bytes == lidar.stats.stray_bytes == 0


@pytest.mark.parametrize("status", [3, 128, 255])
async def test_an_undefined_health_is_a_warning(rig: Rig, status: int, caplog: pytest.LogCaptureFixture) -> None:
    rig.device.health = (status, 0x1234)
    async with rig.open() as lidar:
        assert lidar.health.status is HealthStatus.WARNING
        assert lidar.health.code == 0x1234
        assert str(status) in lidar.health.note
        await lidar.scan()
        assert await lidar.get_health() == lidar.health
    assert f"health status {status}" in caplog.text
    assert "reset" not in names(rig)


async def test_a_device_that_does_not_tell_its_health_is_used(
    rig: Rig, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    if rig.family == "rplidar":
        monkeypatch.setattr(type(rig.device), "HANDLERS", {**rig.device.HANDLERS, "get_health": lambda *_: ""})
    else:
        obey = rig.device.obey
        monkeypatch.setattr(
            rig.device, "obey", lambda command, now: None if command in (0x91, 0x92) else obey(command, now)
        )
    async with rig.read() as (lidar, stream):
        assert lidar.health.status is HealthStatus.WARNING
        assert "GET_HEALTH" in lidar.health.note
        # Also where its stream ends and it is asked why.
        rig.device.halt(now_ns())
        await some(stream, 2)
        assert lidar.stats.restarts == 1
        assert lidar.health == Health(HealthStatus.WARNING, 0, "it does not tell its health")
    assert "does not tell its health" in caplog.text


@pytest.mark.parametrize("bit", [0, 3, 7, 8, 31, 70, 159])
async def test_one_flipped_bit_makes_no_other_device(rig: Rig, bit: int, monkeypatch: pytest.MonkeyPatch) -> None:
    flips = iter([bit])

    def flip(payload: bytes) -> bytes:
        at = next(flips, None)
        if at is None:
            return payload
        changed = bytearray(payload)
        changed[at // 8] ^= 1 << at % 8
        return bytes(changed)

    change_info(rig, flip, monkeypatch)
    async with rig.open() as lidar:
        assert next(flips, None) is None
        damaged = lidar.info
        await lidar.scan()
        assert await lidar.get_info() == damaged


async def test_a_4ros_says_that_it_cannot_keep_spinning(ydlidar: Rig) -> None:
    with pytest.raises(Unsupported, match="YDLIDAR 4ROS stops with its laser"):
        await ydlidar.open(keep_spinning=True)


@pytest.mark.parametrize("foretold", [0x81, 0x82, 0x83, 0x84, 0x86])
async def test_the_descriptor_decides_which_format_is_decoded(
    rplidar: Rig, foretold: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    tell = type(rplidar.device.profile).conf

    def mistaken(profile: Profile, kind: int, arguments: bytes) -> bytes:
        told = tell(profile, kind, arguments)
        if kind == 0x71 and told == (8000).to_bytes(4, "little"):
            # A sample of the format that was foretold takes four times as long.
            return (32_000).to_bytes(4, "little")
        return bytes((foretold,)) if kind == 0x75 and told == b"\x85" else told

    monkeypatch.setattr(type(rplidar.device.profile), "conf", mistaken)
    # SCAN is what a mode of plain nodes is started by; the device sends its own format all the same.
    monkeypatch.setitem(type(rplidar.device).HANDLERS, "scan", lambda device, request: start_dense(device, request))
    async with rplidar.open() as lidar:
        scans = await take(lidar, 3)
        assert all(scan.lost_packets == 0 and 3000 < len(scan.ranges) < 3400 for scan in scans)
        assert all(scan.rpm == pytest.approx(600, rel=0.02) for scan in scans)
        assert scans[0].intensities is None
        assert lidar.stats.skipped_bytes == lidar.stats.stray_bytes == 0


def start_dense(device: SimulatedRplidar, request: Request) -> str:
    return device.HANDLERS["express_scan"](device, replace(request, payload=bytes((1, 0, 0, 0, 0))))


async def test_modes_with_holes_in_their_numbers_are_all_found() -> None:
    rig = make_rig("rplidar-holes")
    async with rig.open() as lidar:
        told = {mode.name: mode for mode in await lidar.get_modes()}
        assert len(told) == len(rig.device.profile.modes)
        assert max(map(len, told)) > 90
        (typical,) = [mode for mode in told.values() if mode.typical]
        assert typical.response_type == 0x83
        scan = await lidar.scan()
        assert scan.mode == typical.name
        assert scan.intensities is not None


@pytest.mark.parametrize(
    ("model", "mode"),
    [
        ("rplidar-zero-us", "DenseBoost"),
        ("rplidar-no-modes", "Standard"),
        ("rplidar-a2-empty-list", "Express"),
        ("rplidar-old-firmware", "Express"),
        ("rplidar-unknown-response", None),
        # Time stamps stand between its packets.
        ("ydlidar-4ros-stamps", None),
    ],
)
async def test_awkward_devices_do_what_they_can(model: str, mode: str | None) -> None:
    rig = make_rig(model, world=make_world("circle"))
    async with rig.open() as lidar:
        scans = await take(lidar, 3)
        if mode is not None:
            assert scans[0].mode == mode
        np.testing.assert_allclose(scans[-1].ranges, 2.0, atol=0.005)
        assert (lidar.stats.lost_packets, lidar.stats.skipped_bytes) == (0, 0)
        assert scans[-1].time_increment_ns == pytest.approx(scans[-1].duration_ns / len(scans[-1]), rel=0.02)
        modes = await lidar.get_modes()
        if model == "rplidar-a2-empty-list":
            assert [(each.id, each.name) for each in modes] == [(0, "Standard"), (0, "Express")]
        strange = [each for each in modes if each.response_type == 0x8E]
        if strange:
            with pytest.raises(Unsupported, match="0x8E"):
                await lidar.scan(strange[0].name)
            assert len(await take(lidar, 1)) == 1


async def test_turns_are_told_apart_even_if_the_device_never_marks_one() -> None:
    rig = make_rig("ydlidar", world=make_world("circle"))
    clean = rig.device.transmit

    def without_marks(now: int) -> bytes:
        # The low bit of the third byte is the mark; without it the check value fails, and the packet is lost.
        data: bytes = clean(now)
        return re.sub(rb"\xaa\x55[\x01-\xff]\x01", b"\xaa\x55\x00\x00", data, flags=re.DOTALL)

    rig.device.transmit = without_marks
    async with rig.open() as lidar:
        scans = await take(lidar, 4)
    turn = 20_000 * rig.turn_s
    assert [len(scan) for scan in scans] == pytest.approx([turn] * 4, rel=0.01)
    for scan in scans:
        np.testing.assert_allclose(scan.ranges, 2.0, atol=0.002)


@pytest.mark.parametrize(
    ("model", "sends"), [("rplidar-s2", 0x85), ("rplidar-s1", 0x85), ("rplidar-c1", 0x85), ("rplidar-a1", 0x82)]
)
@pytest.mark.parametrize("name", ["Legacy express", "legacy EXPRESS"])
async def test_a_legacy_express_scan_can_be_asked_for_by_name(model: str, sends: int, name: str) -> None:
    """A C1 and an S1 respond with the descriptor of 0x85, as programs expect it that read them."""
    rig = make_rig(model, world=make_world("circle"))
    async with rig.open() as lidar:
        async with lidar.scans(name) as stream:
            scans = await some(stream, 3)
        assert name.casefold() not in [mode.name.casefold() for mode in await lidar.get_modes()]
        assert scans[-1].mode == "Legacy express"
        np.testing.assert_allclose(scans[-1].ranges, 2.0, atol=0.005)
        legacy = rig.device.profile.legacy_express
        assert legacy is not None
        assert legacy.response_type == sends
        samples = 60e6 / rig.device.profile.own_rpm / (legacy.us_q8 / 256)
        assert len(scans[-1]) == pytest.approx(samples, rel=0.02)
        # Its number is that of another mode.
        assert (await lidar.scan(0)).mode == "Standard"
    (request,) = [each.data for each in rig.device.log if each.name == "express_scan"]
    assert request == bytes.fromhex("A58205000000000022")


@pytest.mark.parametrize(
    ("before", "mode", "vain", "goes_on"),
    [
        ("Boost", "Stability", 1, True),
        ("Sensitivity", "Stability", 1, True),
        # Once is enough: then the rotor is the likelier reason, and so it is behind another format, or none.
        ("Boost", "Stability", 2, False),
        ("Express", "Stability", 1, False),
        (None, "Stability", 1, False),
    ],
)
async def test_a_stream_that_is_announced_in_vain_behind_one_like_it_is_started_again(
    before: str | None, mode: str, vain: int, goes_on: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """So did an A1 in two of eleven starts of Stability, both behind other modes in 0x84 (cpane/heron)."""
    rig = make_rig("rplidar-a1")
    async with rig.open() as lidar:
        if before:
            assert (await lidar.scan(before)).mode == before
        left, start = [vain], rig.device.HANDLERS["express_scan"]

        def in_vain(device: SimulatedRplidar, request: Request) -> str:
            why: str = start(device, request)
            if left[0]:
                left[0] -= 1
                device.halt(request.ended)
            return why

        monkeypatch.setitem(type(rig.device).HANDLERS, "express_scan", in_vain)
        async with lidar.scans(mode) as stream:
            if goes_on:
                assert (await anext(stream)).mode == mode
                assert lidar.stats.restarts == 1
            else:
                # A supply that is too weak is the usual reason (Slamtec/rplidar_ros issues 5 and 86, issue 95 of
                # robopeak/rplidar_ros): the device responds then, and its health is ok.
                says = str(await end_of(stream, StreamFailed))
                assert says.endswith("does the rotor turn? Is the power supply strong enough?")


@pytest.mark.parametrize(
    ("model", "mode", "says"),
    [
        # The others, and the ids that choose them.
        ("rplidar-s2", "nonesuch", r"Standard \(0\), DenseBoost \(1\), Legacy express, HQ scan$"),
        # What old firmware calls Express is no second mode.
        ("rplidar-old-firmware", "Legacy express", "no scan mode 'Legacy express'"),
    ],
)
async def test_an_unknown_mode_is_told(model: str, mode: str, says: str) -> None:
    async with make_rig(model).open() as lidar:
        with pytest.raises(Unsupported, match=says):
            await lidar.scan(mode)


@pytest.mark.long
@pytest.mark.parametrize(("rig", "rate"), AS_REAL.items(), indirect=["rig"])
async def test_nothing_is_told_as_lost_of_devices_that_are_odd_as_real_ones(rig: Rig, rate: float) -> None:
    async with rig.open() as lidar:
        scans = await take(lidar, 40)
        stats, rpm = lidar.stats, 0.6 * rig.device.profile.factory_speed
    # Those of an X4 begin while its motor speeds up.
    assert [scan.seq for scan in scans] == list(range(40))
    assert stats.lost_packets == stats.missed_scans == stats.broken_scans == stats.skipped_bytes == 0
    for scan in scans[10:]:
        assert scan.rpm == pytest.approx(rpm, rel=0.01)
        assert len(scan) == pytest.approx(rate * 60 / rpm, abs=2)


@pytest.mark.long
@pytest.mark.parametrize(
    ("mode", "factor"), [("Standard", 0.8), ("Standard", 2.0), ("DenseBoost", 1.25), ("DenseBoost", 4.0)]
)
async def test_a_sample_time_that_is_told_wrong_is_measured(
    rplidar: Rig, factor: float, mode: str, caplog: pytest.LogCaptureFixture
) -> None:
    profile = rplidar.device.profile
    wrong = tuple(replace(each, reported_us_q8=round(each.us_q8 * factor)) for each in profile.modes)
    rplidar.device.profile = replace(profile, modes=wrong)
    scans: list[Scan] = []
    async with rplidar.open() as lidar, lidar.scans(mode) as stream:
        while len(scans) < 60:
            scans.append(await anext(stream))
    rate = {"Standard": 16_000, "DenseBoost": 32_000}[mode]
    for scan in scans[50:]:
        assert scan.time_increment_ns == pytest.approx(1e9 / rate, rel=0.001)
        assert scan.duration_ns == pytest.approx(100e6, rel=0.01)
        assert scan.rpm == pytest.approx(600, rel=0.01)
    assert sum("what is measured counts" in each.getMessage() for each in caplog.records) == 1


@pytest.mark.discards("what it is asked in SCIP 2.0 before it speaks that")
@pytest.mark.parametrize("source", ["old", "serial://old?family=hokuyo"])
async def test_a_hokuyo_in_scip_1_is_told_to_speak_scip_2(source: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """A URG-04LX, each time it gets power and is reset (more_families_2.md 6.1)."""
    device = SimulatedHokuyo(replace(HOKUYOS["hokuyo-urg04lx"], begins_scip1=True))
    serial_in_memory(monkeypatch, old=device)
    async with open_lidar(source) as lidar:
        assert lidar.info.model == "Hokuyo URG-04LX"
        assert len(await lidar.scan()) == 682
        await lidar.reset()
        assert len(await lidar.scan()) == 682
    assert not device.motor_on
