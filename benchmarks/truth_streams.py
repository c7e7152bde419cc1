"""Streams of which the truth is known: where the rotor was at each sample, and when that was measured.

A stream is made of samples at an even pace, the angle of a rotor whose speed is a function of time, and the packers
of the simulated devices (`benchmarks.truth_forms`), which write both as a device would. A packet leaves a sample
and a half after its last sample, and takes its time on the line.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from benchmarks.streams import Kind
from benchmarks.truth_code import Code, Floats, Ints
from lidario.families.base import Stream

Hertz = Callable[[Floats], Floats]
"""Speed of the rotor, by the seconds since the stream began."""

_DELAY_SAMPLES = 1.5
"""From the last sample of a packet to its first byte: as the vendor's SDK 2.1.0 assumes."""
_GRID_S = 1e-4


@dataclass(frozen=True, slots=True, eq=False)
class Form:
    """One format, as one model sends it.

    Attributes:
        name: For tables.
        kind: What the session would know of it.
        baudrate: Speed of its line.
        hertz: Its ordinary speed.
        samples: Of an ordinary packet.
        slowest_turn_s: As its family tells the session.
        intro: What is recorded before its packets.
        words: How distances are written: millimetres of the word 0, of a step, and how many words there are.
        pack: Makes the packets.
        shift_deg: What is added to the angle of the beam, by the distance and the place in the packet.
        rates: Samples a second that the model may take, where it does not tell which.
    """

    name: str
    kind: Kind
    baudrate: int
    hertz: float
    samples: int
    slowest_turn_s: float
    intro: bytes
    words: tuple[float, float, int]
    pack: Callable[[Samples], tuple[bytes, Ints]]
    shift_deg: Callable[[Floats, Ints], Floats] | None = None
    rates: tuple[float, ...] = ()

    @property
    def sample_ns(self) -> float:
        """Nanoseconds from one sample to the next."""
        return self.kind.mode.sample_us * 1e3

    def stream(self) -> Stream:
        """As the family would describe it to the session."""
        stream = replace(self.kind.stream(), slowest_turn_s=self.slowest_turn_s)
        if not self.rates:
            return stream
        return replace(stream, sample_ns=0.0, may_take_ns=tuple(1e9 / rate for rate in self.rates))


@dataclass(frozen=True, slots=True, eq=False)
class Samples:
    """What the packers are given: all samples of a stream, and how they are divided into packets.

    Attributes:
        turns: Where the rotor is at each, in turns.
        times_ns: When.
        millimetres: Its distance.
        sizes: Samples of each packet.
    """

    turns: Floats
    times_ns: Floats
    millimetres: Floats
    sizes: Ints

    def rows(self, values: NDArray[np.generic]) -> NDArray[np.generic]:
        """One row for each packet, where all are of one size."""
        return values.reshape(len(self.sizes), -1)


@dataclass(frozen=True, eq=False)
class TrueStream:
    """A stream, and its truth.

    Attributes:
        form: Its format.
        code: How its samples are numbered.
        data: Its packets.
        offsets: Where each packet begins in `data`, and where the last one ends.
        firsts: Number of the first sample of each packet, and how many there are.
        turns: Where the rotor was at each sample, in turns since the beginning; the fraction is the angle.
        degrees: At which angle each sample must be delivered, corrections included.
        times_ns: When it was measured.
    """

    form: Form
    code: Code
    data: NDArray[np.uint8]
    offsets: Ints
    firsts: Ints
    turns: Floats
    degrees: Floats
    times_ns: Floats

    @cached_property
    def arrivals_ns(self) -> Floats:
        """When each byte arrives, where nothing delays it."""
        byte_ns, size = 10e9 / self.form.baudrate, np.diff(self.offsets)
        ready = self.times_ns[self.firsts[1:] - 1] + _DELAY_SAMPLES * self.form.sample_ns
        behind = np.cumsum(size) * byte_ns
        # A packet waits until the one before has left.
        begin = np.maximum.accumulate(ready - behind + size * byte_ns) + behind - size * byte_ns
        place = np.arange(len(self.data)) - np.repeat(self.offsets[:-1], size)
        return np.repeat(begin, size) + (place + 1) * byte_ns

    @cached_property
    def whole(self) -> range:
        """The revolutions that are in it from beginning to end: only a packet behind the seam tells the end."""
        return range(int(np.ceil(self.turns[0])), int(np.floor(self.turns[self.firsts[-2]])))

    @cached_property
    def begins_ns(self) -> dict[int, float]:
        """When each revolution began, by its number."""
        numbers = np.arange(np.ceil(self.turns[0]), np.floor(self.turns[-1]) + 1)
        return dict(zip(numbers.astype(int).tolist(), np.interp(numbers, self.turns, self.times_ns), strict=True))


def true_stream(form: Form, hertz: Hertz, seconds: float, begin: float = 0.3, clock: float = 1.0) -> TrueStream:
    """A stream of one format whose rotor turns as told.

    Args:
        form: The format.
        hertz: Speed of the rotor, by the seconds since the beginning.
        seconds: How long it lasts.
        begin: Where the rotor is at the beginning, in turns.
        clock: How long a sample takes, of what the device says.
    """
    sample_ns = form.sample_ns * clock
    grid = np.arange(0.0, seconds + 1.0, _GRID_S)
    speed = hertz(grid)
    turned = begin + np.concatenate(([0.0], np.cumsum((speed[1:] + speed[:-1]) / 2 * _GRID_S)))
    count = int(seconds * 1e9 / sample_ns) // form.samples * form.samples
    times = np.arange(count, dtype=np.float64) * sample_ns
    turns = np.interp(times * 1e-9, grid, turned)
    sizes = (
        _divided(turns, form.samples)
        if form.kind.family == "ydlidar"
        else np.full(count // form.samples, form.samples)
    )
    firsts = np.concatenate(([0], np.cumsum(sizes)))
    code = Code(*form.words, form.samples, len(sizes))
    packet = np.repeat(np.arange(len(sizes)), sizes)
    place = np.arange(count) - firsts[packet]
    millimetres = code.millimetres(packet, place)
    degrees = turns * 360.0
    if form.shift_deg is not None:
        degrees = degrees + form.shift_deg(millimetres, place)
    data, lengths = form.pack(Samples(turns, times, millimetres, sizes))
    offsets = np.concatenate(([0], np.cumsum(lengths)))
    return TrueStream(form, code, np.frombuffer(data, np.uint8), offsets, firsts, turns, degrees % 360.0, times)


def _divided(turns: Floats, samples: int) -> Ints:
    """Sizes of packets: the first sample past 0 alone, then full ones, and what is left before the next 0."""
    sizes = list[int]()
    zeros = (np.flatnonzero(np.diff(np.floor(turns)) > 0) + 1).tolist()
    for at, (begin, end) in enumerate(zip([0, *zeros], [*zeros, len(turns)], strict=True)):
        lone = int(at > 0)
        full, rest = divmod(end - begin - lone, samples)
        sizes += [1] * lone + [samples] * full + [rest] * (rest > 0)
    return np.array(sizes)
