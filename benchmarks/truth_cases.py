"""What happens to the streams of `benchmarks.truth`: how the rotor turns, what the line loses, and who is late.

Time goes on while bytes are missing: what is left arrives when it would have arrived anyway.
"""

from __future__ import annotations

import zlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from benchmarks.truth_code import Floats
from benchmarks.truth_streams import Form, TrueStream, true_stream

Mask = NDArray[np.bool_]


@dataclass(frozen=True, slots=True, eq=False)
class Line:
    """What comes of a stream, and when.

    Attributes:
        data: The bytes that come.
        at_ns: When each comes, ascending.
        missing: Packets of the stream that do not come as they were, between the first that does and the last.
            None where that is told by what is found intact: damaged bytes may pass a check value.
        blocked_ns: From when to when nobody reads.
        pace_s: The shortest and the longest time from one read to the next.
    """

    data: NDArray[np.uint8]
    at_ns: Floats
    missing: int | None
    blocked_ns: tuple[float, float] = (0.0, 0.0)
    pace_s: tuple[float, float] = (0.016, 0.06)


Damage = Callable[[TrueStream, np.random.Generator], Line]
Speed = Callable[[float, Floats], Floats]


@dataclass(frozen=True, slots=True)
class Case:
    """One thing that happens.

    Attributes:
        name: For tables.
        damage: What becomes of the bytes.
        speed: Of the rotor, by its ordinary speed and the seconds since the beginning.
        seconds: How long the stream lasts.
        begin: Where the rotor is at the beginning, in turns.
        clock: How long a sample takes, of what the device says.
        in_files: Whether it can happen to a file, which holds no times.
    """

    name: str
    damage: Damage
    speed: Speed
    seconds: float = 6.0
    begin: float = 0.3
    clock: float = 1.0
    in_files: bool = True


def happen(case: Case, form: Form) -> tuple[TrueStream, Line]:
    """The stream of one format to which this happens, and what comes of it; always the same."""
    stream = true_stream(form, partial(case.speed, form.hertz), case.seconds, case.begin, case.clock)
    random = np.random.default_rng(zlib.crc32(f"{form.name} {case.name}".encode()))
    return stream, case.damage(stream, random)


def drifting(hertz: float, seconds: Floats) -> Floats:
    """As good as a regulated motor is."""
    return hertz * (1 + 0.005 * np.sin(2 * np.pi * 0.4 * seconds))


def _wobbling(hertz: float, seconds: Floats) -> Floats:
    return hertz * (1 + 0.03 * np.sin(2 * np.pi * 0.7 * seconds))


def _ramp(
    begin: float, end: float, lasts_s: float, hertz: float, seconds: Floats, *, after_s: float = 2.0
) -> Floats:
    """From one speed to another within some seconds, after some at the first."""
    del hertz
    return begin + (end - begin) * np.clip((seconds - after_s) / lasts_s, 0.0, 1.0)


def _changed(factor: float, hertz: float, seconds: Floats) -> Floats:
    """At once, three seconds after the beginning, as behind an outage in which it changed."""
    return np.where(seconds < 3.0, hertz, hertz * factor)


def _standing(hertz: float, seconds: Floats, *, lasts_s: float = 0.5) -> Floats:
    """For some time, as when something holds it."""
    return np.where((seconds >= 2.5) & (seconds < 2.5 + lasts_s), 0.0, hertz)


def _stop_and_go(hertz: float, seconds: Floats) -> Floats:
    """As a motor that a supply fails again and again: it slows down within 0.3 s, stands, and starts again."""
    return hertz * np.interp(seconds % 2.4, [0.0, 0.9, 1.2, 1.7, 2.0, 2.4], [1.0, 1.0, 0.0, 0.0, 1.0, 1.0])


def _braked(creeps_hertz: float, within_s: float, hertz: float, seconds: Floats) -> Floats:
    """As when a hand brakes it, lets it creep for a second, and lets it go."""
    return np.interp(seconds, [2.0, 2.0 + within_s, 3.0, 3.4], [hertz, creeps_hertz, creeps_hertz, hertz])


