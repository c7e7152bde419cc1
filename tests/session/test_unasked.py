"""Devices that only talk: opened without a word, read, left as they are; and a relative that hears requests."""

import math
from dataclasses import replace
from typing import Any

import pytest

from lidario import ConnectFailed, InvalidValue, StreamFailed, decode, open_lidar
from lidario.families.camsense.simulated import PROFILES as CAMSENSE
from lidario.families.camsense.simulated import SimulatedCamsense
from lidario.families.irobotix.simulated import PROFILES as IROBOTIX
from lidario.families.irobotix.simulated import SimulatedIrobotix
from lidario.families.ldrobot.simulated import PROFILES as LDROBOT
from lidario.families.ldrobot.simulated import SimulatedLdrobot
from lidario.families.registry import FAMILIES, family_named
from lidario.families.ydlidar.simulated.device import PROFILES as YDLIDAR
from lidario.sim.chassis import maker
from tests.support.devices import Rig, end_of, left_still, make_rig, names, some, take
from tests.support.loop import now_ns
from tests.support.refused import refused
from tests.support.samples import long_but_some
from tests.support.speeds import serial_in_memory
from tests.support.times import takes

TALKING = [name for name, profile in LDROBOT.items() if not profile.commands]
TALKING += [name for name, other in YDLIDAR.items() if not other.commands]
ALIKE = ("neato", "camsense", "irobotix")
"""Families of which all models only talk, and tell their speed."""
TALKING += [name for family in ALIKE for name in family_named(family).simulated]
OTHERS = {"YDLIDAR X2, X3 or alike": ["tx8"], "LDROBOT LD14 or LD08": ["ld08"], "XV-11 or alike": ["lds02rr"]}
"""What else some could be, as far as anybody knows."""
SOME = ("ldrobot-ld06", "ydlidar-x2", "neato-xv11", "camsense-x1", "irobotix-delta2a")
talkers = pytest.mark.parametrize("rig", long_but_some(*SOME), indirect=True)


@pytest.mark.exhaustive("model", sample=TALKING)
async def test_every_one_of_them_is_opened_read_and_left(model: str, caplog: pytest.LogCaptureFixture) -> None:
    rig = make_rig(model)
    caplog.clear()
    async with rig.open() as lidar:
        written = list[bytes]()
        lidar.tap(lambda way, data, at_ns: written.append(data) if way == "out" else None)
        scans = await take(lidar, 3)
        assert all(len(scan) > 300 and not scan.lost_packets for scan in scans)
        profile = rig.device.profile
        rpm = 0.6 * profile.factory_speed if model in YDLIDAR else 60 * profile.hertz
        if getattr(profile, "tells_speed", True):
            # 180: a TX8, whose speeds count from 3 Hz on, is read as an X2.
            assert scans[-1].reported_rpm in (180.0, 300.0, 312.0, 315.0, 360.0, 600.0)
        else:
            assert math.isnan(scans[-1].reported_rpm)
        assert scans[-1].rpm == pytest.approx(rpm, rel=0.02)
        assert (await lidar.get_health()).ok
        assert (await lidar.get_info()).serial == ""
        await lidar.stop()
        assert not lidar.is_scanning
        # Scans are followed by others: nothing was stopped. Nor is silence waited for behind them.
        assert len(await take(lidar, 2)) == 2
        with takes(0.02):
            await lidar.close()
    assert written == []
    assert names(rig) == []
    # Some have a switch after all: the control line DTR. Some could be another model, as far as anybody knows.
    by_dtr = getattr(rig.device.profile, "by_dtr", False)
    other = OTHERS.get(lidar.info.model, [])
    words = ["cannot be stopped from here"] * (not by_dtr)
    words += [f"name the model, as in ?model={name}" for name in other]
    assert len(caplog.messages) == len(words)
    assert all(word in text for word, text in zip(words, caplog.messages, strict=True)), caplog.messages
    assert rig.device.motor_on is not by_dtr


