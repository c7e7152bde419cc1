"""The revolution in the making: everything that is known of it before it ends.

It has two parts. The first are samples of the packet at the seam, which was decoded with the revolution before. The
second are the packets after it, which stay bytes until the revolution ends.
"""

from __future__ import annotations

from bisect import bisect_left, bisect_right
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from operator import itemgetter
from typing import TYPE_CHECKING, Final

import numpy as np
from numpy.typing import NDArray

from lidario.families.base import Samples
from lidario.revolution.together import joined
from lidario.wire.blocks import packet_offsets, some_blocks
from lidario.wire.events import Packets
from lidario.wire.formats import StreamFormat

if TYPE_CHECKING:
    from lidario.revolution.divided import DividedRevolution

_first_of = itemgetter(0)

MOST_IN_A_PART: Final = 2048
"""Most packets taken at a time: several revolutions of most formats, which are decoded as one block."""


@dataclass(slots=True, eq=False)
class SampleArrays:
    """Samples in measuring order; shape (n,) each."""

    angle: NDArray[np.float32]  # degrees clockwise, float32, as the device counts them
    distance: NDArray[np.float32]  # millimetres, float32; 0 where nothing came back
    intensity: NDArray[np.uint8] | None  # uint8, or None where the format carries none

    def __len__(self) -> int:
        return len(self.angle)

    def part(self, begin: int, end: int | None = None) -> SampleArrays:
        """The samples from number `begin` to before number `end`; nothing is copied."""
        intensity = None if self.intensity is None else self.intensity[begin:end]
        return SampleArrays(self.angle[begin:end], self.distance[begin:end], intensity)

    def begin_with(self, earlier: SampleArrays) -> None:
        """Fill the front of the arrays, which was left free, with `earlier`."""
        room = len(earlier.angle)
        self.angle[:room] = earlier.angle
        self.distance[:room] = earlier.distance
        if self.intensity is not None and earlier.intensity is not None:
            self.intensity[:room] = earlier.intensity


@dataclass(slots=True, eq=False)
class PartialRevolution:
    """The revolution in the making."""

    whole: bool  # whether it began at the seam, so that it can become a scan
    moved: bool = False  # whether it began at a mark that stood elsewhere than the mark before
    seam: int | None = None  # heading at which it should have begun; None if no split began it
    behind_gap: bool = True  # whether packets may be missing right before its first one
    # Its own packets that are missing right before its first one; they are counted with the revolution before.
    lost_before: int = 0
    carried: SampleArrays | None = None  # samples from the packet that crossed the seam at its beginning, if any
    carried_ns: int = 0  # arrival of the last packet before it; 0 if there was none
    lost_behind_carried: int = 0  # packets missing right behind the packet that crossed the seam
    skipped_behind_carried: int = 0  # samples of these missing packets
    # Packets of a revolution, as far as known when the packet at the seam was decoded; 0 if angles were certain.
    carried_packets: float = 0.0
    begun_ns: int = 0  # arrival of the read with its beginning; 0 if unknown
    ended_ns: int = 0  # arrival of the read with its end; 0 if unknown
    runs: list[Packets] = field(default_factory=list)  # its packets, as they were reported
    size: int = 0  # bytes of these packets
    divided: DividedRevolution | None = None  # its sectors and decoded pieces, if somebody reads sectors

    def packets(self) -> Packets | None:
        """All its packets as one run; None if it has none."""
        return joined(self.runs) if self.runs else None

    def carry(self, arrays: SampleArrays, samples: Samples) -> None:
        """Begin with the samples that lie behind the seam in the last packet of the revolution before.

        Args:
            arrays: These samples.
            samples: The decoded packets of the revolution before.
        """
        self.carried = arrays
        self.lost_behind_carried = samples.lost_behind
        self.skipped_behind_carried = samples.skipped_behind
        self.carried_packets = 0.0 if samples.certain else samples.last.packets

    def gaps(self, samples: Samples, room: int, crossed: int, *, revoked: bool) -> list[tuple[int, int]] | None:
        """Where samples are missing in it: pairs, how many of its own come before, and how many are missing.

        Args:
            samples: Its packets, decoded.
            room: How many samples were carried over.
            crossed: How many samples belong to it, with those that were carried over.
            revoked: Whether the samples that were carried over are dropped.

        Returns:
            The pairs; None if they are not certain.
        """
        if not samples.certain:
            return None
        gaps = [(room + before, skipped) for before, skipped in samples.gaps]
        if room and self.skipped_behind_carried:
            gaps.insert(0, (room, self.skipped_behind_carried))
        first = room if revoked else 0
        return [(at - first, skipped) for at, skipped in gaps if first < at < crossed]

    @property
    def read_ns(self) -> int:
        """Time from the read with its beginning to the read with its end; 0 if unknown."""
        return self.ended_ns - self.begun_ns if self.begun_ns else 0

    def silences_ns(self, packets: Packets, packet_ns: float) -> Sequence[float]:
        """For each of its reads how long nothing was measured before it, as in `Beginning.silences_ns`.

        Args:
            packets: Its packets.
            packet_ns: Time of a packet.
        """
        if not self.begun_ns:
            return ()
        reads = [(0, self.carried_ns), *packets.arrivals]
        if not packets.cut:
            reads.append((packets.count, self.ended_ns))
        return [
            at_ns - before_ns - (count - before) * packet_ns
            for (before, before_ns), (count, at_ns) in pairwise(reads)
        ]

    @property
    def last_ns(self) -> int:
        """Arrival of its latest packet."""
        return self.runs[-1].arrivals[-1][1] if self.runs else self.carried_ns


