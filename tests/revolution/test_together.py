"""Runs of packets that were read together are one run."""

from itertools import pairwise

import pytest

from lidario.revolution.together import joined, slices
from lidario.wire.blocks import Block
from lidario.wire.events import Packets
from lidario.wire.link import Link
from tests.support.cases import KINDS, Case, named
from tests.support.numbered import DENSE
from tests.support.streams import cut_up, open_stream


def runs_of(case: Case, chunk: int, every: int) -> list[Packets]:
    """The packets of its stream in chunks, as many of which arrive at the same time."""
    link = open_stream(case)
    for number, piece in enumerate(cut_up(case.raw, chunk)):
        link.receive_data(piece, number // every)
    return packets_of(link)


def packets_of(link: Link) -> list[Packets]:
    return [event for event in link.events_received() if isinstance(event, Packets)]


@pytest.mark.exhaustive("case", sample=KINDS)
@pytest.mark.parametrize("every", [1, 3, 10**6])
def test_they_are_joined_with_the_time_of_each_read(case: Case, every: int) -> None:
    runs = runs_of(case, 1000, every)
    whole = joined(runs)
    assert whole.data == b"".join(run.data for run in runs)
    assert whole.count == sum(run.count for run in runs) == whole.arrivals[-1][0]
    assert sum(block.size * block.packets for block in whole.blocks) == len(whole.data)
    times = [at for _, at in whole.arrivals]
    assert times == sorted({at for run in runs for _, at in run.arrivals})
    assert all(one[0] < other[0] for one, other in pairwise(whole.arrivals))
    # How many of them had come by then.
    came = 0
    expected: dict[int, int] = {}
    for run in runs:
        for count, at in run.arrivals:
            expected[at] = came + count
        came += run.count
    assert {at: count for count, at in whole.arrivals} == expected


@pytest.mark.parametrize("case", KINDS[::3], ids=named)
@pytest.mark.parametrize("most", [100, 1000, 10**6])
def test_slices_are_the_same_bytes_with_the_same_times(case: Case, most: int) -> None:
    data = case.raw[:20_000]
    arrivals = [(at, at * 7) for at in range(333, len(data), 333)]
    whole, cut = open_stream(case), open_stream(case)
    whole.receive_data(data, len(data) * 7, arrivals)
    for piece, now, came in slices(data, len(data) * 7, arrivals, most):
        assert len(piece) <= most
        assert all(0 < size < len(piece) for size, _ in came)
        cut.receive_data(piece, now, came)
    assert joined(packets_of(cut)) == joined(packets_of(whole))
    assert cut.stats == whole.stats


def test_where_bytes_were_skipped_stays_known() -> None:
    case = DENSE
    link, size = open_stream(case), 3 * len(case.packets[0])
    packets = b"".join(case.packets)
    for begin in range(0, 4 * size, size):
        link.receive_data(packets[begin : begin + size] + bytes(7), 1)
    whole = joined(packets_of(link))
    assert whole.skips == ((3, 7), (6, 7), (9, 7))
    assert whole.skipped == 0


@pytest.mark.parametrize("cut", [True, False])
def test_whether_the_last_arrival_is_computed_is_told_by_the_last_run(cut: bool) -> None:
    data = DENSE.packets[0]
    first, last = (Packets(data, (Block(len(data), 1),), ((1, at),), cut=at == cut) for at in range(2))
    assert joined([first, last]).cut == cut