@pytest.mark.parametrize(
    ("model", "named", "of"),
    [
        ("irobotix-delta2a", "delta2g", "Delta-2A"),
        ("irobotix-delta2g", "delta2a", "Delta-2G"),
        ("ldrobot-ld14p", "ld06", "LDROBOT LD14P"),
        ("ldrobot-ld19", "ld14p", "LDROBOT LD06"),
    ],
)
async def test_a_name_that_its_packets_speak_against_is_told(
    model: str, named: str, of: str, caplog: pytest.LogCaptureFixture
) -> None:
    family = model.partition("-")[0]
    async with open_lidar(f"sim://{model}?via=memory&model={named}") as lidar:
        assert f"such as a {of}" in lidar.health.note
        assert "leave out ?model=" in lidar.health.note
    device = make_rig(model).device
    device.transmit(0)
    caplog.clear()
    list(decode(device.transmit(10**9), family=family, model=named))
    assert f"such as a {of}" in caplog.text


@pytest.mark.parametrize(("model", "named"), [("camsense-x1", "lds08rr"), ("camsense-lds08rr", "x1")])
async def test_a_name_by_which_no_packet_is_found_is_told(model: str, named: str) -> None:
    with pytest.raises(ConnectFailed, match=f"Camsense packets among them, but of another model than '{named}'"):
        await open_lidar(f"sim://{model}?via=memory&model={named}")


@pytest.mark.long
@pytest.mark.parametrize("model", SOME)
@pytest.mark.parametrize("fault", ["drop:1%", "flip:1%", "babble:30"])
async def test_one_on_a_damaged_line_is_opened_all_the_same(model: str, fault: str) -> None:
    """Its packets tell what it is, and here so many of them in a row never come."""
    async with open_lidar(f"sim://{model}?via=memory&seed=1&fault={fault}") as lidar:
        assert lidar.info.model.startswith(("LDROBOT LD06", "YDLIDAR X2", "XV-11", "Camsense X1", "Delta-2A"))
        scans = await take(lidar, 5)
        assert sum(map(len, scans)) > 500


@pytest.mark.long
@pytest.mark.parametrize(("model", "title"), [("neato-xv11", "Neato"), ("irobotix-delta2a", "3irobotix")])
async def test_one_whose_rotor_is_too_slow_to_measure_says_so_when_it_is_opened(model: str, title: str) -> None:
    """All that comes says so (more_families_2.md 3.6 and 5.3): it is no garbage."""
    rig = make_rig(model)
    rig.device.power_motor(60.0, now_ns())
    with pytest.raises(ConnectFailed, match=f"{title} packets among them, which measure nothing. Does its motor"):
        await rig.open()


@talkers
async def test_one_that_falls_silent_is_told_of_and_may_come_back_but_is_not_found_while_it_is(rig: Rig) -> None:
    async with rig.read() as (lidar, stream):
        rig.device.mute = True
        await end_of(stream, why=r"no scan data for 0.\d s")
        rig.device.mute = False
        assert len(await take(lidar, 2)) == 2
    rig.device.mute = True
    with refused("silent", "nothing came back"):
        await rig.open()


@pytest.mark.long
@talkers
async def test_a_session_comes_back_to_it(rig: Rig) -> None:
    async with rig.open(reconnect=True) as lidar, lidar.scans() as stream:
        await some(stream, 2)
        rig.device.reboot(now_ns(), off_s=2.0)
        await some(stream, 20)
        assert lidar.stats.reconnects + lidar.stats.restarts == 1


@pytest.mark.parametrize("family", [family for family in FAMILIES if family.models], ids=lambda family: family.name)
def test_a_model_may_be_named_where_the_device_cannot_tell(family: Any) -> None:
    for name, model in family.models.items():
        made = family.make(name)
        assert type(made) is type(family.device())
        assert set(model.baudrates) <= set(family.baudrates)


