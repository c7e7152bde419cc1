"""What a link makes of a stream does not depend on how the stream was chopped."""

from itertools import cycle

import pytest
from hypothesis import given
from hypothesis import strategies as st

from lidario.wire.blocks import packet_offsets
from lidario.wire.events import Packets
from tests.support.cases import KINDS, Case
from tests.support.harm import messes
from tests.support.samples import one_a_parser
from tests.support.streams import cut_up, feed, open_stream

every_kind = one_a_parser(KINDS)


@pytest.mark.long
@every_kind
@given(st.data())
def test_any_mess_gives_the_same_events(case: Case, data: st.DataObject) -> None:
    raw = data.draw(messes(case), "raw")
    chunks = data.draw(st.lists(st.integers(1, 2 * len(case.packets[-1])), min_size=1, max_size=8), "chunks")
    whole = feed(case, raw)
    assert feed(case, raw, 1).events == whole.events
    assert feed(case, raw, chunks).events == whole.events
    # Behind enough clean packets, nothing is left undecided and the counters agree as well.
    raw += b"".join(case.packets[-60:] if len(case.packets[0]) == 5 else case.packets[-4:])
    settled = feed(case, raw)
    assert feed(case, raw, 1) == settled
    assert feed(case, raw, chunks) == settled


def packet_arrivals(packets: Packets) -> list[int]:
    """When each of them had come."""
    times: list[int] = []
    for count, at_ns in packets.arrivals:
        assert len(times) < count <= packets.count
        times += [at_ns] * (count - len(times))
    assert len(times) == packets.count
    return times


@pytest.mark.long
@every_kind
@given(st.data())
def test_several_reads_handed_over_together_tell_the_same_times(case: Case, data: st.DataObject) -> None:
    """One packet, one arrival: that of the read which completed it, or of a later one that made it certain."""
    raw = data.draw(messes(case), "raw") + b"".join(case.packets[:20])
    sizes = data.draw(st.lists(st.integers(1, 3 * len(case.packets[-1])), min_size=1, max_size=12), "sizes")
    waits = data.draw(st.lists(st.booleans(), min_size=len(sizes), max_size=len(sizes)), "waits")
    alone, together = open_stream(case), open_stream(case)
    pending, reads = b"", list[tuple[int, int]]()
    found: list[list[tuple[bytes, list[int]]]] = [[], []]
    pieces = list(cut_up(raw, sizes))
    for now, (piece, wait) in enumerate(zip(pieces, cycle(waits))):
        alone.receive_data(piece, now)
        pending += piece
        if wait and now < len(pieces) - 1:
            reads.append((len(pending), now))
            continue
        together.receive_data(pending, now, reads)
        pending, reads = b"", []
        for link, into in zip((alone, together), found, strict=True):
            for event in link.events_received():
                if isinstance(event, Packets):
                    into.append((event.data, packet_arrivals(event)))
    assert (alone.stats, alone.buffered) == (together.stats, together.buffered)
    data_alone, data_together = (b"".join(data for data, _ in events) for events in found)
    assert data_alone == data_together
    times_alone, times_together = ([at for _, times in events for at in times] for events in found)
    # A packet that needs those behind it as a proof, or that stands behind a false beginning which is still
    # incomplete, is certain later than it is complete.
    assert all(late >= complete for late, complete in zip(times_alone, times_together, strict=True))
    if case.make_format().self_evident and not alone.stats.skipped_bytes:
        # Noise that begins like a longer packet is judged only when as many bytes have come.
        assert times_alone == times_together


@every_kind
@pytest.mark.parametrize("read", [700, 40_000])
def test_a_clean_stream_collected_from_reads_of_any_size(case: Case, read: int) -> None:
    """Also where the whole is larger than what the link takes at once."""
    raw = case.raw * (1 + 100_000 // len(case.raw))
    ends = [*range(read, len(raw), read)]
    link = open_stream(case)
    link.receive_data(raw, len(raw), [(end, end) for end in ends])
    events = [event for event in link.events_received() if isinstance(event, Packets)]
    at = raw.index(events[0].data)
    for event in events:
        offsets = packet_offsets(event.blocks)
        for end, time in zip(offsets[1:], packet_arrivals(event), strict=True):
            assert time == min(len(raw), -(-(at + end) // read) * read)
        at += len(event.data)
    assert at > 90_000
