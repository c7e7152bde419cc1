"""Noise that passes for a packet: it is dropped, because the rotor was not where it says.

A check value of eight bits lets one of 256 damaged packets pass, and its angle is anything. Taken for true, it
costs its revolution: the angle leaps there and, with the packet behind it, back, which looks like a gap of almost a
turn, or like the end of a revolution.

The packets beside it tell. A rotor turns on by a little from packet to packet, and by a few times that where some
are lost. So of three packets, the one in the middle is false if the third is less than half a turn ahead of the
first, and the one in the middle does not lie between them: else almost a turn would be missing on one side of it.
Until the third has come, the second waits, with what was read with it: only behind a leap, so in an undisturbed
stream nothing does. Where so much is lost that two gaps may well make a whole turn together, nothing is judged.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Final

import numpy as np

from lidario.families.base import Stream
from lidario.revolution.partial import part_of
from lidario.revolution.stats import AssemblerStats
from lidario.wire.blocks import packet_offsets
from lidario.wire.events import Packets
from lidario.wire.formats import HEADING_MASK, Headings

MEASURED: Final = 16
"""The latest advances, of which the mean tells how far the rotor usually turns from one packet to the next."""
CLOSELY: Final = 3
"""Times that mean from which on a packet may be false."""
FARTHEST_TURNS: Final = 1 / 4
"""Part of a turn which the farthest of them may be: beyond, two gaps may make a whole turn together."""
RETREAT_TURNS: Final = 1 / 36
"""Part of a turn by which a heading may tremble back."""


class FalsePackets:
    """Finds the false packets of one stream.

    Formats with packets of several sizes are left alone: their check values have sixteen bits. So are packets of
    one sample, where the angle alone tells nothing.

    Args:
        stream: The stream.
        stats: Where they are counted.
    """

    def __init__(self, stream: Stream, stats: AssemblerStats) -> None:
        wire = stream.format
        self._wire, self._sample_ns, self._stats = wire, stream.sample_ns, stats
        self._can_tell = wire.shortest == wire.longest and wire.samples > 1
        self._full_turn = wire.full_turn
        self._farthest = wire.full_turn * FARTHEST_TURNS
        self._forwards = wire.full_turn * (1 - RETREAT_TURNS)
        self._last = -1
        # The latest advances, and from how far ahead of the one before on a packet may be false: 0 where that is
        # not known.
        self._advances: list[int] = []
        self._closely = 0.0
        self._waiting: Packets | None = None
        # Bytes since the last packet that was true.
        self._skipped = 0

    def tell_time(self, sample_ns: float) -> None:
        """A sample takes so many nanoseconds from now on."""
        self._sample_ns = sample_ns

    def passing(self, headings: Headings) -> list[int] | None:
        """Which of them have passed 0 since the one before, where each is a little ahead of that: all are true.

        So it is also while the speed changes. None where it is not so, or not known.
        """
        if not self._closely or self._skipped or self._waiting is not None:
            return None
        closely, full_turn, last = self._closely / 2, self._full_turn, self._last
        if isinstance(headings, np.ndarray):
            plain = headings & HEADING_MASK
            steps = np.empty_like(plain)
            steps[0] = int(plain[0]) - last
            np.subtract(plain[1:], plain[:-1], out=steps[1:])
            back = (steps < 0).nonzero()[0]
            steps[back] += full_turn
            if not (np.minimum.reduce(steps) > 0 and np.maximum.reduce(steps) < closely):
                return None
            passing, advances, last = back.tolist(), steps[-MEASURED:].tolist(), int(plain[-1])
        else:
            passing, advances = [], []
            for at, heading in enumerate(headings):
                here = heading & HEADING_MASK
                advance = here - last
                if advance < 0:
                    advance += full_turn
                    passing.append(at)
                if not 0 < advance < closely:
                    return None
                advances.append(advance)
                last = here
        self._last = last
        self._advances += advances
        self._measure()
        return passing

    def drop(self, packets: Packets, headings: Headings) -> list[tuple[Packets, Headings]]:
        """The next packets, in pieces between those that are false; without those that wait."""
        if not self._can_tell or self.passing(headings) is not None or self._begins(headings):
            return [(packets, headings)]
        runs = [packets] if self._waiting is None else [self._waiting, packets]
        self._waiting, self._stats.waiting_packets = None, 0
        angles = [int(each) & HEADING_MASK for run in runs for each in self._wire.headings(run)]
        before, end = (self._last, self._advances.copy(), self._closely), len(angles)
        false, waits = self._judge(angles, end)
        if waits:
            # What was read before it goes on; no read is divided, since its time is that of its last packet.
            read = packets.count - (packets.arrivals[-2][0] if len(packets.arrivals) > 1 else 0)
            end -= read
            self._last, self._advances, self._closely = before
            false, _ = self._judge(angles, end)
            self._waiting = self._part(packets, packets.count - read, packets.count)
            self._stats.waiting_packets = read
        self._stats.false_packets += len(false)
        return [(piece, self._wire.headings(piece)) for piece in self._pieces(runs, false, end)]

    def _begins(self, headings: Headings) -> bool:
        """Whether a stream begins with so many packets that the first ones measure all that follow.

        Measured: to judge each of the first 64 KiB makes decoding of a short file take up to 1.4 times as long.
        """
        if self._closely or self._waiting is not None or len(headings) <= MEASURED + 1:
            return False
        before = self._last, self._advances.copy()
        for heading in headings[: MEASURED + 1]:
            self._accept(int(heading) & HEADING_MASK)
        if self.passing(headings[MEASURED + 1 :]) is not None:
            return True
        (self._last, self._advances), self._closely = before, 0.0
        return False

    def _pieces(self, runs: Sequence[Packets], false: Sequence[int], end: int) -> Iterator[Packets]:
        """What lies between the false ones, up to number `end`."""
        begin = 0
        for run in runs:
            first, last = 0, min(run.count, end - begin)
            if last <= 0:
                break
            self._skipped += run.skipped
            for at in [*(at - begin for at in false if begin <= at < begin + run.count), last]:
                if at > first:
                    piece = self._part(run, first, at)
                    # In a file, noise has taken its time, too.
                    yield piece if piece.skipped == self._skipped else replace(piece, skipped=self._skipped)
                    self._skipped = 0
                first = at + 1
                self._skipped += run.blocks[0].size if at < last else 0
            begin += run.count

    def _accept(self, heading: int) -> None:
        """It is true."""
        if self._last >= 0:
            advance = (heading - self._last) % self._full_turn
            if advance < self._forwards:
                self._advances.append(advance)
                self._measure()
        self._last = heading

    def _measure(self) -> None:
        """Where enough have come, find how far the rotor usually turns."""
        latest = self._advances = self._advances[-MEASURED:]
        known = len(latest) == MEASURED and max(latest) <= self._farthest
        self._closely = CLOSELY * sum(latest) / MEASURED if known else 0.0

    def _judge(self, headings: Sequence[int], end: int) -> tuple[list[int], bool]:
        """Which of those before number `end` are false, and whether the last of all has to wait."""
        false = list[int]()
        for at, heading in enumerate(headings[:end]):
            ahead = (heading - self._last) % self._full_turn
            if self._closely and self._closely <= ahead < self._forwards:
                if at + 1 == len(headings):
                    return false, True
                if (headings[at + 1] - self._last) % self._full_turn < min(ahead, self._full_turn // 2):
                    false.append(at)
                    continue
            self._accept(heading)
        return false, False

    def _part(self, packets: Packets, begin: int, end: int) -> Packets:
        if end - begin == packets.count:
            return packets
        return part_of(packets, begin, end, packet_offsets(packets.blocks), self._wire, self._sample_ns)
