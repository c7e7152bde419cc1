"""The simulated 4ROS by itself: its bytes are judged by the scalar reference, never by the host's code."""

from functools import reduce
from itertools import pairwise
from operator import xor

import pytest

from lidario.families.ydlidar.simulated.device import PROFILES, Simulated4Ros, make_simulated
from lidario.families.ydlidar.simulated.packers import SCAN_HEADER, pack_points, pack_time_stamp
from lidario.sim.device import SimulatedDevice
from lidario.sim.rooms import make_world
from lidario.sim.serve import MemoryLine
from tests.reference import ydlidar

pytestmark = pytest.mark.discards("what the simulated device discards is tested here")

MS = 1_000_000
S = 1000 * MS
BEGIN = 5 * S

SCAN, STOP, FORCED_STOP, RESET = b"\xa5\x60", b"\xa5\x65", b"\xa5\x00", b"\xa5\x80"
INFO, HEALTH, HEALTH_92, OFFSET, SPEED = b"\xa5\x90", b"\xa5\x91", b"\xa5\x92", b"\xa5\x93", b"\xa5\x0d"
FASTER_FINE, SLOWER_FINE, FASTER, SLOWER = b"\xa5\x09", b"\xa5\x0a", b"\xa5\x0b", b"\xa5\x0c"
PROTECTION = b"\xa5\xd9"
STAMPED = "ydlidar-4ros-stamps"


@pytest.fixture
def device() -> Simulated4Ros:
    return make_simulated("ydlidar-4ros", world=make_world("circle"), serial="0123456789012345")


def asked(device: Simulated4Ros, request: bytes, now: int) -> bytes:
    """What comes within 10 ms of a request."""
    device.receive(request, now)
    return device.transmit(now + 10 * MS)


def set_hundredths(reply: bytes) -> int:
    assert reply[:7] == bytes.fromhex("A55A0400000004")
    return int.from_bytes(reply[7:], "little")


def why(device: Simulated4Ros) -> str:
    assert device.log[-1].obeyed is (not device.log[-1].why)
    return device.log[-1].why


def stream_of(device: Simulated4Ros, seconds: float, *, spin_up_s: float = 0.0) -> bytes:
    """The packets of `seconds` of a scan started at BEGIN."""
    device.spin_up_s = spin_up_s
    device.receive(SCAN, BEGIN)
    data = device.transmit(BEGIN + int((seconds + spin_up_s) * S))
    assert data.startswith(SCAN_HEADER)
    return data[len(SCAN_HEADER) :]


def whole(data: bytes) -> list[bytes]:
    """The packets of a stream, less the one under way at its end."""
    while data:
        try:
            return ydlidar.split(data)
        except ValueError:
            data = data[: data.rindex(b"\xaa\x55")]
    return []


def unstamped(data: bytes) -> tuple[list[int], list[bytes]]:
    """Times of the stamps in ms, and the packets, of a stream with a time stamp record before each packet."""
    stamps, packets = [], []
    while len(data) >= 8 + 10:
        assert data[:2] == b"\xaa\x66"
        assert reduce(xor, data[:8]) == 0
        size = 8 + 10 + 2 * data[8 + 3]
        stamps.append(int.from_bytes(data[3:7], "little"))
        packets.append(data[8:size])
        data = data[size:]
    return stamps, packets


def test_it_is_a_simulated_device(device: Simulated4Ros) -> None:
    served: SimulatedDevice = device
    assert served.baudrate == 512_000
    assert not served.scanning
    assert not served.motor_on
    assert served.wakeup(BEGIN) is None


def test_a_request_before_the_response_has_left_is_obeyed_and_remarked(device: Simulated4Ros) -> None:
    """No document says that it is discarded; but two responses of one type cannot be told apart."""
    device.receive(INFO + HEALTH, BEGIN)
    assert len(device.transmit(BEGIN + 10 * MS)) == 27 + 10
    assert [(each.obeyed, each.remark) for each in device.log] == [
        (True, ""),
        (True, "while the response to get_info is outstanding"),
    ]
    asked(device, INFO, BEGIN + 10 * MS)
    assert device.log[-1].remark == ""


def test_a_stop_before_the_header_has_left_is_remarked_and_a_keepalive_is_not(device: Simulated4Ros) -> None:
    device.spin_up_s = 0.0
    device.receive(SCAN, BEGIN)
    device.transmit(BEGIN + 1 * S)
    device.receive(SCAN, BEGIN + 1 * S)
    device.receive(STOP, BEGIN + 1 * S)
    assert [each.remark for each in device.log] == ["", "", ""]
    device.receive(SCAN, BEGIN + 2 * S)
    device.receive(STOP, BEGIN + 2 * S)
    assert device.log[-1].remark == "while the response to scan is outstanding"
    assert device.log[-1].obeyed
    assert not device.scanning


