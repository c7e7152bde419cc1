"""Drops noise that passes for a packet: its angle shows where the rotor was not.

An 8-bit check value lets one of 256 damaged packets pass, and even one of eight of those with two flipped bits. The
angle of such a packet may be anything. If it were believed, its samples would stand where nothing was measured. Or
the angle would leap there, and leap back with the next packet, which looks like a gap of almost a turn or like the
end of a revolution.

The packets beside it show it. From packet to packet the rotor turns by at least an arc. Bytes skipped as noise
between them took time on the line, too: an arc for as many bytes as a packet has. Lost packets only add to that. So
of three packets, the one in the middle is false if there is room for two steps before the third, and its angle does
not lie there. It is not false if the third follows it: a device may write text between and within its packets, and
then more bytes were skipped than the rotor turned. A packet waits for the third only if it is farther ahead than
its bytes explain, so in an undisturbed stream none waits. If so many packets are lost that two gaps may make a
whole turn together, nothing is judged.
"""

from collections.abc import Sequence
from typing import Final, NamedTuple

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
"""How many of the latest advances are used to find how far the rotor turns from one packet to the next."""
FARTHEST_TURNS: Final = 1 / 4
"""Largest advance that is judged, in turns: with larger ones, two gaps may make a whole turn together."""
RETREAT_TURNS: Final = 1 / 36
"""How far a heading may tremble back, in turns."""


class _Advance(NamedTuple):
    """How far the rotor turned from each of the latest packets to the next, for as many bytes as a packet has."""

    least: float
    mean: float
    # Whole numbers, as headings are: Python compares these with fractions much more slowly.
    above: int  # an advance that is not odd is above this
    most: int  # and this at most


