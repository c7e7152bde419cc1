"""The simulated 4ROS by itself: what it responds and discards, what a reset or a fault leaves, and what it streams.

That is judged by the scalar reference, never by the host's code.
"""

from itertools import pairwise

import pytest

from lidario.families.ydlidar.simulated.device import Simulated4Ros, make_simulated
from lidario.families.ydlidar.simulated.packers import SCAN_HEADER
from lidario.sim.rooms import make_world
from tests.reference import ydlidar
from tests.support import simulated_4ros as say
from tests.support.simulated_4ros import BEGIN, MS, S, asked, set_hundredths, stream_of, unstamped, whole, why

pytestmark = pytest.mark.discards("what the simulated device discards is tested here")


def test_a_request_before_the_response_has_left_is_obeyed_and_remarked(device: Simulated4Ros) -> None:
    """No document says that it is discarded; but two responses of one type cannot be told apart."""
    device.receive(say.INFO + say.HEALTH, BEGIN)
    assert len(device.transmit(BEGIN + 10 * MS)) == 27 + 10
    assert [(each.obeyed, each.remark) for each in device.log] == [
        (True, ""),
        (True, "while the response to get_info is outstanding"),
    ]
    asked(device, say.INFO, BEGIN + 10 * MS)
    assert device.log[-1].remark == ""


def test_a_stop_before_the_header_has_left_is_remarked_and_a_keepalive_is_not(device: Simulated4Ros) -> None:
    device.spin_up_s = 0.0
    device.receive(say.SCAN, BEGIN)
    device.transmit(BEGIN + 1 * S)
    device.receive(say.SCAN, BEGIN + 1 * S)
    device.receive(say.STOP, BEGIN + 1 * S)
    assert [each.remark for each in device.log] == ["", "", ""]
    device.receive(say.SCAN, BEGIN + 2 * S)
    device.receive(say.STOP, BEGIN + 2 * S)
    assert device.log[-1].remark == "while the response to scan is outstanding"
    assert device.log[-1].obeyed
    assert not device.scanning


@pytest.mark.parametrize(
    ("model", "known", "unknown"),
    [("ydlidar-4ros", say.HEALTH, say.HEALTH_92), ("ydlidar-4ros-92", say.HEALTH_92, say.HEALTH)],
)
def test_one_of_the_health_requests_is_answered(model: str, known: bytes, unknown: bytes) -> None:
    device = make_simulated(model)
    assert asked(device, unknown, BEGIN) == b""
    assert why(device) == "unknown to this device"
    assert len(asked(device, known, BEGIN + S)) == 10


@pytest.mark.parametrize("command", [0x01, 0x50, 0x61, 0x98, 0xD0, 0xD1, 0xFF])
def test_unknown_requests_are_not_answered(device: Simulated4Ros, command: int) -> None:
    assert asked(device, bytes((0xA5, command)), BEGIN) == b""
    assert (device.log[-1].name, device.log[-1].obeyed) == ("unknown", False)


def test_speed_steps_end_at_the_limits(device: Simulated4Ros) -> None:
    now, speeds = BEGIN, []
    for request in (
        say.FASTER_FINE,
        say.SLOWER_FINE,
        say.FASTER,
        say.SLOWER,
        *[say.FASTER] * 6,
        say.FASTER_FINE,
        *[say.SLOWER] * 8,
        say.SLOWER_FINE,
    ):
        speeds.append(set_hundredths(asked(device, request, now)))
        now += S
    assert speeds[:4] == [710, 700, 800, 700]
    assert speeds[8:11] == [1200, 1200, 1200]
    assert speeds[-3:] == [500, 500, 500]


@pytest.mark.parametrize(
    "request_",
    [say.INFO, say.HEALTH, say.OFFSET, say.SPEED, say.FASTER, say.SLOWER_FINE, say.PROTECTION, say.RESET],
)
def test_nothing_else_is_heard_while_scanning(device: Simulated4Ros, request_: bytes) -> None:
    device.spin_up_s = 0.2
    device.receive(say.SCAN, BEGIN)
    for now in (BEGIN + 100 * MS, BEGIN + S):
        device.receive(request_, now)
        assert why(device) == "scanning"
    assert (device.set_speed, device.protected) == (700, False)
    assert whole(device.transmit(BEGIN + 2 * S)[7:])


