"""What goes wrong with a simulated device and with its bytes on their way to the host, and when.

A *line fault* changes bytes; the device knows nothing of it. A *device fault* is an event in the device's own life:
it restarts, freezes, stops to protect itself. `MemoryLine` first lets the device send what has left it by the time
of the event, and then calls `Faults.strike`, so the bytes do not depend on how often the device is asked for bytes.

One line fault at most begins at a byte. What happens to each byte is drawn in the order of the bytes from a seeded
generator, so the outcome does not depend on how the bytes were divided into chunks.

Users write a list like ``drop:1%,flip:0.1%,unplug:5s``. A share is per byte, or per response. All durations but
those of ``late`` and ``stall`` count from the first byte on the line, either way.
"""

import re
from collections import deque
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal, NamedTuple, TypeGuard

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

    `FAULTS` says what each of them does. Shares are from 0 to 1, and what ends with ``_s`` is in
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
        times = [self._under_way[0][0]] if self._under_way else []
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


class Fault(NamedTuple):
    """One word of the list: how it is written, what its value is, and what it does."""

    example: str
    takes: Literal["nothing", "a share", "a duration", "a number of bytes"]
    what: str


FAULTS = {
    fault.example.partition(":")[0]: fault
    for fault in (
        Fault("drop:1%", "a share", "this share of the bytes is lost"),
        Fault("flip:0.1%", "a share", "one bit is inverted in this share of the bytes"),
        Fault("insert:0.1%", "a share", "a random byte is inserted before this share of the bytes"),
        Fault("burst:0.01%", "a share", "64 bytes become random; the share is that of the first bytes"),
        Fault("duplicate:0.01%", "a share", "64 bytes come a second time; the share is as for burst"),
        Fault(
            "babble:1000",
            "a number of bytes",
            "so many random bytes a second are added, also while the device is silent",
        ),
        Fault("garbage", "nothing", "every byte is random, as at a wrong baud rate"),
        Fault("late:300ms", "a duration", "every byte arrives so much later"),
        Fault(
            "stall:200ms", "a duration", "once a second the bytes are held back so long; then they come all at once"
        ),
        Fault("silent:5s", "a duration", "from then on nothing arrives, though the port stays open"),
        Fault("unplug:5s", "a duration", "from then on the port is dead"),
        Fault(
            "replug:5s", "a duration", "the port dies; 1 s later it is back with another name, and the device boots"
        ),
        Fault("reboot:5s", "a duration", "the device restarts by itself, once"),
        Fault("freeze:5s", "a duration", "the device sends nothing and obeys nothing until it loses its power"),
        Fault("protect:5s", "a duration", "the device stops to protect itself, and health reports an error"),
        Fault(
            "wrong-response:20%",
            "a share",
            "instead of this share of the responses the device repeats the one before",
        ),
    )
}
"""Every fault by its name."""

_UNITS: dict[str, dict[str, float]] = {
    "a share": {"%": 0.01, "": 1.0},
    "a duration": {"ms": 1e-3, "s": 1.0, "min": 60.0, "": 1.0},
    "a number of bytes": {"": 1.0},
}


def parse_faults(text: str, *, seed: int = 0) -> Faults:
    """Read a list of faults such as ``"drop:1%,unplug:5s"``; an empty one means none.

    Raises:
        ValueError: The text makes no sense; says why, and which faults there are.
    """
    found: dict[str, float | bool] = {}
    for word in filter(None, (part.strip() for part in text.split(","))):
        name, _, value = word.partition(":")
        if name not in FAULTS:
            raise ValueError(f"no fault is called {_begin(name)}; there are {', '.join(FAULTS)}")
        field = name.replace("-", "_") + ("_s" if FAULTS[name].takes == "a duration" else "")
        if field in found:
            raise ValueError(f"the fault {_begin(name)} is given twice")
        found[field] = _value(word, name, value)
    try:
        return Faults(seed=seed, **found)  # type: ignore[arg-type]
    except ValueError as error:
        raise ValueError(f"{_begin(text)}: {error}") from None


def _value(word: str, name: str, text: str) -> float | bool:
    """The value behind the colon; True for a fault that takes none."""
    fault = FAULTS[name]
    if fault.takes == "nothing" and not text:
        return True
    units = _UNITS.get(fault.takes, {})
    match = re.fullmatch(r"(\d+\.?\d*|\.\d+)([a-z%]*)", text.strip())
    if match is None or match[2] not in units:
        raise ValueError(
            f"{_begin(word)} cannot be read: {name} takes {fault.takes}, as in {fault.example}; "
            f"the faults are {', '.join(FAULTS)}"
        )
    return float(match[1]) * units[match[2]]


def _begin(text: str) -> str:
    """A user's word in quotes, for an error text: its first 80 characters."""
    return repr(text[:80])
