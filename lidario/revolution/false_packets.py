"""Noise that passes for a packet: it is dropped, because the rotor was not where it says.

A check value of eight bits lets one of 256 damaged packets pass, or even one of eight of two flipped bits, and its
angle is anything. Taken for true, its samples stand where nothing was measured, or the angle leaps there and, with
the packet behind it, back, which looks like a gap of almost a turn, or like the end of a revolution.

The packets beside it tell. A rotor turns on from packet to packet by at least an arc, and what was skipped as noise
between them took its time on the line, too: an arc for as many bytes as a packet has. Packets that are gone only
add to that. So of three packets, the one in the middle is false if there is room for both before the third, and it
does not lie there; unless the third follows it, for a device may write text between and within its packets, and
then more was skipped than the rotor turned. Until the third has come, the second waits: only where it is not as far
ahead as its bytes tell, so in an undisturbed stream nothing does. Where so much is gone that two gaps may well make
a whole turn together, nothing is judged.
"""

from __future__ import annotations

from collections.abc import Sequence
from operator import sub
from typing import Final

import numpy as np

from lidario.families.base import Stream
from lidario.families.spans import LIKENESS
from lidario.revolution.doubled import without
from lidario.revolution.partial import part_of
from lidario.revolution.stats import AssemblerStats
from lidario.revolution.together import joined
from lidario.wire.blocks import packet_offsets
from lidario.wire.events import Packets
from lidario.wire.formats import HEADING_MASK, Headings

