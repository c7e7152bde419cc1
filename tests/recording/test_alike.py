"""The check value of what a decoder holds: the same where both go on in the same way, and only there."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from lidario.recording.alike import held
from lidario.recording.read import McapRecording, Piece
from lidario.revolution.pipeline import Pipeline
from tests.support.recorded import record

Reads = list[Piece]


@pytest.fixture(scope="module")
def path(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return record(tmp_path_factory.mktemp("alike") / "a.mcap", "sim://rplidar-s2?fault=drop:0.1%25", 40).path


def behind(path: Path, seen: Callable[[Reads], Reads] = lambda reads: reads) -> Pipeline:
    """A decoder behind a recording, or behind those of its reads that it has seen."""
    recording = McapRecording(path)
    pipeline = Pipeline(recording.streams[0].open())
    for piece in seen(list(recording.pieces())):
        pipeline.receive(piece.data, piece.at_ns)
    return pipeline


@pytest.fixture(scope="module")
def decoder(path: Path) -> Pipeline:
    """One that has seen all of it; a test that changes it changes it back."""
    return behind(path)


@pytest.mark.long
def test_it_is_the_same_of_two_that_have_seen_the_same(path: Path, decoder: Pipeline) -> None:
    assert held(behind(path)) == held(decoder)


@pytest.mark.long
@pytest.mark.parametrize(
    "seen",
    [lambda reads: reads[len(reads) // 4 :], lambda reads: reads[:100] + reads[160:]],
    ids=["began later", "missed a revolution"],
)
def test_of_what_is_long_ago_only_totals_differ(
    path: Path, decoder: Pipeline, seen: Callable[[Reads], Reads]
) -> None:
    other = behind(path, seen)
    assert other.stats != decoder.stats
    assert other.link.fed != decoder.link.fed
    assert held(other) == held(decoder)


SEEN: dict[str, Callable[[Reads], Reads]] = {
    "one read less": lambda reads: reads[:-1],
    "a byte less": lambda reads: [*reads[:-1], reads[-1]._replace(data=reads[-1].data[:-1])],
    "a byte more": lambda reads: [*reads, reads[-1]._replace(data=b"\0")],
    "the last read later": lambda reads: [*reads[:-1], reads[-1]._replace(at_ns=reads[-1].at_ns + 1)],
    "the last revolution not": lambda reads: reads[:-50],
    "a gap in the last revolution": lambda reads: reads[:-20] + reads[-10:],
}


@pytest.mark.long
@pytest.mark.parametrize("seen", SEEN.values(), ids=SEEN)
def test_what_was_seen_last_does(path: Path, decoder: Pipeline, seen: Callable[[Reads], Reads]) -> None:
    assert held(behind(path, seen)) != held(decoder)


@pytest.mark.long
@pytest.mark.parametrize(("name", "value"), [("left_off", (1, 2.0)), ("missed_scans", 7)])
def test_so_does_what_the_next_scan_is_numbered_by(
    decoder: Pipeline, name: str, value: object, monkeypatch: pytest.MonkeyPatch
) -> None:
    before = held(decoder)
    monkeypatch.setattr(decoder.stats, name, value)
    assert held(decoder) != before


class Slot:
    __slots__ = ("_slot",)


class Kept(Slot):
    """An object of ours, with fields that it shows to nobody."""

    __module__ = "lidario.recording"

    def __init__(self, slot: object, other: object) -> None:
        self._slot = slot
        self._other = other


@pytest.mark.parametrize(
    ("one", "other"),
    [
        (1, 2),
        (True, None),
        (b"a", b"b"),
        ([1], (1,)),
        ({1: 2}, {1: 3}),
        (np.zeros(2, np.int32), np.zeros(2, np.float32)),
    ],
)
def test_every_field_of_every_object_is_looked_at(decoder: Pipeline, one: Any, other: Any) -> None:
    alike = held(decoder, Kept(one, Kept(one, one)))
    assert alike == held(decoder, Kept(one, Kept(one, one)))
    for differing in (Kept(other, Kept(one, one)), Kept(one, Kept(other, one)), Kept(one, Kept(one, other))):
        assert held(decoder, differing) != alike


def test_of_what_is_not_known_no_two_are_alike(decoder: Pipeline) -> None:
    unknown = object()
    assert held(decoder, unknown) != held(decoder, unknown)
