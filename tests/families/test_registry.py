"""The registry's rows agree with what stands in the families' folders."""

from dataclasses import replace
from pathlib import Path

import pytest

from lidario.basics.model import ScanMode
from lidario.families.base import Device, Family, Known
from lidario.families.registry import FAMILIES, family_named, family_of_simulated
from tests.support.families import ABOUT

TESTS = Path(__file__).resolve().parent.parent


@pytest.mark.parametrize("family", FAMILIES, ids=lambda family: family.name)
def test_each_family_has_its_tests_and_its_streams(family: Family) -> None:
    """What makes the tests of all families run with it: nothing else would notice that it has none."""
    about = ABOUT[family.name]
    assert about.MAKER.model in family.simulated
    assert set(about.MODELS) <= set(family.simulated)
    # Each format has a stream, mostly one that somebody else has decoded, and a scalar reference.
    assert {case.truth.family for case in about.CASES} == {family.name}
    told = {case.response_type for case in (*about.CASES, *getattr(about, "LAYOUTS", ()))}
    assert {kind().response_type for kind in family.formats} <= told
    assert set(about.KINDS) | set(about.OF_GOLDEN_ALONE) <= {case.name for case in about.CASES}
    assert (TESTS / "reference" / f"{family.name}.py").is_file()
    for name in ("test_decode.py", "test_formats.py"):
        assert (TESTS / "families" / family.name / name).is_file()
    assert list((TESTS / "families" / family.name).glob("test_simulated*.py"))


SLOWEST_MS = {"rplidar": 19.3, "ydlidar": 10.0, "hokuyo": 100.0, "ldrobot": 5.3}
"""How far the packets of the slowest model are apart that can be stopped; 17 ms, at most, of the others."""


@pytest.mark.parametrize("family", FAMILIES, ids=lambda family: family.name)
def test_a_line_counts_as_quiet_only_after_the_slowest_packets(family: Family) -> None:
    """An adapter may hold bytes for 16 ms more, and nothing waits for much longer than that."""
    assert 16 < 1e3 * family.timing.quiet_s - SLOWEST_MS.get(family.name, 17.0) < 46


DEAF_S = {"rplidar": (2.0, 5.0), "ydlidar": (1.0, 0.0), "ldrobot": (0.7, 0.0), "camsense": (0.5, 0.0)}
"""Seconds that a boot takes, of an S1, an LD06 and those that the vendor's SDK waits for; and for which half a
request is remembered (rplidar.md 1 and 7, ydlidar_4ros.md 3 and 7, more_families.md B2)."""


@pytest.mark.parametrize("name", DEAF_S)
def test_a_device_is_waited_for_while_it_may_hear_nothing(name: str) -> None:
    """Twice as long as any was seen to boot."""
    timing, (boots_s, holds_s) = family_named(name).timing, DEAF_S[name]
    assert timing.boot_s >= 2 * boots_s
    assert timing.forget_s >= holds_s


@pytest.mark.parametrize("family", FAMILIES, ids=lambda family: family.name)
def test_a_packet_is_known_by_its_first_two_bytes(family: Family) -> None:
    """The rest is for `measure`: of a longer header, one that the end of a read cuts would be missed."""
    for case in ABOUT[family.name].CASES:
        header = case.make_format().header
        assert all(header.match(packet[:2]) for packet in case.packets[:50]), case.name


@pytest.mark.parametrize("family", FAMILIES, ids=lambda family: family.name)
def test_each_row_is_complete(family: Family) -> None:
    assert family_named(family.name) is family
    assert isinstance(family.device(), Device)
    assert family.simulated
    for model in family.simulated:
        assert model.startswith(f"{family.name}-")
        assert family_of_simulated(model) is family
        device = family.simulate(model, world=None, serial=None, seed=3)
        assert device.baudrate in family.baudrates or getattr(device, "is_network", False)
        assert not device.scanning
    types = [kind().response_type for kind in family.formats]
    assert len(set(types)) == len(types)


TYPES = {
    "rplidar": {0x81, 0x82, 0x83, 0x84, 0x85, 0x86},
    "ydlidar": {0x81, 0xA1, 0xA2, 0xA3, 0xA4, 0xA5, 0xA6, 0xA7},
    "ldrobot": {0x2C, 0x2D, 0x2E},
    "hlds": {0x42, 0x43},
    "hokuyo": {0x45, 0x4D},
    "neato": {0x16, 0x17},
    "camsense": {0x55, 0x56},
    "irobotix": {0xAD, 0xAE},
}
"""The numbers by which recordings, and streams of other machines, name what they hold."""
FIELD = "AMIN:44;AMAX:725;AFRT:384;ARES:1024;DMIN:20;DMAX:5600;SCAN:600"
"""What a Hokuyo says that it sees; the packets of others need nothing else."""


@pytest.mark.parametrize("name", TYPES)
def test_the_numbers_that_recordings_hold_stay(name: str) -> None:
    mode = ScanMode(0, "", 0.0, 0.0, 0, details=FIELD)
    stream_in = family_named(name).stream_in
    held = {number for number in range(256) if stream_in(replace(mode, response_type=number)) is not None}
    assert held == TYPES[name]


@pytest.mark.parametrize("family", FAMILIES, ids=lambda family: family.name)
def test_bytes_alone_tell_no_reach_and_no_time(family: Family) -> None:
    for case in ABOUT[family.name].CASES:
        found = family.find_stream(memoryview(case.told + case.descriptor + case.raw), Known())
        assert found is not None, case.name
        assert (found.stream.mode.max_distance, found.stream.spin_up_s, found.stream.timed) == (0, 0, False)
