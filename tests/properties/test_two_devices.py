"""Two devices in one process share no state."""

from collections.abc import Sequence

import numpy as np
import pytest

from lidario.revolution.assemble import Assembler
from lidario.scans.scan import Scan
from lidario.wire.events import Packets
from tests.support.cases import CASES, Case
from tests.support.streams import cut_up, open_stream, stream_of


@pytest.mark.long
@pytest.mark.exhaustive("first", sample=CASES[::10], full=CASES)
def test_two_devices_share_nothing(first: Case) -> None:
    """Packet by packet in turns, each gives what it gives alone; both families, and two of one kind."""
    second = CASES[(CASES.index(first) + 5) % len(CASES)]
    for pair in ((first, second), (first, first)):
        alone = [_scans_of([case])[0] for case in pair]
        for together, expected in zip(_scans_of(pair), alone, strict=True):
            assert len(together) == len(expected) > 0
            for scan, same in zip(together, expected, strict=True):
                np.testing.assert_array_equal(scan.device_angles, same.device_angles)
                np.testing.assert_array_equal(scan.device_distances, same.device_distances)
                assert (scan.stamp_ns, scan.seq, scan.lost_packets) == (same.stamp_ns, same.seq, same.lost_packets)


def _scans_of(cases: Sequence[Case]) -> list[list[Scan]]:
    """The scans of several streams whose bytes come in turns; one of them has lost some."""
    links = [open_stream(case) for case in cases]
    assemblers = [Assembler(stream_of(case)) for case in cases]
    streams = [list(cut_up(case.raw[:600] + case.raw[700:], 300)) for case in cases]
    scans: list[list[Scan]] = [[] for _ in cases]
    for step in range(max(map(len, streams))):
        for number, pieces in enumerate(streams):
            if step < len(pieces):
                links[number].receive_data(pieces[step], step * 1_000_000)
                for event in links[number].events_received():
                    if isinstance(event, Packets):
                        scans[number] += assemblers[number].add(event)
    return scans
