"""The truth that scans are compared with: it is right itself, and what is off is seen."""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from benchmarks import truth
from benchmarks.report import Setting
from benchmarks.truth_cases import CASES, Line, happen
from benchmarks.truth_code import UNKNOWN, UNTOLD, Code
from benchmarks.truth_forms import FORMATS
from benchmarks.truth_score import Score, score
from benchmarks.truth_streams import TrueStream, true_stream
from benchmarks.truth_ways import WAYS, Received, receive
from tests.reference import ldrobot, rplidar, ydlidar

Floats = NDArray[np.float64]


def _clean(name: str, seconds: float = 1.0) -> tuple[TrueStream, Line]:
    stream = true_stream(FORMATS[name], lambda times: 9.0 + times, seconds)
    return stream, Line(stream.data, stream.arrivals_ns, 0)


def _by_reference(stream: TrueStream) -> Iterator[tuple[float, float]]:
    """Angle and distance of each sample, by decoders that share no code with lidario's."""
    raw, kind = stream.data.tobytes(), stream.form.kind.mode.response_type
    if stream.form.kind.family == "rplidar":
        yield from ((each.angle_deg, each.distance_mm) for each in rplidar.decode(kind, rplidar.split(kind, raw)))
    elif stream.form.kind.family == "ydlidar":
        model = ydlidar.Kind(unit=4, triangle=True) if stream.form.name == "X4" else ydlidar.FOUR_ROS
        found = ydlidar.decode(ydlidar.split(raw, model), model)
        yield from ((each.angle_deg, each.distance_mm) for each in found)
    else:
        yield from ((each.angle_deg, each.distance_mm) for each in ldrobot.decode(ldrobot.split(raw)))


@pytest.mark.parametrize("name", FORMATS)
def test_an_independent_decoder_finds_every_sample_at_its_true_angle(name: str) -> None:
    stream, _ = _clean(name, 0.4)
    found = np.array(list(_by_reference(stream)))
    count = len(found)
    assert count >= len(stream.turns) - stream.form.samples
    off = np.abs((found[:, 0] - stream.degrees[:count] + 180) % 360 - 180)
    # Angles are cut to 1/64 degree, and between them the rotor, which speeds up here, is taken to turn evenly.
    assert off.max() < 0.03


@pytest.mark.parametrize("name", [name for name in FORMATS if name != "0x86"])
def test_the_distances_that_an_independent_decoder_finds_number_the_samples(name: str) -> None:
    stream, _ = _clean(name, 0.4)
    distances = np.array([distance for _, distance in _by_reference(stream)], np.float32)
    packet, place = stream.code.decode(distances)
    assert np.array_equal(stream.firsts[packet] + place, np.arange(len(distances)))


@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize("name", FORMATS)
def test_on_a_clean_line_all_is_delivered_and_nothing_is_missing(name: str, way: str) -> None:
    stream, line = _clean(name)
    found = score(stream, line, receive(stream, line, way), timed=way != "file")
    assert found.kept == found.points > 0
    assert found.delivered == found.revolutions == 9
    assert found.farthest_deg < 0.03
    counts = (found.wrong, found.mixed, found.twice, found.missing, found.told, found.told_revolutions, found.seq_off)
    assert not any(counts)
    assert found.times_off_ms is not None
    # Live, a packet may wait for the next read until it is joined by another one.
    packet_ms = (stream.form.samples + 2) * stream.form.sample_ns * 1e-6
    assert found.times_off_ms[1] < (0.002 if way == "file" else packet_ms)


def test_a_line_that_is_read_with_each_packet_gives_exact_times() -> None:
    stream, line = _clean("0x85 C1")
    late = Line(line.data, np.repeat(line.at_ns[stream.offsets[1:] - 1], np.diff(stream.offsets)), 0)
    assert np.array_equal(np.unique(late.at_ns), np.unique(line.at_ns[stream.offsets[1:] - 1]))
    found = _scored(stream, line, seed=3)
    assert found.times_off_ms is not None
    assert found.times_off_ms[0] < 4