class FalsePackets:
    """Finds the false packets of one stream.

    Formats with packets of several sizes are not judged: their check values have sixteen bits. Nor are packets of
    one sample, whose angle alone shows nothing.

    Args:
        stream: The stream.
        stats: Counts the false packets, and those that wait.
    """

    def __init__(self, stream: Stream, stats: AssemblerStats) -> None:
        wire = stream.format
        self._wire, self._sample_ns, self._stats = wire, stream.sample_ns, stats
        self._can_tell = wire.samples > 1
        self._full_turn = wire.full_turn
        self._farthest = wire.full_turn * FARTHEST_TURNS
        self._forwards = wire.full_turn * (1 - RETREAT_TURNS)
        self._last = -1
        self._advances: list[float] = []  # the latest advances, and perhaps as many before them
        self._usual: _Advance | None = None  # what they were when they were measured last; None while unknown
        # How much an advance may differ because the speed changes: a part of the largest arc so far, since a change
        # weighs more for a slow rotor. Plus 1, for angles are rounded.
        self._slack = 1.0
        self._waiting: Packets | None = None

    def tell_time(self, sample_ns: float) -> None:
        """A sample takes so many nanoseconds from now on."""
        self._sample_ns = sample_ns

    def passing(self, headings: Headings, skips: Sequence[tuple[int, int]] = ()) -> list[int] | None:
        """Numbers of the packets that passed 0 since the one before, if each is a little ahead of the one before.

        Then all packets are true; this also holds while the speed changes. None if it does not hold, is not known,
        or bytes were skipped.
        """
        if self._usual is None or skips or self._waiting is not None:
            return None
        _, _, above, most = self._usual
        full_turn, last, passing = self._full_turn, self._last, list[int]()
        if isinstance(headings, np.ndarray):
            plain = headings & HEADING_MASK
            steps = np.empty_like(plain)
            steps[0] = int(plain[0]) - last
            np.subtract(plain[1:], plain[:-1], out=steps[1:])
            back = (steps < 0).nonzero()[0]
            steps[back] += full_turn
            if not (np.minimum.reduce(steps) > above and np.maximum.reduce(steps) <= most):
                return None
            passing, latest = back.tolist(), steps[-MEASURED:].tolist()
        else:
            # Once a revolution, with cold caches, a loop is faster than `map`, `min` and `max`. Mostly a heading is
            # ahead of the one before, and has no flag.
            begin, latest = len(headings) - MEASURED, list[int]()
            for at, heading in enumerate(headings):
                advance = heading - last
                if not above < advance <= most:
                    heading &= HEADING_MASK
                    advance = (heading - last) % full_turn
                    if heading < last:
                        passing.append(at)
                    if not above < advance <= most:
                        return None
                if at >= begin:
                    latest.append(advance)
                last = heading
        self._last = int(headings[-1]) & HEADING_MASK
        self._advances += latest
        if len(self._advances) >= 2 * MEASURED:
            self._measure()
        return passing

    def drop(self, packets: Packets, headings: Headings) -> tuple[Packets, Headings]:
        """The next packets and their headings, without those that are false or wait; perhaps none."""
        if not self._can_tell or self.passing(headings, packets.skips) is not None:
            return packets, headings
        self._measure()
        if self._are_true(packets, headings):
            return packets, headings
        run = packets if (waiting := self.left()) is None else joined([waiting, packets])
        false, waits = self._judge([int(each) & HEADING_MASK for each in self._wire.headings(run)], run.skips)
        self._stats.false_packets += len(false)
        # As noise: the time that they took has passed all the same.
        run = without(run, false, as_noise=True) if false else run
        if waits:
            last = run.count - 1
            self._waiting = self._part(run, last, run.count)
            self._stats.waiting_packets += 1
            run = self._part(run, 0, last)
        return run, self._wire.headings(run) if run.data else ()

    def left(self) -> Packets | None:
        """Release the packet that waits; returns it, or None if there is none."""
        waiting, self._waiting = self._waiting, None
        self._stats.waiting_packets -= waiting is not None
        return waiting

    def _are_true(self, packets: Packets, headings: Headings) -> bool:
        """Whether the first packets show nothing odd, and all others follow them.

        Only the first one is looked at alone, or as many as give the advance. Measured: if each packet of the first
        64 KiB is judged, decoding a short file takes up to 1.4 times as long.
        """
        if self._waiting is not None or len(packets.skips) != bool(packets.skipped):
            # Bytes were skipped elsewhere than at the beginning.
            return False
        before = self._last, self._advances.copy(), self._usual
        first, behind = MEASURED + 1 if self._usual is None else 1, 1 + packets.skipped / self._wire.shortest
        for each in headings[:first]:
            heading = int(each) & HEADING_MASK
            if self._is_odd(self._beyond(heading, behind, self._last), behind):
                break
            self._accept(heading, behind)
            behind = 1.0
        else:
            if len(headings) <= first or self.passing(headings[first:]) is not None:
                return True
        self._last, self._advances, self._usual = before
        return False

    def _accept(self, heading: int, behind: float) -> None:
        """Take a packet as true; by the bytes it is `behind` packets after the one before."""
        # With more packets between, each as far as may be, the advance may hide a whole turn.
        if self._last >= 0 and behind * self._farthest <= self._full_turn:
            advance = (heading - self._last) % self._full_turn
            if advance < self._forwards:
                self._advances.append(advance / behind)
                self._measure()
        self._last = heading

    def _measure(self) -> None:
        """Find how far the rotor turns, if enough packets have come."""
        latest = self._advances = self._advances[-MEASURED:]
        self._usual = None
        if len(latest) == MEASURED and max(latest) <= self._farthest:
            least, mean = min(latest), sum(latest) / MEASURED
            self._slack = max(self._slack, LIKENESS * least + 1)
            self._usual = _Advance(least, mean, int(max(0.0, least - self._slack)), int(mean + self._slack))

    def _judge(self, headings: Sequence[int], skips: Sequence[tuple[int, int]]) -> tuple[list[int], bool]:
        """Numbers of the false packets, and whether the last one has to wait; the skips are those of `Packets`."""
        false = list[int]()
        # `behind`: how many packets the bytes would make since the last true packet; `third`, up to the next one.
        noise, behind, packet = dict(skips), 0.0, self._wire.shortest
        for at, heading in enumerate(headings):
            behind += 1 + noise.get(at, 0) / packet
            beyond = self._beyond(heading, behind, self._last)
            if self._is_odd(beyond, behind):
                if at + 1 == len(headings):
                    return false, True
                between = 1 + noise.get(at + 1, 0) / packet
                third = behind + between
                # Without this packet, less than half as much seems missing, or it lies behind where it should be;
                # and the next one does not follow it.
                missing = self._beyond(headings[at + 1], third, self._last)
                is_alone = self._is_odd(self._beyond(headings[at + 1], between, heading), between)
                is_alone = is_alone and 2 * missing < min(beyond, self._full_turn - beyond)
                if is_alone and third * self._least < self._full_turn:
                    false.append(at)
                    continue
            self._accept(heading, behind)
            behind = 0.0
        return false, False

    def _is_odd(self, beyond: float, behind: float) -> bool:
        """Whether a packet that is so far `beyond` as many arcs as packets `behind` may be false."""
        usual = self._usual
        return usual is not None and beyond > behind * (usual.mean - usual.least) + self._slack

    def _beyond(self, heading: int, behind: float, last: int) -> float:
        """How much farther the rotor turned since `last` than `behind` least advances; hardly below 0."""
        return (heading - last - behind * self._least + self._slack) % self._full_turn - self._slack

    @property
    def _least(self) -> float:
        return 0.0 if self._usual is None else self._usual.least

    def _part(self, packets: Packets, begin: int, end: int) -> Packets:
        return part_of(packets, begin, end, packet_offsets(packets.blocks), self._wire, self._sample_ns)
