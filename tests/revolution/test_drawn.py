"""Rotors that start, stop, wobble and change their speed, as a seed draws it: on a clean line nothing is lost."""

from typing import NamedTuple

import numpy as np
import pytest
from numpy.typing import NDArray

from benchmarks.truth_cases import Case, Line, happen
from benchmarks.truth_forms import FORMATS
from benchmarks.truth_score import score
from benchmarks.truth_streams import TrueStream
from benchmarks.truth_ways import receive

Floats = NDArray[np.float64]
SECONDS = 4.0


class Drawn(NamedTuple):
    """What a rotor does, as motors can: none reaches its speed in less than a third of a second."""

    kind: str
    at_s: float
    in_s: float
    times: float

    def speed(self, hertz: float, seconds: Floats) -> Floats:
        since = seconds - self.at_s
        if self.kind == "starts":
            return -hertz * np.expm1(-np.maximum(since, 0.0) / self.in_s)
        if self.kind == "slows and goes on":
            slow = np.exp(-np.maximum(since, 0.0) / self.in_s)
            again = 1 - (1 - np.exp(-1 / self.in_s)) * np.exp(-(since - 1) / self.in_s)
            return hertz * np.where(since < 1, slow, again)
        if self.kind == "wobbles":
            return hertz * (1 + 0.03 * np.sin(2 * np.pi * 3 * self.times * seconds))
        return hertz * np.interp(seconds, [self.at_s, self.at_s + self.in_s], [1.0, self.times])


KINDS = ("starts", "slows and goes on", "wobbles", "changes")


def clean(stream: TrueStream, random: np.random.Generator) -> Line:
    del random
    return Line(stream.data, stream.arrivals_ns, 0)


@pytest.mark.exhaustive("seed", sample=range(6), full=range(200))
def test_on_a_clean_line_nothing_is_lost_whatever_the_rotor_does(seed: int) -> None:
    random = np.random.default_rng(seed)
    name, way = str(random.choice(list(FORMATS))), str(random.choice(["read", "sectors", "file"]))
    at_s, in_s, times = random.uniform((0.0, 0.3, 0.4), (1.0, 1.5, 1.8)).tolist()
    drawn = Drawn(str(random.choice(KINDS)), at_s, in_s, times)
    stream, line = happen(Case(str(seed), clean, drawn.speed, SECONDS, begin=random.uniform(0, 1)), FORMATS[name])
    found = score(stream, line, receive(stream, line, way), timed=way != "file")
    assert (found.told, found.told_revolutions, found.wrong, found.mixed) == (0, 0, 0, 0), (name, way, drawn)
    assert found.delivered == found.revolutions
