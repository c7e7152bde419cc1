"""The sectors of a revolution are its scan in parts: the same samples, the same times, the same number.

Over every golden stream, in pieces of any size, whole and damaged; and what is counted meanwhile is what an
`Assembler` counts that hands out no sectors.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Sequence
from itertools import accumulate
from typing import NamedTuple

import numpy as np
import pytest

from lidario.revolution.assemble import Assembler, AssemblerStats
from lidario.revolution.sectors import SectorAssembler
from lidario.scan import Scan
from lidario.sector import Sector
from lidario.wire.events import Packets
from tests.support.streams import CASES, Case, Chunks, assembled, cut_up, most_or_all, open_stream
from tests.support.streams import stream_of as described


class Divided(NamedTuple):
    """What became of a stream: scans, the sectors of each size, and the order in which they came."""

    scans: list[Scan]
    sectors: dict[int, list[Sector]]
    stats: AssemblerStats
    order: list[Scan | Sector]


def divided(
    case: Case,
    raw: bytes,
    parts: Sequence[int],
    chunks: Chunks = 64,
    times: Callable[[int], int] | None = None,
    **changes: object,
) -> Divided:
    link = open_stream(case)
    sectors: dict[int, list[Sector]] = defaultdict(list)
    order: list[Scan | Sector] = []

    def publish(count: int, sector: Sector) -> None:
        sectors[count].append(sector)
        order.append(sector)

    assembler = SectorAssembler(Assembler(described(case, **changes)), publish)
    assembler.divide(parts)
    clock = times or (lambda offset: round(offset * case.byte_ns))
    scans: list[Scan] = []
    pieces = list(cut_up(raw, chunks))
    for chunk, end in zip(pieces, accumulate(map(len, pieces)), strict=True):
        link.receive_data(chunk, clock(end))
        for event in link.events_received():
            if isinstance(event, Packets):
                made = assembler.add(event)
                scans += made
                order += made
    return Divided(scans, sectors, assembler.stats, order)


def assert_sum(found: Divided, count: int, *, stamps_ns: float) -> None:
    """The sectors of each revolution that became a scan are that scan."""
    by_seq: dict[int, list[Sector]] = defaultdict(list)
    names = [(sector.seq, sector.index) for sector in found.sectors[count]]
    assert names == sorted(set(names))
    for sector in found.sectors[count]:
        by_seq[sector.seq].append(sector)
    assert by_seq
    seen = 0
    for scan in found.scans:
        sectors = by_seq[scan.seq]
        if not sectors:  # nothing is certain yet
            continue
        seen += 1
        for name in ("device_angles", "device_distances", "intensities", "angles", "ranges"):
            if getattr(scan, name) is None:
                assert all(getattr(sector, name) is None for sector in sectors)
                continue
            parts = [getattr(sector, name) for sector in sectors]
            np.testing.assert_array_equal(np.concatenate(parts), getattr(scan, name))
            assert not any(part.flags.writeable for part in parts)
            assert {part.dtype for part in parts} == {getattr(scan, name).dtype}
        times = np.concatenate([sector.times_ns for sector in sectors])
        late = times - scan.times_ns
        assert np.abs(late).max() <= stamps_ns
        assert {sector.mode for sector in sectors} == {scan.mode}
    assert seen >= len(found.scans) - 1


@most_or_all(CASES)
@pytest.mark.parametrize("chunks", [None, 64, [7, 1, 300, 41]], ids=str)
def test_sectors_are_the_scan(case: Case, chunks: Chunks) -> None:
    found = divided(case, case.raw, (8,), chunks)
    plain = assembled(case, case.raw, chunks)
    packet_ns = case.byte_ns * (max(map(len, case.packets)) + 300)
    assert_sum(found, 8, stamps_ns=packet_ns if chunks else 1e9)
    assert found.stats == plain.stats
    for one, other in zip(found.scans, plain.scans, strict=True):
        np.testing.assert_array_equal(one.device_angles, other.device_angles)
        np.testing.assert_array_equal(one.device_distances, other.device_distances)
        np.testing.assert_array_equal(one.stamp_ns, other.stamp_ns)
        assert (one.seq, one.lost_packets, one.duration_ns) == (other.seq, other.lost_packets, other.duration_ns)
        np.testing.assert_equal(one.rpm, other.rpm)
    for sector in found.sectors[8]:
        assert sector.lost_packets == 0