def part_of(
    packets: Packets,
    begin: int,
    end: int,
    offsets: Sequence[int] | None,
    wire: StreamFormat,
    sample_ns: float,
    ended_ns: int | None = None,
) -> Packets:
    """The packets from number `begin` to before number `end`, with their arrivals.

    Args:
        packets: A run of packets.
        begin: Number of the first packet.
        end: Number of the packet behind the last one.
        offsets: Where each packet begins, if that is known already (`packet_offsets`).
        wire: The format of the packets.
        sample_ns: Nanoseconds a sample; 0 where the device does not say.
        ended_ns: When the last of them came, where that is known better than by the packets behind it in its read.
    """
    offsets = offsets or packet_offsets(packets.blocks)
    blocks = some_blocks(packets.blocks, begin, end)
    # In a file without times each packet may have its own arrival, and a run has those of a hundred revolutions.
    first = bisect_right(packets.arrivals, begin, key=_first_of)
    last = bisect_left(packets.arrivals, end, key=_first_of)
    arrivals = [(complete - begin, at_ns) for complete, at_ns in packets.arrivals[first:last]]
    complete, at_ns = packets.arrivals[last]
    if complete > end:
        # Later packets came with the same read, so these were late by the time that it took to measure those.
        later = some_blocks(packets.blocks, end, complete)
        at_ns = at_ns - round(wire.samples_in(later) * sample_ns) if ended_ns is None else ended_ns
    arrivals.append((end - begin, at_ns))
    skips = packets.skips
    if skips:
        inside = bisect_left(skips, begin, key=_first_of), bisect_left(skips, end, key=_first_of)
        skips = tuple([(at - begin, size) for at, size in skips[slice(*inside)]])
    cut = complete > end or (packets.cut and end == packets.count)
    return Packets(packets.data[offsets[begin] : offsets[end]], blocks, tuple(arrivals), skips, cut=cut)


def parts_of(packets: Packets, wire: StreamFormat, sample_ns: float) -> Iterator[Packets]:
    """The same packets in parts, so that finding where revolutions end in a part takes a bounded time."""
    offsets = packet_offsets(packets.blocks)
    for begin in range(0, packets.count, MOST_IN_A_PART):
        end = min(begin + MOST_IN_A_PART, packets.count)
        yield part_of(packets, begin, end, offsets, wire, sample_ns)
