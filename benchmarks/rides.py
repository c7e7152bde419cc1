"""Whether any speed of the rotor looks like a loss: rides on a line that loses nothing.

A rotor is slowed down, held, and let go, at random. Every packet comes, when it was measured: so nothing is
missing, every point has a place, and each time is known. Each ride is read as it comes, and once more from a file
of bytes, without times. Nothing here is timed, and the same command prints the same figures. The streams are those
of "truth".
"""

from __future__ import annotations

from typing import Final

import numpy as np

from benchmarks.report import Result, Setting, Table
from benchmarks.truth_cases import Line
from benchmarks.truth_code import Floats
from benchmarks.truth_forms import FORMATS
from benchmarks.truth_score import Score, score
from benchmarks.truth_streams import Form, true_stream
from benchmarks.truth_ways import receive

_SECONDS = 6.0
_EVEN_S: Final = 0.8
"""So long it is even at first: until the pace of the device is known, time can say nothing."""
_HARDEST: Final = 10.0
"""Revolutions a second by which its speed changes in a second, at most: from 10 Hz to none takes a second."""
_SEEDS = 12


def run(setting: Setting) -> Result:
    """Some rides of every format."""
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
    return Result("rides", [table], {}, [])


def ridden(form: Form, seed: int, way: str = "read") -> Score:
    """What becomes of one ride, in one of the ways of "truth"."""
    times, speed = _ride(np.random.default_rng(seed), form.hertz)
    stream = true_stream(form, lambda seconds: np.interp(seconds, times, speed), _SECONDS)
    line = Line(stream.data, stream.arrivals_ns, 0)
    return score(stream, line, receive(stream, line, way, seed), timed=way != "file")


def _ride(random: np.random.Generator, hertz: float) -> tuple[Floats, Floats]:
    """Speeds from nothing to beyond the ordinary one, by their times."""
    times = np.arange(0.0, _SECONDS + 1, 0.01)
    speed = np.interp(
        times,
        [_EVEN_S, *np.sort(random.uniform(_EVEN_S, _SECONDS, 6)).tolist()],
        [random.uniform(4.0, hertz), *(random.choice([0.0, 0.3, *random.uniform(2.0, 1.4 * hertz, 4)], 6))],
    )
    for at in range(1, len(speed)):
        change = np.clip(speed[at] - speed[at - 1], -_HARDEST * 0.01, _HARDEST * 0.01)
        speed[at] = speed[at - 1] + change
    return times, speed
