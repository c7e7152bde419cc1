"""What can go wrong on the way from the device to the host, in words and in bytes.

A list of faults is written as users type it: ``drop:1%,flip:0.1%,unplug:5s``. Probabilities are per byte, in
per cent or as a fraction; durations are ``5s``, ``200ms`` or plain seconds, counted from the first byte the
device sends.

=================  =====================================================================================
``drop:1%``        a byte is lost
``flip:0.1%``      one bit of a byte is inverted
``insert:0.1%``    a random byte comes before this one
``silent:5s``      from then on nothing arrives, though the port stays open
``unplug:5s``      from then on the port is dead
``stall:200ms``    once a second the bytes are held back for so long, and then come in one burst
``garbage``        every byte is random, as at a wrong baud rate
=================  =====================================================================================

One fault at most happens to a byte. What happens to each byte is drawn in the order of the bytes from a
seeded generator, so the outcome does not depend on how the bytes were divided into chunks.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, field

import numpy as np

__all__ = ["FAULTS", "Faults", "parse_faults"]

FAULTS = {
    "drop": "a share: drop:1% or drop:0.01",
    "flip": "a share: flip:0.1%",
    "insert": "a share: insert:0.1%",
    "silent": "a duration: silent:5s",
    "unplug": "a duration: unplug:5s",
    "stall": "a duration below 1 s: stall:200ms",
    "garbage": "nothing",
}

_SECOND = 1_000_000_000
_UNITS = {"ms": 1e-3, "s": 1.0, "": 1.0, "min": 60.0}


@dataclass(slots=True)
class Faults:
    """Faults of one line, and how far they have got; a line needs one of its own.

    Attributes:
        drop: Probability that a byte is lost.
        flip: Probability that a bit of a byte is inverted.
        insert: Probability that a random byte comes before a byte.
        silent_s: Seconds from the first byte until nothing arrives any more; None = never.
        unplug_s: Seconds from the first byte until the port is dead; None = never.
        stall_s: Seconds that bytes are held back once a second; 0 = never.
        garbage: Whether every byte is random.
        seed: Seed of everything random.

    Raises:
        ValueError: A number is out of range.
    """

    drop: float = 0.0
    flip: float = 0.0
    insert: float = 0.0
    silent_s: float | None = None
    unplug_s: float | None = None
    stall_s: float = 0.0
    garbage: bool = False
    seed: int = 0
    _fate: np.random.Generator = field(init=False, repr=False)
    _detail: np.random.Generator = field(init=False, repr=False)
    _first: int | None = field(init=False, default=None)
    _held: bytearray = field(init=False, default_factory=bytearray, repr=False)

    def __post_init__(self) -> None:
        if min(self.drop, self.flip, self.insert) < 0.0 or self.drop + self.flip + self.insert > 1.0:
            raise ValueError("drop, flip and insert are shares from 0 to 100 %, together no more than 100 %")
        if not 0.0 <= self.stall_s < 1.0:
            raise ValueError("a stall lasts less than the second after which it comes again")
        self._fate = np.random.default_rng([self.seed, 1])
        self._detail = np.random.default_rng([self.seed, 2])

    @property
    def holding(self) -> bool:
        """Whether bytes are held back: `apply` must be called again soon, with or without new bytes."""
        return bool(self._held)

    def apply(self, data: bytes, now: int) -> bytes:
        """What arrives at the host by `now` when the device has just sent `data`.

        Args:
            data: The device's bytes, in any chunks, possibly none.
            now: Monotonic nanoseconds.
        """
        if data and self._first is None:
            self._first = now
        if self._first is None:
            return b""
        since = now - self._first
        if self.unplugged(now) or (self.silent_s is not None and since >= self.silent_s * _SECOND):
            self._held.clear()
            return b""
        data = self._damaged(data)
        if self.stall_s:
            self._held += data
            if since % _SECOND >= _SECOND - self.stall_s * _SECOND:
                return b""
            data = bytes(self._held)
            self._held.clear()
        return data

    def unplugged(self, now: int) -> bool:
        """Whether the port is dead by `now`."""
        if self.unplug_s is None or self._first is None:
            return False
        return now - self._first >= self.unplug_s * _SECOND

    def _damaged(self, data: bytes) -> bytes:
        if self.garbage:
            return (self._fate.random(len(data)) * 256.0).astype(np.uint8).tobytes()
        total = self.drop + self.flip + self.insert
        if not data or not total:
            return data
        fate = self._fate.random(len(data))
        hit = np.flatnonzero(fate < total)
        if not hit.size:
            return data
        parts, done = [], 0
        for at in hit.tolist():
            parts.append(data[done:at])
            done = at + 1
            if fate[at] < self.drop:
                continue
            if fate[at] < self.drop + self.flip:
                parts.append(bytes([data[at] ^ (1 << int(self._detail.integers(8)))]))
            else:
                parts.append(bytes([int(self._detail.integers(256)), data[at]]))
        parts.append(data[done:])
        return b"".join(parts)


def parse_faults(text: str, *, seed: int = 0) -> Faults:
    """Read a list of faults such as ``"drop:1%,unplug:5s"``; an empty one means none.

    Args:
        text: The list, separated by commas.
        seed: Seed of everything random.

    Raises:
        ValueError: The text makes no sense; says why, and which faults there are.
    """
    found: dict[str, float | bool] = {}
    for word in filter(None, (part.strip() for part in text.split(","))):
        name, _, value = word.partition(":")
        if name not in FAULTS:
            raise ValueError(f"no fault is called {name!r}; there are {', '.join(FAULTS)}")
        if name in found or f"{name}_s" in found:
            raise ValueError(f"the fault {name!r} is given twice")
        if name == "garbage":
            if value:
                raise _unreadable(word, name)
            found[name] = True
        elif name in ("drop", "flip", "insert"):
            found[name] = _share(word, name, value)
        else:
            found[f"{name}_s"] = _duration(word, name, value)
    try:
        return Faults(seed=seed, **found)  # type: ignore[arg-type]
    except ValueError as error:
        raise ValueError(f"{text!r}: {error}") from None


def _share(word: str, name: str, value: str) -> float:
    match = re.fullmatch(r"(\d+\.?\d*|\.\d+)(%?)", value.strip())
    if match is None:
        raise _unreadable(word, name)
    return float(match[1]) / (100.0 if match[2] else 1.0)


def _duration(word: str, name: str, value: str) -> float:
    match = re.fullmatch(r"(\d+\.?\d*|\.\d+)(ms|s|min|)", value.strip())
    if match is None:
        raise _unreadable(word, name)
    return float(match[1]) * _UNITS[match[2]]


def _unreadable(word: str, name: str) -> ValueError:
    return ValueError(f"{word!r} cannot be read: {name} takes {FAULTS[name]}; the faults are {', '.join(FAULTS)}")
