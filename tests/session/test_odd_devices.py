"""Devices that differ from the documents, and lines that flip a bit: they are used all the same."""

from __future__ import annotations

import logging

import pytest

from lidario import HealthStatus, Unsupported
from lidario.families.rplidar.simulated.device import Profile, SimulatedRplidar
from lidario.families.rplidar.simulated.requests import Request
from tests.support.devices import Rig, both_families, change_info, left_still, make_rig, names, take
from tests.support.loop import driven

HEADER = "lidario.families.ydlidar.simulated.device.SCAN_HEADER"


@pytest.mark.parametrize("length", [0, 5, 90, 0x3FFF_FFFF])
def test_the_length_in_a_scan_header_of_the_4ros_is_ignored(length: int, monkeypatch: pytest.MonkeyPatch) -> None:
    header = b"\xa5\x5a" + (length | 1 << 30).to_bytes(4, "little") + b"\x81"
    monkeypatch.setattr(HEADER, header)
    rig = make_rig("ydlidar")

    @driven
    async def main() -> None:
        async with rig.open() as lidar:
            scans = await take(lidar, 3)
            assert [len(scan.ranges) > 1000 for scan in scans] == [True] * 3
            assert lidar.stats.skipped_bytes == lidar.stats.stray_bytes == 0

    main()


@pytest.mark.parametrize("status", [3, 128, 255])
@both_families
def test_a_health_that_is_not_defined_is_a_warning(
    family: str, status: int, caplog: pytest.LogCaptureFixture
) -> None:
    rig = make_rig(family)
    rig.device.health = (status, 0x1234)

    @driven
    async def main() -> None:
        async with rig.open() as lidar:
            assert lidar.health.status is HealthStatus.WARNING
            assert lidar.health.code == 0x1234
            assert str(status) in lidar.health.note
            await lidar.scan()
            assert await lidar.get_health() == lidar.health

    with caplog.at_level(logging.WARNING, "lidario"):
        main()
    assert f"health status {status}" in caplog.text
    assert "reset" not in names(rig)


@both_families
def test_a_device_that_does_not_tell_its_health_is_used(
    family: str, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    rig = make_rig(family)
    mute_for(rig, "get_health", monkeypatch)

    @driven
    async def main() -> None:
        async with rig.open() as lidar:
            assert lidar.health.status is HealthStatus.WARNING
            assert "GET_HEALTH" in lidar.health.note
            await lidar.scan()

    main()
    assert "does not tell its health" in caplog.text


@pytest.mark.parametrize("bit", [0, 3, 7, 8, 31, 70, 159])
@both_families
def test_one_flipped_bit_makes_no_other_device(family: str, bit: int, monkeypatch: pytest.MonkeyPatch) -> None:
    rig = make_rig(family)
    flips = iter([bit])

    def flip(payload: bytes) -> bytes:
        at = next(flips, None)
        if at is None:
            return payload
        changed = bytearray(payload)
        changed[at // 8] ^= 1 << at % 8
        return bytes(changed)

    change_info(rig, flip, monkeypatch)

    @driven
    async def main() -> None:
        async with rig.open() as lidar:
            assert next(flips, None) is None
            damaged = lidar.info
            await lidar.scan()
            assert await lidar.get_info() == damaged

    main()


def test_a_4ros_says_that_it_cannot_keep_spinning() -> None:
    rig = make_rig("ydlidar")

    @driven
    async def main() -> None:
        with pytest.raises(Unsupported, match="YDLIDAR 4ROS stops with its laser"):
            await rig.open(keep_spinning=True)

    main()
    assert left_still(rig)


def mute_for(rig: Rig, name: str, patch: pytest.MonkeyPatch) -> None:
    """Have the device leave a request without a response."""
    if rig.family == "rplidar":
        handlers = {**rig.device._HANDLERS, name: lambda *_: ""}
        patch.setattr(type(rig.device), "_HANDLERS", handlers)
        return
    obey = rig.device._obey
    codes = {"get_health": (0x91, 0x92)}[name]
    patch.setattr(rig.device, "_obey", lambda command, now: None if command in codes else obey(command, now))


@pytest.mark.parametrize("foretold", [0x81, 0x82, 0x83, 0x84, 0x86])
def test_the_descriptor_decides_which_format_is_decoded(foretold: int, monkeypatch: pytest.MonkeyPatch) -> None:
    rig = make_rig("rplidar")
    tell = type(rig.device.profile).conf

    def mistaken(profile: Profile, kind: int, arguments: bytes) -> bytes:
        told = tell(profile, kind, arguments)
        return bytes((foretold,)) if kind == 0x75 and told == b"\x85" else told

    monkeypatch.setattr(type(rig.device.profile), "conf", mistaken)
    # SCAN is what a mode of plain nodes is started by; the device sends its own format all the same.
    monkeypatch.setitem(type(rig.device)._HANDLERS, "scan", lambda device, request: start_dense(device, request))

    @driven
    async def main() -> None:
        async with rig.open() as lidar:
            scans = await take(lidar, 3)
            assert all(scan.lost_packets == 0 and 3000 < len(scan.ranges) < 3400 for scan in scans)
            assert scans[0].intensities is None
            assert lidar.stats.skipped_bytes == lidar.stats.stray_bytes == 0

    main()


def start_dense(device: SimulatedRplidar, request: Request) -> str:
    dense = device.profile.mode(1)
    assert dense is not None
    return device._start(dense, request)