@pytest.mark.parametrize("baudrate", [230_400, 115_200])
async def test_a_model_with_two_lines_is_found_by_its_name(baudrate: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """An older Delta-2A has that of a Delta-2D (more_families_2.md 5.1)."""
    serial_in_memory(monkeypatch, named=SimulatedIrobotix(replace(IROBOTIX["irobotix-delta2a"], baudrate=baudrate)))
    async with open_lidar("serial://named?model=delta2a") as lidar:
        assert (lidar.info.model, lidar.baudrate) == ("Delta-2A", baudrate)
        assert len(await lidar.scan()) > 800


@pytest.mark.long
async def test_one_whose_motor_nobody_powers_says_so_and_makes_no_scans_of_what_comes() -> None:
    rig = make_rig("neato-xv11")
    async with rig.open() as lidar:
        with pytest.raises(StreamFailed, match="the motor does not turn as it should: 60 revolutions a minute"):
            async for scan in lidar.scans():
                assert len(scan) == 360
                if scan.seq == 3:
                    rig.device.power_motor(60.0, now_ns())
        assert "60 revolutions" in (await lidar.get_health()).note
        rig.device.power_motor(330.0, now_ns())
        scans = await take(lidar, 12)
        assert [scan.lost_packets for scan in scans] == [0] * 12
        assert scans[-1].reported_rpm == 330.0
        assert scans[-1].rpm == pytest.approx(330.0, rel=0.01)
        assert scans[-1].time_increment_ns == pytest.approx(60e9 / 330 / 360, abs=1)
        assert lidar.stats.missed_scans == lidar.stats.broken_scans == 0


# ----------------------------------------------------------------------------------------------- the one that hears


@pytest.mark.long
async def test_the_ld14p_is_started_and_stopped_by_requests() -> None:
    rig = make_rig("ldrobot-ld14p")
    async with rig.open() as lidar:
        await take(lidar, 2)
        assert await lidar.get_scan_frequency_range() == (2.0, 8.0)
        with pytest.raises(InvalidValue):
            await lidar.set_scan_frequency(9.0)
        assert await lidar.set_scan_frequency(8.0) == pytest.approx(8.0)
        scans = await take(lidar, 8)
        assert scans[-1].rpm == pytest.approx(480, rel=0.02)
    assert left_still(rig)
    # It is found all the same, and is started for that.
    async with rig.open() as lidar:
        assert lidar.info.model == "LDROBOT LD14P"
    assert left_still(rig)


async def test_a_slow_ld14p_is_told_from_an_ld14_by_the_speed_of_its_line(monkeypatch: pytest.MonkeyPatch) -> None:
    """It measures 2300 samples a second, as an LD14 does (more_families.md B1)."""
    device = SimulatedLdrobot(replace(LDROBOT["ldrobot-ld14p"], rate=2300.0))
    serial_in_memory(monkeypatch, slow=device)
    async with open_lidar("slow") as lidar:
        assert lidar.info.model == "LDROBOT LD14P"
        assert len(await lidar.scan()) == pytest.approx(2300 / 6, abs=12)
    assert not device.motor_on


class Blocked(SimulatedCamsense):
    """One whose rotor is blocked at some time: from then on its packets tell no angles."""

    is_blocked = False

    def _pack(self, turns: Any, seconds: Any, rpm: float) -> bytes:
        return self._greeting() * (len(turns) // 4) if self.is_blocked else super()._pack(turns, seconds, rpm)


async def test_packets_that_are_understood_are_no_noise() -> None:
    device = maker(Blocked, CAMSENSE)("camsense-x1")
    async with open_lidar(device, family="camsense") as lidar:
        stream = lidar.scans()
        await some(stream, 2)
        device.is_blocked = True
        error = await end_of(stream, why=r"no scan data for 0.\d s, though other packets arrive")
        assert "does the rotor turn?" in str(error)
        assert "noise" not in str(error)
        assert lidar.stats.records > 100
