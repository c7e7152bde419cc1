"""Whether any speed of the rotor looks like a loss, and what becomes of losses that nobody has chosen.

A rotor starts from rest, or is slowed down, held, and let go, at random. Every packet comes, when it was measured:
so nothing is missing, every point has a place, and each time is known. Each ride is read as it comes, and once more
from a file of bytes, without times.

Then a rotor that changes its speed as real ones do, or starts from rest, or stops and starts again, on a line that
loses packets at random, in a program that may be blocked meanwhile: what "truth" looks at one by one meets here.
Nothing here is timed, and the same command prints the same figures. The streams are those of "truth".
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Final

import numpy as np

from benchmarks.report import Result, Setting, Table
from benchmarks.truth_cases import Line, lose
from benchmarks.truth_code import Floats
from benchmarks.truth_forms import FORMATS
from benchmarks.truth_score import Score, score
from benchmarks.truth_streams import Form, TrueStream, true_stream
from benchmarks.truth_ways import receive

_SECONDS = 6.0
_EVEN_S: Final = 0.8
"""So long it is even at first: until the pace of the device is known, time can say nothing."""
_HARDEST: Final = 10.0
"""Revolutions a second by which its speed changes in a second, at most: from 10 Hz to none takes a second."""
_SEEDS = 12
_ROUGH_SEEDS = 24
_ROW: Final = 10
"""So many packets are lost in a row, where a few are."""


def run(setting: Setting) -> Result:
    """Some rides of every format, on an undamaged line and on a rough one."""
    return Result("rides", [_even(setting), _rough(setting)], {}, [])


def _even(setting: Setting) -> Table:
    columns = ("format", "runs", "packets told as lost", "revolutions told as missing, and not delivered")
    table = Table("Rides", (*columns, "points wrong", "farthest", "times off, ms, at most"))
    for name, form in FORMATS.items():
        if not setting.selects(name):
            continue
        setting.say(name)
        seeds = range(1 if setting.quick else _SEEDS)
        found = [ridden(form, seed, way) for seed in seeds for way in ("read", "file")]
        table.add(
            name,
            str(len(found)),
            str(sum(each.told for each in found)),
            f"{sum(each.told_revolutions for each in found)}, {sum(each.missing_revolutions for each in found)}",
            f"{sum(each.wrong for each in found)} of {sum(each.samples for each in found)}",
            f"{max(each.farthest_deg for each in found):.2f}",
            f"{max((each.times_off_ms or (0.0, 0.0))[1] for each in found):.0f}",
        )
    return table


def _rough(setting: Setting) -> Table:
    columns = ("format", "runs", "kept", "points wrong, of another turn", "packets missing, told")
    table = Table("Rough rides", (*columns, "revolutions missing, told", "`seq` off", "times off, ms, at most"))
    for name, form in FORMATS.items():
        if not setting.selects(name):
            continue
        setting.say(f"{name}, rough")
        found = [rough(form, seed) for seed in range(1 if setting.quick else _ROUGH_SEEDS)]
        table.add(
            name,
            str(len(found)),
            f"{100 * sum(each.kept for each in found) / sum(each.samples for each in found):.1f} %",
            f"{sum(each.wrong for each in found)}, {sum(each.mixed for each in found)}",
            f"{sum(each.missing for each in found)}, {sum(each.told for each in found)}",
            f"{sum(each.missing_revolutions for each in found)}, {sum(each.told_revolutions for each in found)}",
            f"{max(each.seq_off for each in found)}",
            f"{max((each.times_off_ms or (0.0, 0.0))[1] for each in found):.0f}",
        )
    table.notes.append("`seq` off, and times: at most, of all its runs")
    return table


def ridden(form: Form, seed: int, way: str = "read") -> Score:
    """What becomes of one ride, in one of the ways of "truth"."""
    random = np.random.default_rng(seed)
    speed = _started(random, form.hertz) if seed % 3 == 2 else _braked(random, form.hertz)
    stream = true_stream(form, speed, _SECONDS)
    line = Line(stream.data, stream.arrivals_ns, 0)
    return score(stream, line, receive(stream, line, way, seed), timed=way != "file")


def rough(form: Form, seed: int) -> Score:
    """What becomes of one rough ride, as it is read."""
    random = np.random.default_rng(seed)
    speed = _started(random, form.hertz) if seed % 3 == 2 else _regulated(random, form.hertz)
    stream = true_stream(form, speed, _SECONDS, random.uniform())
    line = _damaged(stream, random)
    return score(stream, line, receive(stream, line, "read", seed), timed=True)


def _regulated(random: np.random.Generator, hertz: float) -> Callable[[Floats], Floats]:
    """A speed that wobbles, and changes once to another one."""
    first, then = hertz * random.uniform(0.4, 1.6, 2)
    begin, lasts = random.uniform(0.5, 3.0), random.uniform(0.3, 2.5)
    wobble, each_s = random.uniform(0.0, 0.06), random.uniform(0.2, 2.0)

    def speed(seconds: Floats) -> Floats:
        changed = first + (then - first) * np.clip((seconds - begin) / lasts, 0.0, 1.0)
        return np.asarray(changed * (1 + wobble * np.sin(2 * np.pi * each_s * seconds)))

    return speed


def _started(random: np.random.Generator, hertz: float) -> Callable[[Floats], Floats]:
    """A motor that starts from rest; half of them have no power for a while, and start again."""
    begin, off_s = random.uniform(0.0, 1.0), random.uniform(2.0, 4.0)
    starts_s, stops_s = random.uniform(0.3, 1.5), random.uniform(0.3, 0.8)
    on_s = off_s + (random.uniform(0.2, 2.0) if random.random() < 0.5 else 0.0)

    def speed(seconds: Floats) -> Floats:
        first = -np.expm1(-np.maximum(seconds - begin, 0.0) / starts_s)
        left = first * np.exp(-np.clip(seconds - off_s, 0.0, on_s - off_s) / stops_s)
        return np.asarray(hertz * (1 - (1 - left) * np.exp(-np.maximum(seconds - on_s, 0.0) / starts_s)))

    return speed


def _damaged(stream: TrueStream, random: np.random.Generator) -> Line:
    """Single packets are lost, some in a row, and all of some time; a program reads often or seldom, or is late."""
    count = len(stream.offsets) - 1
    begins_s = stream.times_ns[stream.firsts[:-1]] * 1e-9
    kept = random.random(count) >= random.choice([0.0, 0.02, 0.1, 0.3, 0.5])
    for begin in random.integers(0, count - _ROW, random.integers(0, 10)).tolist():
        kept[begin : begin + int(random.integers(1, _ROW))] = False
    for begin in random.uniform(0.5, _SECONDS - 0.5, random.integers(0, 3)).tolist():
        kept[(begins_s >= begin) & (begins_s < begin + random.uniform(0.01, 1.2))] = False
    line = lose(stream, kept, random, spoilt=bool(random.random() < 0.5))
    blocked = random.uniform(1.0, 4.0) if random.random() < 0.3 else 0.0
    until = blocked and blocked + random.uniform(0.1, 1.5)
    pace = [(0.001, 0.03), (0.016, 0.06), (0.03, 0.1)][int(random.integers(3))]
    return replace(line, blocked_ns=(blocked * 1e9, until * 1e9), pace_s=pace)


def _braked(random: np.random.Generator, hertz: float) -> Callable[[Floats], Floats]:
    """Speeds from nothing to beyond the ordinary one."""
    times = np.arange(0.0, _SECONDS + 1, 0.01)
    speed = np.interp(
        times,
        [_EVEN_S, *np.sort(random.uniform(_EVEN_S, _SECONDS, 6)).tolist()],
        [random.uniform(4.0, hertz), *(random.choice([0.0, 0.3, *random.uniform(2.0, 1.4 * hertz, 4)], 6))],
    )
    for at in range(1, len(speed)):
        change = np.clip(speed[at] - speed[at - 1], -_HARDEST * 0.01, _HARDEST * 0.01)
        speed[at] = speed[at - 1] + change
    return lambda seconds: np.interp(seconds, times, speed)
