"""Two devices in one process share no state."""

from collections.abc import Sequence
from itertools import zip_longest

import pytest

from lidario.revolution.pipeline import Pipeline
from lidario.scans.scan import Scan
from tests.support.cases import CASES, Case
from tests.support.recorded import assert_same_scans
from tests.support.streams import cut_up, open_stream, stream_of


@pytest.mark.long
@pytest.mark.exhaustive("first", sample=CASES[::10], full=CASES)
def test_two_devices_share_nothing(first: Case) -> None:
    """Packet by packet in turns, each gives what it gives alone; both families, and two of one kind."""
    second = CASES[(CASES.index(first) + 5) % len(CASES)]
    for pair in ((first, second), (first, first)):
        for case, together in zip(pair, _scans_of(pair), strict=True):
            (alone,) = _scans_of([case])
            assert len(together) == len(alone) > 0
            assert_same_scans(alone, together)


def _scans_of(cases: Sequence[Case]) -> list[list[Scan]]:
    """The scans of several streams whose bytes come in turns; one of them has lost some."""
    pipelines = [Pipeline(stream_of(case), link=open_stream(case)) for case in cases]
    scans: list[list[Scan]] = [[] for _ in cases]
    streams = (cut_up(case.raw[:600] + case.raw[700:], 300) for case in cases)
    for step, pieces in enumerate(zip_longest(*streams, fillvalue=b"")):
        for pipeline, piece, found in zip(pipelines, pieces, scans, strict=True):
            found += pipeline.receive(piece, step * 1_000_000)
    return scans
