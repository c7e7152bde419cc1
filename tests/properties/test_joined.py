"""Joined reads give the scans that they gave one by one, also where a line stalls and loses bytes."""

from itertools import accumulate

import pytest

from lidario.revolution.pipeline import Pipeline
from tests.reference import damage
from tests.support.cases import KINDS, Case
from tests.support.recorded import assert_same_scans
from tests.support.samples import one_a_parser
from tests.support.streams import cut_up, open_stream, stream_of


@one_a_parser(KINDS)
@pytest.mark.exhaustive(
    ("hits", "seed"),
    sample=[(0.0005, 1), (0.002, 3)],
    full=[(hits, seed) for hits in (0.0005, 0.002) for seed in range(6)],
)
def test_joined_reads_give_the_same_scans(case: Case, hits: float, seed: int) -> None:
    """Behind damage a packet may be complete with one read, and told with the next: unknown to scans before it."""
    raw = damage.drop_bytes(2 * case.raw, hits, seed=seed).raw
    turn = len(case.raw) // max(len(case.turns), 1)
    # Mostly a packet or two; now and then what a line held back for most of a revolution, or two.
    pieces = list(cut_up(raw, [*[171] * 20, turn + 31 * seed, *[97] * 30, 2 * turn + 17 * seed]))
    times = [round(end * case.byte_ns) for end in accumulate(map(len, pieces))]
    assert_same(case, pieces, times)


@pytest.mark.long
@one_a_parser(KINDS)
@pytest.mark.parametrize("phase", [0.2, 0.45, 0.7])
def test_joined_reads_behind_a_silence_give_the_same_scans(case: Case, phase: float) -> None:
    """Longer than a revolution may take, and what came meanwhile is lost: nobody read."""
    turn = len(case.raw) // max(len(case.turns), 1)
    before, lost = 2 * len(case.raw) // 3 + round(phase * turn), turn // 3
    raw = 3 * case.raw
    pieces = [*cut_up(raw[:before], [171]), *cut_up(raw[before + lost :], [171])]
    times = [round(end * case.byte_ns) for end in accumulate(map(len, pieces))]
    silence_ns = round(1.5 * stream_of(case).most_ns)
    begin = sum(end <= before for end in accumulate(map(len, pieces)))
    assert_same(case, pieces, [at + silence_ns * (number >= begin) for number, at in enumerate(times)])


def assert_same(case: Case, pieces: list[bytes], times: list[int]) -> None:
    """Pieces of a stream that come at such times give the same scans one by one and joined."""
    one_by_one, whole = (Pipeline(stream_of(case), link=open_stream(case)) for _ in range(2))
    alone = [scan for piece, now in zip(pieces, times, strict=True) for scan in one_by_one.receive(piece, now)]
    ends = list(accumulate(map(len, pieces)))
    together = whole.receive(b"".join(pieces), times[-1], list(zip(ends, times, strict=True))[:-1])
    assert alone
    assert len(alone) == len(together)
    assert_same_scans(alone, together)