def _from_half(hertz: float, seconds: Floats) -> Floats:
    del hertz
    return 0.5 + 9.5 * np.clip(seconds / 3.0, 0.0, 1.0)


def _from_rest(hertz: float, seconds: Floats) -> Floats:
    """Standing for a second, as where a stream is read from before its motor starts."""
    return hertz * -np.expm1(-np.maximum(seconds - 1.0, 0.0) / 0.4)


def _spin_up(hertz: float, seconds: Floats) -> Floats:
    """As a motor speeds up that is driven evenly, from two turns a second on."""
    return hertz - (hertz - 2.0) * np.exp(-seconds / 0.7)


def _jerky_spin_up(hertz: float, seconds: Floats) -> Floats:
    """As a motor starts that has not yet settled: an X4's packets are 6 to 22 degrees apart at first."""
    jerks = 4.8 - 2.8 * np.cos(2 * np.pi * seconds / 0.4)
    return np.where(seconds < 1.8, jerks, 7.6 + (hertz - 7.6) * np.clip((seconds - 1.8) / 0.5, 0.0, 1.0))


def _clean(stream: TrueStream, random: np.random.Generator) -> Line:
    del random
    return Line(stream.data, stream.arrivals_ns, 0)


def _only(stream: TrueStream, kept: Mask) -> Line:
    """Only these packets."""
    left = np.repeat(kept, np.diff(stream.offsets))
    return Line(stream.data[left], stream.arrivals_ns[left], _missing(kept))


def _missing(kept: Mask) -> int:
    there = np.flatnonzero(kept)
    return int(there[-1] - there[0] + 1 - len(there)) if len(there) else 0


def lose(stream: TrueStream, kept: Mask, random: np.random.Generator, *, spoilt: bool) -> Line:
    """Packets that do not come, or come with three flipped bits, which no check value lets pass."""
    if not spoilt:
        return _only(stream, kept)
    data = stream.data.copy()
    sizes = np.diff(stream.offsets)
    for packet in np.flatnonzero(~kept).tolist():
        size = int(sizes[packet])
        # Of a sample of five bytes only three bits are checked.
        places = random.choice(size, 3, replace=False) if size > 5 else np.zeros(1, int)
        bits = 1 << random.integers(0, 8, len(places)) if size > 5 else np.ones(1, int)
        data[stream.offsets[packet] + places] ^= bits.astype(np.uint8)
    return Line(data, stream.arrivals_ns, _missing(kept))


def _each_second(stream: TrueStream, random: np.random.Generator, *, spoilt: bool) -> Line:
    return lose(stream, np.arange(len(stream.offsets) - 1) % 2 == 0, random, spoilt=spoilt)


def lose_share(percent: int, stream: TrueStream, random: np.random.Generator, *, spoilt: bool) -> Line:
    return lose(stream, random.random(len(stream.offsets) - 1) * 100 >= percent, random, spoilt=spoilt)


def _threes(stream: TrueStream, random: np.random.Generator) -> Line:
    kept = np.ones(len(stream.offsets) - 1, np.bool_)
    for first in random.integers(0, len(kept) - 4, 20).tolist():
        kept[first : first + 3] = False
    return _only(stream, kept)


def _outage(seconds: float, stream: TrueStream, random: np.random.Generator) -> Line:
    begins = stream.times_ns[stream.firsts[:-1]] * 1e-9
    begin = random.uniform(0.4, 0.6) * begins[-1]
    return _only(stream, (begins < begin) | (begins >= begin + seconds))


def _outage_at(begin: float, seconds: float, stream: TrueStream, random: np.random.Generator) -> Line:
    del random
    begins = stream.times_ns[stream.firsts[:-1]] * 1e-9
    return _only(stream, (begins < begin) | (begins >= begin + seconds))


def lose_stretches(each: float, seconds: float, stream: TrueStream, random: np.random.Generator) -> Line:
    del random
    return _only(stream, stream.times_ns[stream.firsts[:-1]] * 1e-9 % each < each - seconds)


