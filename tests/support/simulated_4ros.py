"""A simulated 4ROS by itself: requests as bytes, and what comes back; or scripts, with a clock moved by hand."""

from functools import reduce
from operator import xor
from typing import TypeVar

from lidario.families.base import Script
from lidario.families.ydlidar.device import YdlidarDevice
from lidario.families.ydlidar.simulated.device import Simulated4Ros
from lidario.families.ydlidar.simulated.packers import SCAN_HEADER
from lidario.wire.envelope import DESCRIPTOR_SIZE, Request
from tests.reference import ydlidar
from tests.support.scripts import played

MS = 1_000_000
S = 1000 * MS
BEGIN = 5 * S
SCAN, STOP, FORCED_STOP, RESET = b"\xa5\x60", b"\xa5\x65", b"\xa5\x00", b"\xa5\x80"
INFO, HEALTH, HEALTH_92, OFFSET, SPEED = b"\xa5\x90", b"\xa5\x91", b"\xa5\x92", b"\xa5\x93", b"\xa5\x0d"
FASTER_FINE, SLOWER_FINE, FASTER, SLOWER = b"\xa5\x09", b"\xa5\x0a", b"\xa5\x0b", b"\xa5\x0c"
PROTECTION = b"\xa5\xd9"
STAMPED = "ydlidar-4ros-stamps"


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


def whole(data: bytes, kind: ydlidar.Kind = ydlidar.FOUR_ROS) -> list[bytes]:
    """The packets of a stream, less the one under way at its end."""
    while data:
        try:
            return ydlidar.split(data, kind)
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


T = TypeVar("T")


class Bench:
    """Host and simulated device on one table."""

    def __init__(self, simulated: Simulated4Ros) -> None:
        self.simulated = simulated
        self.device = YdlidarDevice()
        self.now = 10**9

    def pass_time(self, seconds: float) -> bytes:
        """What comes meanwhile."""
        self.now += round(seconds * 1e9)
        return self.simulated.transmit(self.now)

    def ask(self, request: Request) -> bytes | None:
        """The response, without its descriptor; None where none comes."""
        for _ in range(request.attempts):
            self.simulated.receive(request.data, self.now)
            if request.expects is None:
                self.pass_time(request.settle)
                return b""
            told, deadline = b"", self.now + round(request.timeout * 1e9)
            while len(told) < DESCRIPTOR_SIZE + request.expects.size and self.now < deadline:
                told += self.pass_time(0.001)
            if told:
                return told[DESCRIPTOR_SIZE:]
        return None

    def run(self, script: Script[T]) -> T:
        return played(script, self.ask)
