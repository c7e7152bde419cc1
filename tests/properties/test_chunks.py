"""What a link makes of a stream does not depend on how the stream was chopped."""

from itertools import cycle

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from lidario.wire.events import Event, merged
from tests.reference import damage
from tests.support.harm import messes
from tests.support.streams import KINDS, Case, Received, assembled, cut_up, feed, named, open_stream

every_kind = pytest.mark.parametrize("case", KINDS, ids=named)
HARM = {"flips": damage.flip, "lost bytes": damage.drop_bytes, "added bytes": damage.insert_bytes}


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


@every_kind
@given(st.data())
def test_bytes_that_lay_uncut_for_a_while_give_the_same_events(case: Case, data: st.DataObject) -> None:
    raw = data.draw(messes(case), "raw") + b"".join(case.packets[:20])
    sizes = data.draw(st.lists(st.integers(1, 3 * len(case.packets[-1])), min_size=1, max_size=12), "sizes")
    holds = data.draw(st.lists(st.booleans(), min_size=len(sizes), max_size=len(sizes)), "holds")
    link, events = open_stream(case), list[Event]()
    for piece, hold in zip(cut_up(raw, sizes), cycle(holds)):
        link.hold(1 if hold else 0)
        link.receive_data(piece, 0)
        events += link.events_received()
    link.hold(0)
    link.receive_data(b"", 0)
    events += link.events_received()
    assert Received(merged(events), link.stats, link.buffered) == feed(case, raw)


@every_kind
def test_what_is_held_is_bounded(case: Case) -> None:
    link = open_stream(case)
    link.hold(1)
    for _ in range(100):
        for piece in cut_up(case.raw[:2000], 500):
            link.receive_data(piece, 0)
            assert link.buffered < 34_000
    assert link.stats.packets > 100


@every_kind
@pytest.mark.parametrize("harm", HARM)
@pytest.mark.parametrize("hits", [0.1, 0.3, 1.0])
def test_a_long_damaged_stream_gives_the_same_events(case: Case, harm: str, hits: float) -> None:
    """So many hits a packet; long enough that the link takes the stream in several slices."""
    raw = HARM[harm](case.raw, hits / max(len(case.packets[-1]), 80), seed=len(case.name)).raw[:40_000]
    whole = feed(case, raw)
    assert len(whole.events) > 3
    for chunks in (1, 64, [3, 5, 700, 1, 20_000], len(raw) // 2 + 1):
        assert feed(case, raw, chunks).events == whole.events, chunks


@every_kind
@pytest.mark.parametrize("harm", HARM)
def test_the_scans_are_the_same_too(case: Case, harm: str) -> None:
    raw = HARM[harm](case.raw, 0.001, seed=5).raw
    results = [assembled(case, raw, chunks, times=lambda _: 0) for chunks in (None, 1, 64)]
    assert results[0].scans
    for scans, stats, _ in results[1:]:
        assert stats == results[0].stats
        for scan, same in zip(scans, results[0].scans, strict=True):
            np.testing.assert_array_equal(scan.device_angles, same.device_angles)
            np.testing.assert_array_equal(scan.device_distances, same.device_distances)
            assert (scan.lost_packets, scan.seq) == (same.lost_packets, same.seq)
