"""What goes wrong with a simulated device and with its bytes on their way to the host, and when.

A *line fault* changes bytes; the device knows nothing of it. A *device fault* is an event in the device's own life:
it restarts, freezes, stops to protect itself. `MemoryLine` first lets the device send what has left it by the time
of the event, and then calls `Faults.strike`, so the bytes do not depend on how often the device is asked for bytes.

One line fault at most begins at a byte. What happens to each byte is drawn in the order of the bytes from a seeded
generator, so the outcome does not depend on how the bytes were divided into chunks.
"""

from collections import deque
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, TypeGuard

import numpy as np

if TYPE_CHECKING:
    from lidario.sim.chassis import Chassis

ERROR_CODE = 0x8001  # what health tells after the fault ``protect``; no document gives a meaning to any code
REPLUG_GAP_S = 1.0  # seconds without a cable, and so without power, in the fault ``replug``
_SECOND = 1_000_000_000
_BLOCK = 64  # bytes of a burst or a repetition: the packet of a full-speed USB adapter
_BYTE_FAULTS = ("drop", "flip", "insert", "burst", "duplicate")


def can_fail(device: object) -> "TypeGuard[Chassis[Any, Any]]":
    """Whether device faults can happen in it; also in one behind an object that passes on what it is asked for."""
    return hasattr(device, "protection_stop")


@dataclass
class Faults:
    """Faults of one line and of the device behind it, and how far they have got; a line needs one of its own.

    `lidario.sim.faults.FAULTS` says what each of them does. Shares are from 0 to 1, and what ends with ``_s`` is in
    seconds from the first byte on the line; 0 and None are never. `seed` is that of everything random.

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
    reboot_s: float | None = None
    freeze_s: float | None = None
    protect_s: float | None = None
    wrong_response: float = 0.0
    seed: int = 0

    def __post_init__(self) -> None:
        shares = [getattr(self, each) for each in _BYTE_FAULTS]
        if min(shares) < 0.0 or sum(shares) > 1.0:
            raise ValueError(
                "drop, flip, insert, burst and duplicate are shares from 0 to 100 %, together no more than 100 %"
            )
        if not 0.0 <= self.wrong_response <= 1.0:
            raise ValueError("wrong-response is a share from 0 to 100 %")
        if not 0.0 <= self.stall_s < 1.0:
            raise ValueError("a stall lasts less than the second after which it comes again")
        if self.babble and not self.babble >= 1.0:
            raise ValueError("babble is at least one byte a second")
        self._edges = np.cumsum(shares)
        self._choices, self._detail, self._noise = (np.random.default_rng([self.seed, each]) for each in (1, 2, 3))
        self._first: int | None = None
        self._events: list[tuple[int, str]] = []
        self._burst_left = 0
        self._past = b""
        self._babble_from: int | None = None
        self._babbled = 0
        self._held = bytearray()
        self._under_way: deque[tuple[int, bytes]] = deque()

    def begin(self, now: int) -> None:
        """Begin to count the time, at the first byte on the line; later calls change nothing."""
        if self._first is None:
            self._first = now
            wanted = {name: getattr(self, f"{name}_s") for name in ("protect", "reboot", "replug", "freeze")}
            found = [(now + round(each * _SECOND), name) for name, each in wanted.items() if each is not None]
            self._events = sorted(found, key=lambda event: event[0])

    def check(self, device: object) -> None:
        """Prepare a device.

        Raises:
            ValueError: A device fault is wanted, and the device offers none.
        """
        wanted = (self.reboot_s, self.freeze_s, self.protect_s, self.wrong_response or None)
        if can_fail(device):
            device.wrong_responses = self.wrong_response
        elif any(each is not None for each in wanted):
            raise ValueError(f"a {type(device).__name__} offers no faults of its own, only faults of the line")

    @property
    def next_at(self) -> int | None:
        """When the next event of the device is due; None with none ahead."""
        return self._events[0][0] if self._events else None

    def strike(self, device: object) -> None:
        """Let the next event happen; the device must have sent what left it before `next_at`."""
        at, name = self._events.pop(0)
        if not can_fail(device):
            return  # `check` has let pass a replug, which such a device survives as it is
        if name == "reboot":
            device.reboot(at)
        elif name == "replug":
            device.reboot(at, off_s=REPLUG_GAP_S)
        elif name == "freeze":
            device.freeze(at)
        else:
            device.protection_stop(ERROR_CODE)

    def apply(self, data: bytes, now: int) -> bytes:
        """What arrives at the host by `now` when the device has just sent `data`, in any chunks, possibly none."""
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
        """When `apply` must be called though the device sends nothing: something comes, or the cable goes."""
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
        if not self._edges[-1]:
            return data
        choices = np.searchsorted(self._edges, self._choices.random(len(data)), side="right")
        past = self._past + data  # a byte of `data` stands at its own place plus the length of the past
        parts = [self._in_burst(data, 0)]
        done = len(parts[0])
        for at in np.flatnonzero(choices < self._edges.size).tolist():
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
