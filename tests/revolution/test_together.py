"""Bytes that were read together are parsed in slices, and the runs of packets in them are one run."""

import pytest

from lidario.revolution.together import joined, slices
from lidario.wire.blocks import Block
from lidario.wire.events import Packets
from lidario.wire.link import Link
from tests.support.cases import KINDS, Case, named
from tests.support.numbered import DENSE
from tests.support.streams import open_stream


def packets_of(link: Link) -> list[Packets]:
    return [event for event in link.events_received() if isinstance(event, Packets)]


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


@pytest.mark.parametrize("cut", [True, False])
def test_whether_the_last_arrival_is_computed_is_told_by_the_last_run(cut: bool) -> None:
    data = DENSE.packets[0]
    first, last = (Packets(data, (Block(len(data), 1),), ((1, at),), cut=at == cut) for at in range(2))
    assert joined([first, last]).cut == cut
