"""The check value of what a decoder holds: the same where both go on in the same way, and only there."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path

import pytest

from lidario.recording.alike import held
from lidario.recording.read import McapRecording
from lidario.revolution.pipeline import Pipeline
from tests.support.recorded import record


@pytest.fixture(scope="module")
def path(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return record(tmp_path_factory.mktemp("alike") / "a.mcap", "sim://rplidar-s2?fault=drop:0.1%25", 20).path


def behind(path: Path) -> Pipeline:
    """A decoder behind the whole of a recording."""
    recording = McapRecording(path)
    pipeline = Pipeline(recording.streams[0].open())
    for piece in recording.pieces():
        pipeline.receive(piece.data, piece.at_ns)
    return pipeline


def more_totals(pipeline: Pipeline) -> None:
    """As of a decoder that saw more before: a broken scan, and packets that are lost."""
    stats, clock = pipeline.stats, pipeline.assembler._clock
    stats.broken_scans += 1
    stats.missed_scans += 3
    stats.lost_packets += 70
    pipeline.link.fed += 5000
    pipeline.link.stats.packets += 100
    for each in {id(each): each for each in (clock._last, clock._sure, clock._anchor) if each is not None}.values():
        each.number += 3
        each.packets_before += 70


CHANGES: list[Callable[[Pipeline], None]] = [
    lambda pipeline: setattr(pipeline.stream.format, "_in_step", not pipeline.stream.format._in_step),
    lambda pipeline: setattr(pipeline.link, "_noise", pipeline.link._noise + 1),
    lambda pipeline: setattr(pipeline.stats, "left_off", (1, 2.0)),
    lambda pipeline: setattr(pipeline.stats, "missed_scans", pipeline.stats.missed_scans + 1),
    lambda pipeline: setattr(pipeline.assembler.partial.carried, "angle", None),
    lambda pipeline: setattr(pipeline.assembler, "_last_spanned_ns", 1.0),
    lambda pipeline: setattr(pipeline.assembler._seam, "_armed", not pipeline.assembler._seam._armed),
    lambda pipeline: setattr(pipeline.assembler.incoming.time, "ns", 1.0),
    lambda pipeline: setattr(pipeline.stream.decoder, "anything", re.compile("new")),
]


def test_it_is_the_same_of_two_that_have_seen_the_same(path: Path) -> None:
    assert held(behind(path)) == held(behind(path))


def test_totals_make_no_difference(path: Path) -> None:
    other = behind(path)
    more_totals(other)
    assert held(other) == held(behind(path))


@pytest.mark.parametrize("change", CHANGES)
def test_everything_else_does(path: Path, change: Callable[[Pipeline], None]) -> None:
    other = behind(path)
    change(other)
    assert held(other) != held(behind(path))


def test_what_is_remembered_beside_counts(path: Path) -> None:
    pipeline = behind(path)
    assert held(pipeline, 1, (2, 3.0)) == held(pipeline, 1, (2, 3.0)) != held(pipeline, 1, (2, 4.0))


def test_of_what_is_not_known_no_two_are_alike(path: Path) -> None:
    pipeline, unknown = behind(path), object()
    assert held(pipeline, unknown) != held(pipeline, unknown)