def test_answers(device: Simulated4Ros) -> None:
    device.health, device.zero_offset = (1, 0x0203), -5
    head = bytes.fromhex("A55A1400000004 65 01 03 02")
    assert asked(device, INFO, BEGIN) == head + bytes([*range(10), *range(6)])
    assert asked(device, HEALTH, BEGIN + 1 * S) == bytes.fromhex("A55A0300000006 01 0302")
    assert asked(device, OFFSET, BEGIN + 2 * S) == bytes.fromhex("A55A0400000004 FBFFFFFF")
    assert set_hundredths(asked(device, SPEED, BEGIN + 3 * S)) == 700
    assert asked(device, PROTECTION, BEGIN + 4 * S) == bytes.fromhex("A55A0100000004 00")
    assert asked(device, PROTECTION, BEGIN + 5 * S) == bytes.fromhex("A55A0100000004 01")
    assert [entry.name for entry in device.log] == [
        "get_info",
        "get_health",
        "get_zero_offset",
        "get_speed",
        "toggle_protection",
        "toggle_protection",
    ]
    assert all(entry.obeyed for entry in device.log)


@pytest.mark.parametrize(
    ("model", "known", "unknown"), [("ydlidar-4ros", HEALTH, HEALTH_92), ("ydlidar-4ros-92", HEALTH_92, HEALTH)]
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


def test_requests_may_come_in_pieces_and_amid_noise(device: Simulated4Ros) -> None:
    device.receive(b"\x00\x90\xff\xa5", BEGIN)
    assert device.log == []
    assert len(asked(device, b"\xa5\x90", BEGIN + S)) == 27


def test_speed_steps_end_at_the_limits(device: Simulated4Ros) -> None:
    now, speeds = BEGIN, []
    for request in (
        FASTER_FINE,
        SLOWER_FINE,
        FASTER,
        SLOWER,
        *[FASTER] * 6,
        FASTER_FINE,
        *[SLOWER] * 8,
        SLOWER_FINE,
    ):
        speeds.append(set_hundredths(asked(device, request, now)))
        now += S
    assert speeds[:4] == [710, 700, 800, 700]
    assert speeds[8:11] == [1200, 1200, 1200]
    assert speeds[-3:] == [500, 500, 500]


@pytest.mark.parametrize(("hundredths", "samples"), [(500, 4000), (700, 2857), (1000, 2000), (1200, 1667)])
def test_turns(device: Simulated4Ros, hundredths: int, samples: int) -> None:
    device.set_speed = hundredths
    packets = whole(stream_of(device, 2.0))
    starts = [n for n, packet in enumerate(packets) if ydlidar.is_start(packet)]
    assert len(starts) in (hundredths // 50, hundredths // 50 + 1, hundredths // 50 - 1)
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


def test_the_line_is_used_as_documented(device: Simulated4Ros) -> None:
    data = stream_of(device, 10.0)
    assert len(data) / 10 == pytest.approx(45_100, rel=0.005)
    assert sum(packet[3] for packet in whole(data)) == pytest.approx(200_000, abs=100)


@pytest.mark.parametrize("hundredths", [500, 700, 1000, 1200])
@pytest.mark.parametrize("spin_up_s", [0.0, 0.3])
def test_bytes_do_not_depend_on_the_steps_of_time(hundredths: int, spin_up_s: float) -> None:
    def run(step: int) -> bytes:
        device = make_simulated("ydlidar-4ros", seed=3)
        device.set_speed, device.spin_up_s = hundredths, spin_up_s
        device.receive(SCAN, BEGIN)
        data, now = [], BEGIN
        while now < BEGIN + S:
            now = min(now + step, BEGIN + S)
            data.append(device.transmit(now))
        return b"".join(data)

    data = run(S)
    assert len(data) > 30_000 - 45_000 * spin_up_s
    for step in (MS // 10, 2 * MS, 7 * MS + 1, 333 * MS):
        assert run(step) == data


def test_waking_up_as_told_misses_nothing(device: Simulated4Ros) -> None:
    device.spin_up_s = 0.1
    device.receive(SCAN, BEGIN)
    data, now = b"", BEGIN
    while now < BEGIN + S:
        due = device.wakeup(now)
        assert due is not None
        assert due >= now
        now = max(due, now + 1)
        data += device.transmit(now)
    other = make_simulated("ydlidar-4ros", world=make_world("circle"))
    other.spin_up_s = 0.1
    other.receive(SCAN, BEGIN)
    assert data == other.transmit(now)


@pytest.mark.parametrize("spin_up_s", [0.0, 0.5, 2.5])
def test_the_header_comes_at_once_and_the_first_packet_after_spin_up(
    device: Simulated4Ros, spin_up_s: float
) -> None:
    device.spin_up_s = spin_up_s
    ready = BEGIN + int(spin_up_s * S)
    device.receive(SCAN, BEGIN)
    assert device.scanning
    assert device.motor_on
    assert device.transmit(BEGIN + MS) == SCAN_HEADER
    assert device.transmit(max(ready, BEGIN + MS)) == b""
    assert len(whole(device.transmit(ready + 12 * MS))) in (4, 5)


@pytest.mark.parametrize("stop", [STOP, FORCED_STOP, FORCED_STOP + STOP])
def test_a_stop_ends_the_stream_and_the_motor_after_the_packet_under_way(
    device: Simulated4Ros, stop: bytes
) -> None:
    data = stream_of(device, 1.0)
    device.receive(stop, BEGIN + S)
    assert all(entry.obeyed for entry in device.log)
    assert not device.scanning
    assert not device.motor_on
    data += device.transmit(BEGIN + 2 * S)
    assert ydlidar.split(data)
    assert len(data) < 45_300
    assert device.wakeup(BEGIN + 2 * S) is None


@pytest.mark.parametrize("request_", [INFO, HEALTH, OFFSET, SPEED, FASTER, SLOWER_FINE, PROTECTION, RESET])
def test_nothing_else_is_heard_while_scanning(device: Simulated4Ros, request_: bytes) -> None:
    device.spin_up_s = 0.2
    device.receive(SCAN, BEGIN)
    for now in (BEGIN + 100 * MS, BEGIN + S):
        device.receive(request_, now)
        assert why(device) == "scanning"
    assert (device.set_speed, device.protected) == (700, False)
    assert whole(device.transmit(BEGIN + 2 * S)[7:])


def test_a_repeated_scan_is_not_answered(device: Simulated4Ros) -> None:
    data = stream_of(device, 0.5)
    device.receive(SCAN, BEGIN + S // 2)
    assert why(device) == ""
    data += device.transmit(BEGIN + S)
    assert SCAN_HEADER not in data
    turning = [packet for packet in whole(data) if ydlidar.is_start(packet)]
    assert len(turning) in (6, 7)


def test_requests_right_after_a_stop_are_discarded(device: Simulated4Ros) -> None:
    device.receive(STOP, BEGIN)
    assert asked(device, INFO, BEGIN + 4 * MS) == b""
    assert why(device) == "within 5 ms of stop"
    assert asked(device, INFO, BEGIN + 20 * MS) != b""


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


def test_a_late_look_at_a_lapsed_scan_finds_what_was_sent_before(device: Simulated4Ros) -> None:
    asked(device, PROTECTION, BEGIN - S)
    device.spin_up_s = 0.0
    device.receive(SCAN, BEGIN)
    data = device.transmit(BEGIN + 60 * S)
    assert len(data) == pytest.approx(3 * 45_100, rel=0.01)
    assert ydlidar.split(data[7:])


def test_without_protection_it_scans_for_ever(device: Simulated4Ros) -> None:
    stream_of(device, 1.0)
    assert device.transmit(BEGIN + 60 * S)
    assert device.scanning


def test_a_reset(device: Simulated4Ros) -> None:
    asked(device, PROTECTION, BEGIN - 2 * S)
    asked(device, FASTER, BEGIN - S)
    stream_of(device, 1.0)
    device.receive(STOP, BEGIN + S - 10 * MS)
    device.transmit(BEGIN + S - MS)
    device.receive(RESET, BEGIN + S)
    assert not device.scanning
    assert not device.motor_on
    assert device.transmit(BEGIN + S + 999 * MS) == b""
    for request in (INFO, STOP):
        assert asked(device, request, BEGIN + S + 500 * MS) == b""
        assert why(device) == "still booting after reset"
    info = device.transmit(BEGIN + 3 * S)
    assert info[:8] == bytes.fromhex("A55A1400000004 65")
    assert asked(device, INFO, BEGIN + 4 * S) == info
    assert (device.set_speed, device.protected) == (700, False)


def test_protection_outlives_the_program_that_switched_it_on() -> None:
    """It is a state of the device: the next connection finds it on, and only a reset makes it forget."""
    device = make_simulated("ydlidar-4ros", world=make_world("circle"))
    device.spin_up_s = 0.0
    first = MemoryLine(device)
    first.write(PROTECTION, BEGIN)
    assert first.read(BEGIN + 10 * MS)[-1] == 0
    second = MemoryLine(device)
    second.write(SCAN, BEGIN + S)
    assert len(second.read(BEGIN + 60 * S)) == pytest.approx(3 * 45_100, rel=0.01)
    assert (device.scanning, device.lapses) == (False, 1)
    second.write(RESET, BEGIN + 61 * S)
    second.read(BEGIN + 63 * S)
    second.write(SCAN, BEGIN + 63 * S)
    assert len(second.read(BEGIN + 73 * S)) == pytest.approx(10 * 45_100, rel=0.01)


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


def test_a_fault(device: Simulated4Ros) -> None:
    stream_of(device, 1.0)
    device.protection_stop(7)
    assert not device.scanning
    device.transmit(BEGIN + 2 * S)
    assert asked(device, SCAN, BEGIN + 2 * S) == b""
    assert why(device) == "in protection stop"
    assert asked(device, HEALTH, BEGIN + 3 * S)[7:] == b"\x02\x07\x00"
    device.faults_cleared_by_reset = False
    device.receive(RESET, BEGIN + 4 * S)
    device.transmit(BEGIN + 6 * S)
    assert asked(device, HEALTH, BEGIN + 6 * S)[7:] == b"\x02\x07\x00"
    device.faults_cleared_by_reset = True
    device.receive(RESET, BEGIN + 7 * S)
    device.transmit(BEGIN + 9 * S)
    assert asked(device, HEALTH, BEGIN + 9 * S)[7:] == b"\x00\x00\x00"


def test_left_streaming_by_somebody_else(device: Simulated4Ros) -> None:
    device.begin_streaming(BEGIN)
    assert device.scanning
    assert device.motor_on
    data = device.transmit(BEGIN + S)
    assert not data.startswith((b"\xaa\x55", b"\xa5\x5a"))
    assert len(data) == pytest.approx(45_100, rel=0.01)
    assert len(whole(data[data.index(b"\xaa\x55") :])) > 500


def test_mute_and_garbled(device: Simulated4Ros) -> None:
    device.garble_responses = 1
    garbled = asked(device, INFO, BEGIN)
    assert len(garbled) == 27
    assert not garbled.startswith(b"\xa5\x5a")
    device.mute = True
    assert asked(device, INFO, BEGIN + S) == b""
    device.mute = False
    assert device.transmit(BEGIN + 2 * S) == b""
    assert asked(device, INFO, BEGIN + 3 * S)[:2] == b"\xa5\x5a"


def test_seeds_and_serials() -> None:
    def info(seed: int = 0, serial: bytes | str | None = None) -> bytes:
        return asked(make_simulated("ydlidar-4ros", seed=seed, serial=serial), INFO, BEGIN)

    assert info(1) == info(1) != info(2)
    assert max(info(1)[11:]) <= 9
    assert info(serial="9" * 16)[11:] == b"\x09" * 16
    assert info(serial=bytes(range(8)) * 2)[11:] == bytes(range(8)) * 2
    assert info(serial=bytes.fromhex("1234567812345678"))[11:] == bytes([1, 2, 3, 4, 5, 6, 7, 8] * 2)
    for wrong in ("123", "x" * 16, b"\x0a" * 16, bytes.fromhex("AA" * 8)):
        with pytest.raises(ValueError, match="16 digits"):
            make_simulated("ydlidar-4ros", serial=wrong)


def test_every_profile_scans() -> None:
    for model in PROFILES:
        device = make_simulated(model)
        device.receive(SCAN, BEGIN)
        data = device.transmit(BEGIN + 3 * S)
        if PROFILES[model].stamps:
            assert unstamped(data[7:])[1]
            continue
        size = PROFILES[model].layout.size
        # One that only talks is heard from anywhere on, and the last packet may be under way.
        begin = data.find(b"\xaa\x55") if PROFILES[model].one_way else 7
        places = [begin]
        while places[-1] + 4 <= len(data):
            assert data[places[-1] : places[-1] + 2] == b"\xaa\x55"
            places.append(places[-1] + 10 + size * data[places[-1] + 3])
        packets = ydlidar.split(data[begin : places[-2]], ydlidar.Kind(sample_bytes=size))
        assert len(packets) > 20
    with pytest.raises(ValueError, match="no simulated device"):
        make_simulated("ydlidar-x5")


def test_packers_agree_with_the_reference() -> None:
    raw = pack_points([[1, 0, 70_000], [4, 5, 6]], [100, 23039], [140, 20], control=0)
    packets = ydlidar.split(raw)
    assert [s.distance_mm for s in ydlidar.decode(packets)] == [1, 0, 0, 4, 5, 6]
    assert [s.raw_deg * 64 for s in ydlidar.decode(packets)] == [100, 120, 140, 23039, 23049.5, 23060]
    stamp = pack_time_stamp(0x01020304)
    assert stamp[:2] == b"\xaa\x66"
    assert stamp[3:7] == b"\x04\x03\x02\x01"
    assert stamp[2] == 0xAA ^ 0x66 ^ 1 ^ 2 ^ 3 ^ 4
