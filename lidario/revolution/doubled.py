"""Drops packets that a line delivers twice, or a few times: only the first one stays.

A packet states where it begins, and the rotor has turned when the next one begins. So a packet that equals the one
before it in all bytes, with heading and check value, is that packet once more, unless so much time lies between
them that the rotor may have turned once. If it stayed, the angle would seem to go back, and a start packet would
begin a second revolution. If very many packets are equal, the rotor stands still. These stay, since they show that
nothing is missing meanwhile.

A packet of one sample without a check value (`StreamFormat.samples` is 1, and all have one size) is never dropped:
two samples of a slow rotor may be equal.
"""

from bisect import bisect_left
from collections.abc import Sequence
from itertools import pairwise
from typing import Final

import numpy as np

from lidario.revolution.partial import part_of
from lidario.revolution.stats import AssemblerStats
from lidario.wire.blocks import Block, join_blocks, packet_offsets
from lidario.wire.events import Arrival, Packets
from lidario.wire.formats import Headings, StreamFormat

FASTEST_TURN_NS: Final = 25_000_000
"""No rotor takes less for a revolution: two equal packets that are farther apart belong to two revolutions."""
MOST_ALIKE: Final = 4
"""A line delivers a packet at most this often; if more are equal, the rotor stands still."""


class DoubledPackets:
    """Finds packets of one stream that came twice.

    Args:
        wire: The format.
        sample_ns: Nanoseconds a sample; 0 where the device does not say.
        stats: Counts the packets that came twice.
    """

    def __init__(self, wire: StreamFormat, sample_ns: float, stats: AssemblerStats) -> None:
        self._wire, self._sample_ns, self._stats = wire, sample_ns, stats
        self._can_tell = wire.shortest != wire.longest or wire.samples > 1
        self.before: Packets | None = None  # the packets that came last; None at the beginning
        self.alike: int = 1  # how many at their end are alike

    def tell_time(self, sample_ns: float) -> None:
        """A sample takes so many nanoseconds from now on."""
        self._sample_ns = sample_ns

    def drop(self, packets: Packets, headings: Headings) -> tuple[Packets, Headings]:
        """The next packets without those that came twice, and their headings; perhaps none are left."""
        found = self._find(packets, headings) if self._can_tell else ()
        if not found:
            return packets, headings
        self._stats.doubled_packets += len(found)
        left = without(packets, found)
        return left, self._wire.headings(left) if left.data else ()

    def _find(self, packets: Packets, headings: Headings) -> list[int]:
        """Numbers of the next packets that are the packet before once more; mostly none."""
        if isinstance(headings, np.ndarray):
            same = ((headings[1:] == headings[:-1]).nonzero()[0] + 1).tolist()
        else:
            same = [at for at, (before, here) in enumerate(pairwise(headings), 1) if before == here]
        last = b"" if self.before is None else self.before.data[-self.before.blocks[-1].size :]
        # Packets with skipped bytes between them may be far apart; in a file, nothing else shows it.
        if last and packets.data[: packets.blocks[0].size] == last and packets.skipped <= len(last):
            same = [0, *same]
        found = self._among(packets, same) if same else []
        if not same or same[-1] != packets.count - 1:
            self.alike = 1
        self.before = packets
        return found

    def _among(self, packets: Packets, same: Sequence[int]) -> list[int]:
        """Numbers of those that are the packet before once more, among the numbers with `same` headings."""
        data, offsets = packets.data, packet_offsets(packets.blocks)
        found, previous = list[int](), -1
        for at in same:
            if at - 1 != previous:
                self.alike = 1
            previous = at
            here = data[offsets[at] : offsets[at + 1]]
            self.alike = self.alike + 1 if not at or here == data[offsets[at - 1] : offsets[at]] else 1
            if 1 < self.alike <= MOST_ALIKE and self._apart_ns(packets, at, offsets) < FASTEST_TURN_NS:
                found.append(at)
        return found

    def _apart_ns(self, packets: Packets, number: int, offsets: Sequence[int]) -> int:
        """How long after the packet before it a packet came."""
        came_ns = part_of(packets, number, number + 1, offsets, self._wire, self._sample_ns).received_ns
        if not number:
            assert self.before is not None
            return came_ns - self.before.received_ns
        return came_ns - part_of(packets, number - 1, number, offsets, self._wire, self._sample_ns).received_ns


def without(packets: Packets, dropped: Sequence[int], *, as_noise: bool = False) -> Packets:
    """The same packets without those `dropped` (ascending numbers); `as_noise` counts their bytes as skipped."""
    offsets, gone = packet_offsets(packets.blocks), set(dropped)
    kept = [at for at in range(packets.count) if at not in gone]
    blocks: list[Block] = []
    join_blocks(blocks, [Block(offsets[at + 1] - offsets[at], 1) for at in kept])
    arrivals: list[Arrival] = []
    for count, at_ns in packets.arrivals:
        left = count - sum(1 for at in dropped if at < count)
        if left and (not arrivals or left > arrivals[-1][0]):
            arrivals.append((left, at_ns))
    data = b"".join([packets.data[offsets[at] : offsets[at + 1]] for at in kept])
    skips = dict[int, int]()
    noise = [(at, offsets[at + 1] - offsets[at]) for at in dropped] if as_noise else []
    for at, size in sorted([*packets.skips, *noise]):
        place = at - bisect_left(dropped, at)
        skips[place] = skips.get(place, 0) + size
    return Packets(data, tuple(blocks), tuple(arrivals), tuple(skips.items()))