def test_a_repeated_scan_is_not_answered(device: Simulated4Ros) -> None:
    data = stream_of(device, 0.5)
    device.receive(say.SCAN, BEGIN + S // 2)
    assert why(device) == ""
    data += device.transmit(BEGIN + S)
    assert SCAN_HEADER not in data
    turning = [packet for packet in whole(data) if ydlidar.is_start(packet)]
    assert len(turning) in (6, 7)


def test_requests_right_after_a_stop_are_discarded(device: Simulated4Ros) -> None:
    device.receive(say.STOP, BEGIN)
    assert asked(device, say.INFO, BEGIN + 4 * MS) == b""
    assert why(device) == "within 5 ms of stop"
    assert asked(device, say.INFO, BEGIN + 20 * MS) != b""


def test_a_reset(device: Simulated4Ros) -> None:
    asked(device, say.PROTECTION, BEGIN - 2 * S)
    asked(device, say.FASTER, BEGIN - S)
    stream_of(device, 1.0)
    device.receive(say.STOP, BEGIN + S - 10 * MS)
    device.transmit(BEGIN + S - MS)
    device.receive(say.RESET, BEGIN + S)
    assert not device.scanning
    assert not device.motor_on
    assert device.transmit(BEGIN + S + 999 * MS) == b""
    for request in (say.INFO, say.STOP):
        assert asked(device, request, BEGIN + S + 500 * MS) == b""
        assert why(device) == "still booting after reset"
    assert device.transmit(BEGIN + 3 * S) == b""
    assert asked(device, say.INFO, BEGIN + 4 * S)[:8] == bytes.fromhex("A55A1400000004 65")
    assert (device.set_speed, device.protected) == (700, False)


def test_some_tell_unasked_what_they_are_after_a_reset() -> None:
    device = make_simulated("ydlidar-4ros-92")
    device.receive(say.RESET, BEGIN)
    told = device.transmit(BEGIN + 3 * S)
    assert told == asked(device, say.INFO, BEGIN + 4 * S) != b""


def test_seeds_and_serials() -> None:
    def info(seed: int = 0, serial: bytes | None = None) -> bytes:
        return asked(make_simulated("ydlidar-4ros", seed=seed, serial=serial), say.INFO, BEGIN)

    assert info(1) == info(1) != info(2)
    assert max(info(1)[11:]) <= 9
    assert info(serial=b"\x99" * 8)[11:] == b"\x09" * 16
    assert info(serial=bytes(range(8)) * 2)[11:] == bytes(range(8)) * 2
    assert info(serial=bytes.fromhex("1234567812345678"))[11:] == bytes([1, 2, 3, 4, 5, 6, 7, 8] * 2)
    for wrong in (b"123", b"x" * 16, b"\x0a" * 16, bytes.fromhex("AA" * 8)):
        with pytest.raises(ValueError, match="16 digits"):
            make_simulated("ydlidar-4ros", serial=wrong)


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
    asked(device, say.PROTECTION, BEGIN - S)
    device.spin_up_s = 0.0
    device.receive(say.SCAN, BEGIN)
    for second in (2, 4, 6):
        device.receive(say.SCAN, BEGIN + second * S)
    assert device.transmit(BEGIN + 9 * S - 1)
    assert (device.scanning, device.lapses) == (True, 0)
    rest = device.transmit(BEGIN + 20 * S)
    assert (device.scanning, device.motor_on, device.lapses) == (False, False, 1)
    assert len(rest) < 200
    # From standstill a scan is answered again.
    assert asked(device, say.SCAN, BEGIN + 21 * S)[:7] == SCAN_HEADER


def test_time_stamps_between_the_packets() -> None:
    plain, stamped = (make_simulated(name, world=make_world("circle")) for name in ("ydlidar-4ros", say.STAMPED))
    expected, got = whole(stream_of(plain, 1.0)), stream_of(stamped, 1.0)
    stamps, packets = unstamped(got)
    assert packets[: len(expected) - 2] == expected[: len(expected) - 2]
    assert len(stamps) > 500
    # In ms; a packet of 40 samples lasts 2 ms.
    assert all(0 <= later - former <= 3 for former, later in pairwise(stamps))
    assert stamps[500] - stamps[0] == pytest.approx(sum(each[3] for each in packets[:500]) * 0.05, abs=1.5)


def test_the_last_packet_with_a_stamp_leaves_whole() -> None:
    device = make_simulated(say.STAMPED, world=make_world("circle"))
    data = stream_of(device, 1.0)
    device.receive(say.STOP, BEGIN + S)
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
        # Its last sample is its first one, and has another angle, as of a real one.
        assert packets[n][4:6] != packets[n][6:8]


def test_packets_while_the_motor_spins_up() -> None:
    packets = packets_of("ydlidar-x4", 2.0, spin_up_s=1.0)
    between = [(first_deg(b) - first_deg(a)) % 360 for a, b in pairwise(packets) if a[3] == b[3] == 40]
    assert 5 < between[0] < 8
    assert 19 < between[-1] < 23
    assert all(b - a < 2 for a, b in pairwise(between))


@pytest.mark.parametrize(
    ("model", "kind", "at"),
    [("ydlidar-tmini", TMINI, 0), ("ydlidar-tmini-plus-sh", ydlidar.Kind(4, intensity_bits=16), 1)],
)
def test_strengths_fill_the_byte_that_the_host_takes(model: str, kind: ydlidar.Kind, at: int) -> None:
    """Of 16 bits that is the upper one: with all in the lower one, every intensity would be 0."""
    packets = whole(stream_of(make_simulated(model), 2.0), kind)
    assert max(max(packet[10 + at :: kind.sample_bytes]) for packet in packets) > 200
