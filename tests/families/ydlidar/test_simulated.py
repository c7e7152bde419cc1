"""The simulated 4ROS by itself: what it responds, what it discards, and what a reset or a fault leaves."""

import pytest

from lidario.families.ydlidar.simulated.device import Simulated4Ros, make_simulated
from lidario.families.ydlidar.simulated.packers import SCAN_HEADER
from tests.reference import ydlidar
from tests.support.simulated_4ros import (
    BEGIN,
    FASTER,
    FASTER_FINE,
    HEALTH,
    HEALTH_92,
    INFO,
    MS,
    OFFSET,
    PROTECTION,
    RESET,
    SCAN,
    SLOWER,
    SLOWER_FINE,
    SPEED,
    STOP,
    S,
    asked,
    set_hundredths,
    stream_of,
    whole,
    why,
)

pytestmark = pytest.mark.discards("what the simulated device discards is tested here")


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
    assert device.transmit(BEGIN + 3 * S) == b""
    assert asked(device, INFO, BEGIN + 4 * S)[:8] == bytes.fromhex("A55A1400000004 65")
    assert (device.set_speed, device.protected) == (700, False)


def test_some_tell_unasked_what_they_are_after_a_reset() -> None:
    device = make_simulated("ydlidar-4ros-92")
    device.receive(RESET, BEGIN)
    told = device.transmit(BEGIN + 3 * S)
    assert told == asked(device, INFO, BEGIN + 4 * S) != b""


def test_seeds_and_serials() -> None:
    def info(seed: int = 0, serial: bytes | None = None) -> bytes:
        return asked(make_simulated("ydlidar-4ros", seed=seed, serial=serial), INFO, BEGIN)

    assert info(1) == info(1) != info(2)
    assert max(info(1)[11:]) <= 9
    assert info(serial=b"\x99" * 8)[11:] == b"\x09" * 16
    assert info(serial=bytes(range(8)) * 2)[11:] == bytes(range(8)) * 2
    assert info(serial=bytes.fromhex("1234567812345678"))[11:] == bytes([1, 2, 3, 4, 5, 6, 7, 8] * 2)
    for wrong in (b"123", b"x" * 16, b"\x0a" * 16, bytes.fromhex("AA" * 8)):
        with pytest.raises(ValueError, match="16 digits"):
            make_simulated("ydlidar-4ros", serial=wrong)
