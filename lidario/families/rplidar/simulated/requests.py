"""What the device hears: whole requests, read as strictly as the real one does, and how fast the host writes.

A request is ``A5 cmd``, or ``A5 cmd len payload xor`` when bit 7 of the command is set (S-series interface
manual, request packets; the bit rule from vendor SDK 2.1.0). It must be complete within five seconds of its
first byte. What does not begin with A5 is noise and forgotten. An incomplete request (of a host that was
killed) takes the bytes that follow as its own, as its length byte demands; the real device does the same.

Another speed of the line is measured. More than 100 bytes of 0x41 within a second are measured; the response is
what was measured (vendor's SDK 2.1.0). Without a confirmation the device has the speed before again. Where no
document says it, the choice is ours: the measured speed is 0.1 % too high, the response leaves at the new speed,
the confirmation must come within a second, a RESET keeps the new speed, and a loss of power does not.
"""

import struct
from dataclasses import dataclass
from functools import reduce
from operator import xor

_SYNC = 0xA5
_COMPLETE_WITHIN_NS = 5_000_000_000  # S-series interface manual, request packets

_PATTERN = 0x41
_ENOUGH = 100
_SECOND = 1_000_000_000
_FLAG = 0x5F5F
_TOLERANCE = 0.05

# Command -> the documents' name, and bytes of payload, at least these of GET_LIDAR_CONF (S-series interface manual,
# request formats). Those from HQ_SCAN down are the vendor's SDK 2.1.0's; some models know some of them.
COMMANDS = {
    0x25: ("stop", 0),
    0x40: ("reset", 0),
    0x20: ("scan", 0),
    0x21: ("force_scan", 0),
    0x82: ("express_scan", 5),
    0x50: ("get_info", 0),
    0x52: ("get_health", 0),
    0x59: ("get_samplerate", 0),
    0x84: ("get_lidar_conf", 4),
    0xA8: ("motor_speed_ctrl", 2),
    0x83: ("hq_scan", 33),
    0x85: ("set_lidar_conf", 16),
    0x90: ("new_baudrate_confirm", 8),
    0xF0: ("set_motor_pwm", 2),
    0xFF: ("get_acc_board_flag", 4),
}
PAYLOADS = dict(COMMANDS.values())
# S-series interface manual, states of the device; it names STOP and SCAN, and the other scans have the same states.
IGNORED_IN_PROTECTION_STOP = {"stop", "scan", "force_scan", "express_scan", "hq_scan"}


@dataclass(frozen=True, slots=True)
class Request:
    """One request as it arrived."""

    name: str  # the documents' name, or ``"unknown"``
    payload: bytes  # its payload; empty for the short form
    data: bytes  # all its bytes
    began: int  # when its first byte arrived
    ended: int  # when its last byte arrived
    fault: str = ""  # what is wrong with its form; empty when nothing is


class RequestReader:
    """Collects bytes into requests; times are nanoseconds that never go back."""

    def __init__(self) -> None:
        self._bytes = bytearray()
        self._began = 0
        self._last = 0

    def clear(self) -> None:
        """Forget a request that has begun."""
        self._bytes.clear()

    def overdue(self, now: int) -> Request | None:
        """Give up a request that is not complete in time, and tell of it."""
        if not self._bytes or now - self._began <= _COMPLETE_WITHIN_NS:
            return None
        data = bytes(self._bytes)
        self._bytes.clear()
        return Request(_name(data), b"", data, self._began, self._last, "not complete within 5 s")

    def feed(self, byte: int, now: int) -> Request | None:
        """Take one byte; the request, if this was its last."""
        request = self._bytes
        self._last = now
        if not request:
            if byte == _SYNC:
                request.append(byte)
                self._began = now
            return None
        if len(request) == 1 and byte == _SYNC:
            self._began = now  # no command is A5: the first one was noise
            return None
        request.append(byte)
        if len(request) < self._length():
            return None
        data = bytes(request)
        request.clear()
        fault = "wrong checksum" if len(data) > 2 and reduce(xor, data) else ""
        return Request(_name(data), data[3:-1], data, self._began, now, fault)

    def _length(self) -> int:
        """Bytes of the request that has begun, as far as can be told yet."""
        request = self._bytes
        if not request[1] & 0x80:
            return 2
        return 4 + request[2] if len(request) > 2 else 3 + 1


def _name(data: bytes) -> str:
    return COMMANDS[data[1]][0] if len(data) > 1 and data[1] in COMMANDS else "unknown"


class LineSpeed:
    """The speed of the device's end of the line, `baudrate` after power-up."""

    def __init__(self, baudrate: int) -> None:
        self.now: int = baudrate  # at which it sends and receives
        self.host: int | None = None  # that of the host's port, where it is known
        self._at_power_up = baudrate
        self._before = baudrate
        self._heard: list[int] = []
        self._confirm_by: int | None = None

    @property
    def is_garbled(self) -> bool:
        """Whether the two ends run at different speeds."""
        return self.host is not None and self.host != self.now

    def hear(self, data: bytes, now: int) -> bytes:
        """Measure what the host writes; the response, if this completes the measurement."""
        if self.host is None:
            return b""
        self._heard = [at for at in self._heard if now - at < _SECOND] + [now] * data.count(_PATTERN)
        if data.strip(bytes((_PATTERN,))):
            self._heard.clear()
        if len(self._heard) <= _ENOUGH:
            return b""
        self._heard.clear()
        if self._confirm_by is None:
            self._before = self.now
        self.now = self.host
        self._confirm_by = now + _SECOND
        return struct.pack("<I", round(self.host * 1.001))

    def confirm(self, payload: bytes) -> str:
        """Keep the new speed; else why the confirmation is discarded."""
        flag, baudrate, _ = struct.unpack("<HIH", payload)
        if self._confirm_by is None:
            return "no speed was measured"
        if flag != _FLAG or abs(baudrate - self.now) > _TOLERANCE * self.now:
            return "not the speed that was measured"
        self._confirm_by = None
        return ""

    def advance(self, now: int) -> None:
        """Take the speed before again, where the new one was not confirmed in time."""
        if self._confirm_by is not None and now >= self._confirm_by:
            self.now, self._confirm_by = self._before, None

    def lose_power(self) -> None:
        """Be as after power-up."""
        self.now, self._confirm_by = self._at_power_up, None
