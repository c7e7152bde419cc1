"""Changes the speed of the serial line: the device measures how fast the host writes.

The host writes ``41`` at the new speed, more than 100 bytes a second, for 1.5 s at most. The bits of this byte
alternate, so the device can measure their length. It responds with the measured speed, in four bytes without a
descriptor. Then the host confirms. Without a confirmation the device goes back to the old speed (vendor's SDK
2.1.0, `negotiateSerialBaudRate`). Firmware can do it from 1.30 on. It is assumed that the C and S series can, too,
whose firmware counts from 1.01. No document says whether the speed outlasts a restart.

It is never used while a port is probed: devices of other families would take the bytes for a request that never
ends.
"""

import re
import struct
from typing import Final

from lidario.errors import ResponseTimeout, Unsupported
from lidario.families.base import Script
from lidario.families.rplidar import commands
from lidario.wire.envelope import Expected, Request, encode_request
from lidario.wire.events import Packets
from lidario.wire.formats import Headings, StreamFormat

TOLERANCE: Final = 0.05  # The device does not measure exactly. A serial line tolerates an error of 5 % at most.


class MeasuredSpeed(StreamFormat):
    """The response to `measure`: one word, which must be near the requested speed."""

    name = "measured speed"
    response_type = 0x41
    header: re.Pattern[bytes] = re.compile(b".", re.DOTALL)
    shortest = longest = 4
    samples = 0
    full_turn = 1
    self_evident = True

    def __init__(self, baudrate: int) -> None:
        super().__init__()
        self._baudrate = baudrate

    def measure(self, data: bytearray, at: int) -> int:
        return 4 if len(data) - at >= 4 else 0

    def intact(self, data: bytearray, at: int, size: int) -> bool:
        told = int.from_bytes(data[at : at + size], "little")
        return abs(told - self._baudrate) <= TOLERANCE * self._baudrate

    def headings(self, packets: Packets) -> Headings:  # noqa: ARG002
        return ()  # it belongs to no revolution


def measure(baudrate: int) -> Request:
    """The request that sets the port to that speed and lets the device measure it."""
    wire = MeasuredSpeed(baudrate)
    expected = Expected(wire.response_type, wire.shortest)
    # It is repeated for 1.5 s: 320 bytes a second; more than 100 are demanded.
    return Request(
        "speed to be measured", b"A" * 16, expected, 0.05, attempts=30, stream=wire, packets=1, baudrate=baudrate
    )


def confirm(baudrate: int) -> Request:
    """NEW_BAUDRATE_CONFIRM: the device keeps the speed. It has no response."""
    payload = struct.pack("<HIH", 0x5F5F, baudrate, 0)
    # No document demands a pause.
    return Request("NEW_BAUDRATE_CONFIRM", encode_request(0x90, payload), settle=commands.SETTLE_S)


def change_speed(baudrate: int, present: int) -> Script[None]:
    """As `Device.set_baudrate`; raises Unsupported if the device does not follow."""
    yield commands.STOP
    try:
        yield measure(baudrate)
    except ResponseTimeout as error:
        raise Unsupported(
            f"this device did not respond at {baudrate} baud: its speed cannot be changed, and stays {present}"
        ) from error
    yield confirm(baudrate)
