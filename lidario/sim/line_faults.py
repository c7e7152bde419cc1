"""What can go wrong on the way of a simulated device's bytes to the host.

The device knows nothing of these faults; its own are in `lidario.sim.device_faults`, the words for both in
`lidario.sim.faults`.

One fault at most begins at a byte. What happens to each byte is drawn in the order of the bytes from a seeded
generator, so the outcome does not depend on how the bytes were divided into chunks.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field

import numpy as np

from lidario.sim.device_faults import REPLUG_GAP_S, DeviceFaults

_SECOND = 1_000_000_000
_BLOCK = 64  # bytes of a burst or a repetition: the packet of a full-speed USB adapter
_BYTE_FAULTS = ("drop", "flip", "insert", "burst", "duplicate")


@dataclass(slots=True)
class Faults:
    """Faults of one line and of the device behind it, and how far they have got; a line needs one of its own.

    `lidario.sim.faults.FAULTS` says what each of them does. Shares are from 0 to 1, and what ends with ``_s`` is in
    seconds; 0 and None are never.

    Attributes:
        device: Faults of the device; its `replug_s` is set here.
        seed: Seed of everything random.

    Raises:
        ValueError: A number is out of range.
    """

    drop: float = 0.0
    flip: float = 0.0
    insert: float = 0.0
    burst: float = 0.0
    duplicate: float = 0.0
    babble: float = 0.0
    garbage: bool = False
    late_s: float = 0.0
    stall_s: float = 0.0
    silent_s: float | None = None
    unplug_s: float | None = None
    replug_s: float | None = None
    device: DeviceFaults = field(default_factory=DeviceFaults)
    seed: int = 0
    _choices: np.random.Generator = field(init=False, compare=False, repr=False)
    _detail: np.random.Generator = field(init=False, compare=False, repr=False)
    _noise: np.random.Generator = field(init=False, compare=False, repr=False)
    _first: int | None = field(init=False, compare=False, default=None)
    _burst_left: int = field(init=False, compare=False, default=0, repr=False)
    _past: bytes = field(init=False, compare=False, default=b"", repr=False)
    _babble_from: int | None = field(init=False, compare=False, default=None, repr=False)
    _babbled: int = field(init=False, compare=False, default=0, repr=False)
    _held: bytearray = field(init=False, compare=False, default_factory=bytearray, repr=False)
    _under_way: deque[tuple[int, bytes]] = field(init=False, compare=False, default_factory=deque, repr=False)

    def __post_init__(self) -> None:
        shares = (self.drop, self.flip, self.insert, self.burst, self.duplicate)
        if min(shares) < 0.0 or sum(shares) > 1.0:
            raise ValueError(
                "drop, flip, insert, burst and duplicate are shares from 0 to 100 %, together no more than 100 %"
            )
        if not 0.0 <= self.stall_s < 1.0:
            raise ValueError("a stall lasts less than the second after which it comes again")
        if self.babble and not self.babble >= 1.0:
            raise ValueError("babble is at least one byte a second")
        self._choices = np.random.default_rng([self.seed, 1])
        self._detail = np.random.default_rng([self.seed, 2])
        self._noise = np.random.default_rng([self.seed, 3])
        self.device.replug_s = self.replug_s

    def begin(self, now: int) -> None:
        """Begin to count the time, at the first byte on the line; later calls change nothing."""
        if self._first is None:
            self._first = now
            self.device.begin(now)

    def apply(self, data: bytes, now: int) -> bytes:
        """What arrives at the host by `now` when the device has just sent `data`.

        Args:
            data: The device's bytes, in any chunks, possibly none.
            now: Monotonic nanoseconds; never go back.
        """
        if data:
            self.begin(now)
        if self.unplugged(now) or self._is_over(self.silent_s, now):
            self._held.clear()
            self._under_way.clear()
            self._babble_until(now)
            return b""
        data = self._babble_until(now) + self._damaged(data)
        if self.stall_s:
            data = self._stalled(data, now)
        if self.late_s:
            data = self._delayed(data, now)
        return data

    def wakeup(self, now: int) -> int | None:
        """When something comes, or the cable goes, without a new byte of the device; None = never.

        Then `apply` must be called, with or without new bytes.
        """
        times = [due for due, _ in list(self._under_way)[:1]]
        if self._babble_from is None:
            self._babble_from = now
        if self.babble:
            times.append(self._babble_from + -(-(self._babbled + 1) * _SECOND // round(self.babble)))
        if self._first is not None:
            if self._held:
                times.append(now + _SECOND - (now - self._first) % _SECOND)
            for seconds in (self.unplug_s, self.replug_s):
                if seconds is not None and not self._is_over(seconds, now):
                    times.append(self._first + round(seconds * _SECOND))
        return max(now, min(times)) if times else None

    def unplugged(self, now: int) -> bool:
        """Whether the cable is out at `now`."""
        back = self.back_at(now)
        return self._is_over(self.unplug_s, now) or (self.cable(now) > 0 and back is not None and now < back)

    def back_at(self, now: int) -> int | None:
        """When the cable is plugged in again after ``replug``.

        None where that is not wanted, while the time has not begun to count, and when the cable stays out.
        """
        if self.replug_s is None or self._first is None or self._is_over(self.unplug_s, now):
            return None
        return self._first + round((self.replug_s + REPLUG_GAP_S) * _SECOND)

    def cable(self, now: int) -> int:
        """How often the cable was pulled out for a replug by `now`."""
        return int(self._is_over(self.replug_s, now))

    def _is_over(self, seconds: float | None, now: int) -> bool:
        """Whether so many seconds have passed since the first byte; None is never."""
        return seconds is not None and self._since(now) >= seconds * _SECOND

    def _since(self, now: int) -> int:
        """Nanoseconds since the first byte; negative before it."""
        return -1 if self._first is None else now - self._first

    def _babble_until(self, now: int) -> bytes:
        """The random bytes that are due by `now` and did not come yet."""
        if not self.babble:
            return b""
        if self._babble_from is None:
            self._babble_from = now
        due = (now - self._babble_from) * round(self.babble) // _SECOND
        count, self._babbled = due - self._babbled, due
        return _random(self._noise, count)

    def _stalled(self, data: bytes, now: int) -> bytes:
        self._held += data
        if self._since(now) % _SECOND >= _SECOND - self.stall_s * _SECOND:
            return b""
        data = bytes(self._held)
        self._held.clear()
        return data

    def _delayed(self, data: bytes, now: int) -> bytes:
        if data:
            self._under_way.append((now + round(self.late_s * _SECOND), data))
        parts = []
        while self._under_way and self._under_way[0][0] <= now:
            parts.append(self._under_way.popleft()[1])
        return b"".join(parts)

    def _damaged(self, data: bytes) -> bytes:
        if not data:
            return data
        if self.garbage:
            return _random(self._choices, len(data))
        edges = np.cumsum([self.drop, self.flip, self.insert, self.burst, self.duplicate])
        if not edges[-1]:
            return data
        choices = np.searchsorted(edges, self._choices.random(len(data)), side="right")
        past = self._past + data  # a byte of `data` stands at its own place plus the length of the past
        parts = [self._in_burst(data, 0)]
        done = len(parts[0])
        for at in np.flatnonzero(choices < edges.size).tolist():
            if at < done:
                continue  # inside of a burst nothing else happens
            parts.append(data[done:at])
            done = at + 1
            what = _BYTE_FAULTS[choices[at]]
            if what == "flip":
                parts.append(bytes([data[at] ^ (1 << int(self._detail.random() * 8.0))]))
            elif what == "insert":
                parts.append(_random(self._detail, 1) + data[at:done])
            elif what == "duplicate":
                here = len(self._past) + at
                parts.append(past[max(0, here - _BLOCK) : here] + data[at:done])
            elif what == "burst":
                self._burst_left = _BLOCK
                parts.append(self._in_burst(data, at))
                done = at + len(parts[-1])
        parts.append(data[done:])
        self._past = past[-_BLOCK:]
        return b"".join(parts)

    def _in_burst(self, data: bytes, at: int) -> bytes:
        """The random bytes of the burst under way in place of those of `data` from `at` on."""
        count = min(self._burst_left, len(data) - at)
        self._burst_left -= count
        return _random(self._detail, count)


def _random(source: np.random.Generator, count: int) -> bytes:
    """Random bytes; the same ones however they are divided into calls, which `Generator.bytes` does not promise."""
    return (source.random(count) * 256.0).astype(np.uint8).tobytes()