def _two_turns(stream: TrueStream, random: np.random.Generator) -> Line:
    turns = stream.turns[stream.firsts[:-1]]
    begin = turns[int(random.uniform(0.4, 0.6) * len(turns))]
    end = turns[np.argmin(np.abs(turns - begin - 2.0))]
    return _only(stream, (turns < begin) | (turns >= end))


def lose_bytes(percent: float, stream: TrueStream, random: np.random.Generator) -> Line:
    left = random.random(len(stream.data)) * 100 >= percent
    return Line(stream.data[left], stream.arrivals_ns[left], None)


def flip_bytes(percent: float, stream: TrueStream, random: np.random.Generator) -> Line:
    data = stream.data.copy()
    hit = random.random(len(data)) * 100 < percent
    data[hit] ^= (1 << random.integers(0, 8, int(hit.sum()))).astype(np.uint8)
    return Line(data, stream.arrivals_ns, None)


def bursts(stream: TrueStream, random: np.random.Generator) -> Line:
    data = stream.data.copy()
    for begin in random.integers(0, len(data) - 200, max(8, len(data) // 20_000)).tolist():
        data[begin : begin + 200] = random.integers(0, 256, 200, np.uint8)
    return Line(data, stream.arrivals_ns, None)


def repeat_packets(share: float, stream: TrueStream, random: np.random.Generator) -> Line:
    """Packets that come twice, the second time right behind the first; a share of all, or one in the middle."""
    count = len(stream.offsets) - 1
    twice = random.random(count) < share
    if not share:
        twice[count // 2] = True
    size = np.diff(stream.offsets)
    order = np.repeat(np.arange(count), 1 + twice)
    again = np.diff(order, prepend=-1) == 0
    at = np.concatenate([np.arange(stream.offsets[each], stream.offsets[each + 1]) for each in order.tolist()])
    arrivals = stream.arrivals_ns[at]
    late = np.repeat(again, size[order])
    arrivals[late] = stream.arrivals_ns[np.repeat(stream.offsets[order + 1] - 1, size[order])][late]
    return Line(stream.data[at], arrivals, 0)


def _blocked(seconds: float, stream: TrueStream, random: np.random.Generator) -> Line:
    begin = random.uniform(1.5, 2.5) * 1e9
    return Line(stream.data, stream.arrivals_ns, 0, (begin, begin + seconds * 1e9))


def _late_and_lossy(stream: TrueStream, random: np.random.Generator) -> Line:
    return replace(lose_share(10, stream, random, spoilt=False), blocked_ns=(1.6e9, 2.9e9))


def _read_each(
    pace_s: tuple[float, float], damage: Damage, stream: TrueStream, random: np.random.Generator
) -> Line:
    """By a program that is busy meanwhile, such as each 100 ms: as long as a revolution takes."""
    return replace(damage(stream, random), pace_s=pace_s)


def _cases() -> Iterator[Case]:
    yield Case("clean", _clean, drifting)
    yield Case("wobbling by 3 %", _clean, _wobbling)
    yield Case("10 to 2 Hz in 1 s", _clean, partial(_ramp, 10.0, 2.0, 1.0))
    yield Case("10 to 1 Hz in 1 s", _clean, partial(_ramp, 10.0, 1.0, 1.0), 7.0)
    yield Case("0.5 to 10 Hz in 3 s", _clean, _from_half)
    yield Case("5 to 10 Hz in 0.5 s", _clean, partial(_ramp, 5.0, 10.0, 0.5))
    yield Case("4 to 1 Hz in 0.5 s, at once", _clean, partial(_ramp, 4.0, 1.0, 0.5, after_s=0.0), begin=0.7)
    yield Case("spinning up from 2 Hz", _clean, _spin_up)
    yield Case("spinning up in jerks of 2 to 7.6 Hz", _clean, _jerky_spin_up)
    yield Case("a clock 0.5 % slow", _clean, drifting, clock=1.005)
    for spoilt, how in ((False, "gone"), (True, "spoilt")):
        yield Case(f"each second packet {how}", partial(_each_second, spoilt=spoilt), drifting)
        for percent in (20, 40, 60):
            yield Case(f"{percent} % of the packets {how}", partial(lose_share, percent, spoilt=spoilt), drifting)
    for percent in (1, 2):
        yield Case(f"{percent} % of the bytes lost", partial(lose_bytes, percent), drifting)
        yield Case(f"{percent} % of the bytes flipped", partial(flip_bytes, percent), drifting)
    yield Case("bursts of 200 bytes", bursts, drifting)
    yield Case("20 times three packets gone", _threes, drifting)
    yield Case("an outage of 0.3 s", partial(_outage, 0.3), drifting)
    yield Case("an outage of 0.8 s", partial(_outage, 0.8), drifting)
    yield Case("an outage of 0.8 s, begun at 345°", partial(_outage, 0.8), drifting, begin=345 / 360)
    yield Case("an outage of two turns", _two_turns, drifting)
    yield Case("an outage of 0.8 s, then 40 % slower", partial(_outage_at, 2.6, 0.8), partial(_changed, 0.6))
    yield Case("an outage of 0.3 s, then 30 % faster", partial(_outage_at, 2.8, 0.3), partial(_changed, 1.3))
    yield Case("an outage of 0.15 s each 0.35 s", partial(lose_stretches, 0.35, 0.15), drifting)
    yield Case("an outage of 0.4 s each 0.6 s", partial(lose_stretches, 0.6, 0.4), drifting, 8.0)
    yield Case("an outage of 0.7 s each second", partial(lose_stretches, 1.0, 0.7), drifting, 8.0)
    yield Case("braked by hand to 0.3 Hz in 20 ms", _clean, partial(_braked, 0.3, 0.02))
    yield Case("from rest", _clean, _from_rest)
    yield Case("from rest right before the seam", _clean, _from_rest, begin=0.98)
    yield Case("standing for 3 s", _clean, partial(_standing, lasts_s=3.0), 8.0)
    yield Case("standing for 0.5 s", _clean, _standing)
    yield Case("standing for 0.5 s, 60 % gone", partial(lose_share, 60, spoilt=False), _standing)
    yield Case("standing for 0.5 s, 60 % spoilt", partial(lose_share, 60, spoilt=True), _standing)
    yield Case("stop and go", _clean, _stop_and_go, 8.0)
    for percent in (20, 60):
        lossy = partial(lose_share, percent, spoilt=False)
        yield Case(f"stop and go, {percent} % gone", lossy, _stop_and_go, 8.0)
    for name, pace_s in (("100 ms", (0.1, 0.1)), ("0.2 to 0.3 s", (0.2, 0.3))):
        for what, damage, speed in (
            ("stop and go", _clean, _stop_and_go),
            ("60 % gone", partial(lose_share, 60, spoilt=False), drifting),
            ("each second gone", partial(_each_second, spoilt=False), _wobbling),
        ):
            read = partial(_read_each, pace_s, damage)
            yield Case(f"{what}, read each {name}", read, speed, in_files=False)
    yield Case("one packet twice", partial(repeat_packets, 0.0), drifting)
    yield Case("5 % of the packets twice", partial(repeat_packets, 0.05), drifting)
    yield Case("10 % of the packets twice", partial(repeat_packets, 0.1), drifting)
    yield Case("late by 0.2 s", partial(_blocked, 0.2), drifting, in_files=False)
    yield Case("late by 2 s", partial(_blocked, 2.0), drifting, in_files=False)
    yield Case("late by 1.3 s, 10 % gone", _late_and_lossy, drifting, in_files=False)
    yield Case("2 to 7 Hz, an outage of 1 s in it", partial(_outage_at, 2.3, 1.0), partial(_ramp, 2.0, 7.0, 1.5))
    yield Case("wobbling, 20 % gone", partial(lose_share, 20, spoilt=False), _wobbling)
    yield Case("10 to 2 Hz, 20 % gone", partial(lose_share, 20, spoilt=False), partial(_ramp, 10.0, 2.0, 1.0))


CASES = {case.name: case for case in _cases()}
"""What happens, each to every format."""
