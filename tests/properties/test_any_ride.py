"""On an undamaged line nothing is told as lost, however the rotor turns; nor in a file of bytes, without times."""

from __future__ import annotations

from functools import partial
from itertools import cycle, product

import numpy as np
import pytest

from benchmarks.rides import ridden, rough
from benchmarks.truth_cases import Line, drifting
from benchmarks.truth_forms import FORMATS
from benchmarks.truth_score import score
from benchmarks.truth_streams import true_stream
from benchmarks.truth_ways import WAYS, receive


@pytest.mark.long
@pytest.mark.exhaustive("seed", sample=[0], full=range(12))
@pytest.mark.exhaustive(
    ("name", "way"),
    sample=list(zip(FORMATS, cycle(["read", "file"]), strict=False)),
    full=list(product(FORMATS, ["read", "file"])),
)
def test_whatever_the_rotor_does_nothing_is_told_as_lost(name: str, way: str, seed: int) -> None:
    found = ridden(FORMATS[name], seed, way)
    assert (found.told, found.wrong) == (0, 0)
    # A revolution that takes too long is given up.
    assert found.told_revolutions == found.missing_revolutions


@pytest.mark.exhaustive("seed", sample=range(6), full=range(200))
def test_a_rotor_that_starts_from_rest_or_stops_loses_nothing(seed: int) -> None:
    random = np.random.default_rng(seed)
    name, way = str(random.choice(list(FORMATS))), str(random.choice(list(WAYS)))
    found = ridden(FORMATS[name], 3 * seed + 2, way)
    assert (found.told, found.told_revolutions, found.wrong, found.mixed) == (0, 0, 0, 0), (name, way)
    assert found.delivered == found.revolutions


@pytest.mark.long
@pytest.mark.parametrize(
    ("name", "seed", "kept"),
    [("0x84 A1", 44, 0.65), ("0x84 A1", 17, 0.6), ("0x84 A3", 17, 0.6), ("0x85 S2", 11, 0.35), ("0x86", 26, 0.6)],
)
def test_where_time_tells_that_nearly_all_came_a_rotor_that_starts_is_followed(
    name: str, seed: int, kept: float
) -> None:
    """No two arcs are alike, and packets are lost: the angles alone would show gaps, or half of the speed."""
    found = rough(FORMATS[name], seed)
    assert found.kept >= kept * found.samples
    assert found.told <= 1.05 * found.missing
    assert found.wrong <= 0.015 * found.samples


@pytest.mark.long
@pytest.mark.parametrize("name", FORMATS)
@pytest.mark.exhaustive("share", sample=[0.3], full=[0.1, 0.3])
def test_where_angles_are_even_they_are_believed_against_the_time(name: str, share: float) -> None:
    """A file of which packets are gone, written to a port at an even pace: no time passes where they were."""
    stream = true_stream(FORMATS[name], partial(drifting, FORMATS[name].hertz), 4.0)
    count = len(stream.offsets) - 1
    kept = (np.random.default_rng(3).random(count) >= share) | (np.arange(count) < count // 4)
    data = stream.data[np.repeat(kept, np.diff(stream.offsets))]
    at_ns = np.arange(1, len(data) + 1) * (stream.arrivals_ns[-1] / len(stream.data))
    there = np.flatnonzero(kept)
    line = Line(data, at_ns, int(there[-1] - there[0] + 1 - len(there)))
    found = score(stream, line, receive(stream, line, "read"), timed=False)
    assert abs(found.told - found.missing) <= 1
    assert found.wrong == 0
