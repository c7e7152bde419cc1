"""What the simulated 4ROS streams: judged by the scalar reference, never by the host's code."""

from itertools import pairwise

import pytest

from lidario.families.ydlidar.simulated.device import Simulated4Ros, make_simulated
from lidario.families.ydlidar.simulated.packers import SCAN_HEADER
from lidario.sim.rooms import make_world
from tests.reference import ydlidar
from tests.support.simulated_4ros import (
    BEGIN,
    PROTECTION,
    SCAN,
    STAMPED,
    STOP,
    S,
    asked,
    stream_of,
    unstamped,
    whole,
)

pytestmark = pytest.mark.discards("what the simulated device discards is tested here")


TMINI = ydlidar.Kind(sample_bytes=3, unit=4, flags=True, intensity_bits=8)


@pytest.mark.long
@pytest.mark.parametrize(("hundredths", "samples"), [(500, 4000), (700, 2857), (1000, 2000), (1200, 1667)])
def test_turns(device: Simulated4Ros, hundredths: int, samples: int) -> None:
    device.set_speed = hundredths
    packets = whole(stream_of(device, 1.0))
    starts = [n for n, packet in enumerate(packets) if ydlidar.is_start(packet)]
    assert abs(len(starts) - hundredths // 100) <= 1
    step = 23040 * hundredths / 100 / 20_000
    for begin, end in pairwise(starts):
        turn = packets[begin:end]
        assert turn[0][2] == (hundredths // 10 - 30) << 1 | 1
        assert [packet[3] for packet in turn[:-1]] == [1] + [40] * (len(turn) - 2)
        assert 1 <= turn[-1][3] <= 40
        assert not any(ydlidar.is_start(packet) for packet in turn[1:])
        assert sum(packet[3] for packet in turn) in (samples - 1, samples, samples + 1)
        raw = [sample.raw_deg * 64 for sample in ydlidar.decode(turn)]
        assert raw[0] < step
        assert all(abs(b - a - step) <= 1.01 for a, b in pairwise(raw))
        assert {sample.distance_mm for sample in ydlidar.decode(turn)} == {2000.0}


def test_protection_stops_a_scan_that_nobody_keeps_alive(device: Simulated4Ros) -> None:
    asked(device, PROTECTION, BEGIN - S)
    device.spin_up_s = 0.0
    device.receive(SCAN, BEGIN)
    for second in (2, 4, 6):
        device.receive(SCAN, BEGIN + second * S)
    assert device.transmit(BEGIN + 9 * S - 1)
    assert (device.scanning, device.lapses) == (True, 0)
    rest = device.transmit(BEGIN + 20 * S)
    assert (device.scanning, device.motor_on, device.lapses) == (False, False, 1)
    assert len(rest) < 200
    # From standstill a scan is answered again.
    assert asked(device, SCAN, BEGIN + 21 * S)[:7] == SCAN_HEADER


def test_time_stamps_between_the_packets() -> None:
    plain, stamped = (make_simulated(name, world=make_world("circle")) for name in ("ydlidar-4ros", STAMPED))
    expected, got = whole(stream_of(plain, 1.0)), stream_of(stamped, 1.0)
    stamps, packets = unstamped(got)
    assert packets[: len(expected) - 2] == expected[: len(expected) - 2]
    assert len(stamps) > 500
    # In ms; a packet of 40 samples lasts 2 ms.
    assert all(0 <= later - former <= 3 for former, later in pairwise(stamps))
    assert stamps[500] - stamps[0] == pytest.approx(sum(each[3] for each in packets[:500]) * 0.05, abs=1.5)


def test_the_last_packet_with_a_stamp_leaves_whole() -> None:
    device = make_simulated(STAMPED, world=make_world("circle"))
    data = stream_of(device, 1.0)
    device.receive(STOP, BEGIN + S)
    data += device.transmit(BEGIN + 2 * S)
    assert data[: data.rindex(b"\xaa\x66")].count(b"\xaa\x66") > 500
    assert len(ydlidar.split(data[data.rindex(b"\xaa\x66") + 8 :])) == 1


def packets_of(model: str, seconds: float = 3.0, spin_up_s: float = 0.0) -> list[bytes]:
    made = make_simulated(model, world=make_world("circle"))
    if not made.profile.one_way:
        return whole(stream_of(made, seconds, spin_up_s=spin_up_s))
    data = made.transmit(BEGIN) + made.transmit(BEGIN + int(seconds * S))
    return whole(data[data.index(b"\xaa\x55") :])


def first_deg(packet: bytes) -> float:
    return (int.from_bytes(packet[4:6], "little") >> 1) / 64


@pytest.mark.parametrize(("model", "seam"), [("ydlidar-tg15", 108.05), ("ydlidar-x2", 351.19)])
def test_where_revolutions_begin(model: str, seam: float) -> None:
    starts = [first_deg(packet) for packet in packets_of(model) if ydlidar.is_start(packet)]
    assert len(starts) > 10
    assert all(-1 / 64 <= first - seam < 0.8 for first in starts)


def test_bits_in_the_ct_byte_of_ordinary_packets() -> None:
    packets = whole(stream_of(make_simulated("ydlidar-tmini-pro"), 2.0), TMINI)
    assert {packet[2] for packet in packets if not ydlidar.is_start(packet)} == {0x06}
    assert sum(ydlidar.is_start(packet) for packet in packets) > 10


def test_a_sample_behind_the_seam_that_belongs_to_the_revolution_before() -> None:
    packets = whole(stream_of(make_simulated("ydlidar-tmini-plus"), 4.0), TMINI)
    late = [n for n, packet in enumerate(packets) if packet[3] == 1 and not packet[2] & 1 and first_deg(packet) < 5]
    assert 2 <= len(late) <= 4
    for n in late:
        assert ydlidar.is_start(packets[n + 1])
        assert 0 < first_deg(packets[n + 1]) - first_deg(packets[n]) < 1


def test_packets_while_the_motor_spins_up() -> None:
    packets = packets_of("ydlidar-x4", 2.0, spin_up_s=1.0)
    between = [(first_deg(b) - first_deg(a)) % 360 for a, b in pairwise(packets) if a[3] == b[3] == 40]
    assert 5 < between[0] < 8
    assert 19 < between[-1] < 23
    assert all(b - a < 2 for a, b in pairwise(between))
