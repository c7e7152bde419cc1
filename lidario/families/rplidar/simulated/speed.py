"""The device side of another line speed: it measures how fast the host writes.

More than 100 bytes of 0x41 within a second are measured; the response is what was measured (vendor's SDK 2.1.0).
Without a confirmation the device has the speed before again. Where no document says it, the choice is ours: the
measured speed is 0.1 % too high, the response leaves at the new speed, the confirmation must come within a second,
a RESET keeps the new speed, and a loss of power does not.
"""

from __future__ import annotations

import struct

_PATTERN = 0x41
_ENOUGH = 100
_SECOND = 1_000_000_000
_FLAG = 0x5F5F
_TOLERANCE = 0.05


class LineSpeed:
    """The speed of the device's end of the line.

    Args:
        baudrate: The speed after power-up.

    Attributes:
        now: The speed at which it sends and receives.
        host: The speed of the host's port, where that is known.
    """

    def __init__(self, baudrate: int) -> None:
        self.now: int = baudrate
        self.host: int | None = None
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