MEASURED: Final = 16
"""The latest advances, which tell how far the rotor turns from one packet to the next."""
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
        # How far the rotor turned from each of the latest to the next one, for as many bytes as a packet has: at
        # least, and on average; neither is known while that is 0.
        self._advances: list[float] = []
        self._arc = self._mean = 0.0
        # What of it may be the speed that changes: a part of the fastest turning, as the slower a rotor turns, the
        # more any change is for it. Angles are rounded.
        self._slack = 1.0
        self._waiting: Packets | None = None

    def tell_time(self, sample_ns: float) -> None:
        """A sample takes so many nanoseconds from now on."""
        self._sample_ns = sample_ns

    def passing(self, headings: Headings, skips: Sequence[tuple[int, int]] = ()) -> list[int] | None:
        """Which of them have passed 0 since the one before, where each is a little ahead of that: all are true.

        So it is also while the speed changes. None where it is not so, or not known, or bytes were skipped.
        """
        if not self._mean or skips or self._waiting is not None:
            return None
        least, most = max(0.0, self._arc - self._slack), self._mean + self._slack
        full_turn, last = self._full_turn, self._last
        if isinstance(headings, np.ndarray):
            plain = headings & HEADING_MASK
            steps = np.empty_like(plain)
            steps[0] = int(plain[0]) - last
            np.subtract(plain[1:], plain[:-1], out=steps[1:])
            back = (steps < 0).nonzero()[0]
            steps[back] += full_turn
            if not (np.minimum.reduce(steps) > least and np.maximum.reduce(steps) <= most):
                return None
            passing, advances, last = back.tolist(), steps[-MEASURED:].tolist(), int(plain[-1])
        else:
            # Some dozen packets, once a revolution: built-in functions take a tenth of what a loop takes.
            few = headings if max(headings) <= HEADING_MASK else [heading & HEADING_MASK for heading in headings]
            advances, passing = list(map(sub, few, (last, *few[:-1]))), []
            while (least_here := min(advances)) < 0:
                at = advances.index(least_here)
                advances[at] += full_turn
                passing.append(at)
            if not least < least_here <= max(advances) <= most:
                return None
            passing.sort()
            last = few[-1]
        self._last = last
        self._advances += advances
        self._measure()
        return passing

    def drop(self, packets: Packets, headings: Headings) -> tuple[Packets, Headings]:
        """The next packets, perhaps none, and their headings; without those that are false or wait."""
        judged = self._can_tell and self.passing(headings, packets.skips) is None
        if not judged or self._begins(packets, headings) or self._goes_on(packets, headings):
            return packets, headings
        run = packets if (waiting := self.left()) is None else joined([waiting, packets])
        false, waits = self._judge([int(each) & HEADING_MASK for each in self._wire.headings(run)], run.skips)
        self._stats.false_packets += len(false)
        # The time that they took has passed all the same.
        run = without(run, false, as_noise=True) if false else run
        if waits:
            last = run.count - 1
            self._waiting = self._part(run, last, run.count)
            self._stats.waiting_packets += 1
            run = self._part(run, 0, last)
        return run, self._wire.headings(run) if run.data else ()

    def left(self) -> Packets | None:
        """The packet that waits, which does so no longer; None where none does."""
        waiting, self._waiting = self._waiting, None
        self._stats.waiting_packets -= waiting is not None
        return waiting

    def _begins(self, packets: Packets, headings: Headings) -> bool:
        """Whether a stream begins with so many packets that the first ones measure all that follow.

        Measured: to judge each of the first 64 KiB makes decoding of a short file take up to 1.4 times as long.
        """
        first, others = headings[: MEASURED + 1], headings[MEASURED + 1 :]
        if self._mean or not len(others) or packets.skips:
            return False
        before = self._last, self._advances.copy()
        for heading in first:
            self._accept(int(heading) & HEADING_MASK, 1.0)
        if self.passing(others) is not None:
            return True
        (self._last, self._advances), self._mean = before, 0.0
        return False

    def _goes_on(self, packets: Packets, headings: Headings) -> bool:
        """Whether only the first packet stands behind skipped bytes, where they tell, and all others follow it."""
        if not self._mean or self._waiting is not None or len(packets.skips) != bool(packets.skipped):
            return False
        before = self._last, self._advances.copy(), self._arc, self._mean
        heading, behind = int(headings[0]) & HEADING_MASK, 1 + packets.skipped / self._wire.shortest
        if not self._is_odd(self._beyond(heading, behind, self._last), behind):
            self._accept(heading, behind)
            if len(headings) == 1 or self.passing(headings[1:]) is not None:
                return True
        self._last, self._advances, self._arc, self._mean = before
        return False

    def _accept(self, heading: int, behind: float) -> None:
        """It is true, and so many packets by its bytes behind the one before."""
        # Of more packets, each of which may be as far, a whole turn may hide in it.
        if self._last >= 0 and behind * self._farthest <= self._full_turn:
            advance = (heading - self._last) % self._full_turn
            if advance < self._forwards:
                self._advances.append(advance / behind)
                self._measure()
        self._last = heading

    def _measure(self) -> None:
        """Where enough have come, find how far the rotor turns."""
        latest = self._advances = self._advances[-MEASURED:]
        self._mean = 0.0
        if len(latest) == MEASURED and max(latest) <= self._farthest:
            self._arc, self._mean = min(latest), sum(latest) / MEASURED
            self._slack = max(self._slack, LIKENESS * self._arc + 1)

    def _judge(self, headings: Sequence[int], skips: Sequence[tuple[int, int]]) -> tuple[list[int], bool]:
        """Which of them are false, and whether the last one has to wait; the skips are those of `Packets`."""
        false = list[int]()
        # As many packets as the bytes make from the last true one to this one, and to the one behind it.
        noise, behind, packet = dict(skips), 0.0, self._wire.shortest
        for at, heading in enumerate(headings):
            behind += 1 + noise.get(at, 0) / packet
            beyond = self._beyond(heading, behind, self._last)
            if self._is_odd(beyond, behind):
                if at + 1 == len(headings):
                    return false, True
                between = 1 + noise.get(at + 1, 0) / packet
                third = behind + between
                # Without it, at most half as much is missing, or it falls back behind where it should be; and the
                # one behind it does not follow it.
                missing = self._beyond(headings[at + 1], third, self._last)
                is_alone = self._is_odd(self._beyond(headings[at + 1], between, heading), between)
                is_alone = is_alone and 2 * missing < min(beyond, self._full_turn - beyond)
                if is_alone and third * self._arc < self._full_turn:
                    false.append(at)
                    continue
            self._accept(heading, behind)
            behind = 0.0
        return false, False

    def _is_odd(self, beyond: float, behind: float) -> bool:
        """Whether one that is so far beyond so many arcs may be false."""
        return self._mean > 0 and beyond > behind * (self._mean - self._arc) + self._slack

    def _beyond(self, heading: int, behind: float, last: int) -> float:
        """How much farther than so many arcs the rotor turned since another packet; hardly below 0."""
        return (heading - last - behind * self._arc + self._slack) % self._full_turn - self._slack

    def _part(self, packets: Packets, begin: int, end: int) -> Packets:
        return part_of(packets, begin, end, packet_offsets(packets.blocks), self._wire, self._sample_ns)
