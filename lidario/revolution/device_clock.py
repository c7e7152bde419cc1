"""Dates packets by the clock of the device, if packets carry its stamps.

Bytes come late, by what the adapter, the kernel and the program add: one packet by 1 ms, the next one by 16. The
device's clock is even. So the stamp of a packet, plus how far our clock is ahead of the device's, is when the
packet would have come on a line without delay. The packets that came soonest show how far ours is ahead: a straight
line is laid below all arrivals of the last twenty seconds, as near to them as possible. It is a line because two
clocks never run equally fast.

The result does not depend on where decoding began: the half seconds (`_BUCKET_NS`) are those of the device's clock,
times are whole numbers, and nothing older than the line is remembered. So parts of a file can be decoded
separately.

Such a clock counts in milliseconds and begins anew after half a minute, and a damaged packet that passes its check
may carry any stamp. So several packets that follow each other are compared, each by its own stamp and the samples
since, and most must agree. If packets are missing, the stamps show for how long, also for whole revolutions, which
angles hide.
"""

from collections import deque
from collections.abc import Iterable, Sequence
from itertools import pairwise
from statistics import median_high
from typing import Final, TypeAlias

import numpy as np
from numpy.typing import NDArray

from lidario.families.base import Stream
from lidario.revolution.doubled import FASTEST_TURN_NS
from lidario.wire.events import EARLIEST_NS, Arrival, Packets
from lidario.wire.formats import Ticks

_ASKED: Final = 8
"""Packets whose stamps are compared: with an LD06 20 ms, in which a wrong sample time makes no difference."""
_FEWEST: Final = 3
_EVEN_NS: Final = 50_000_000
_UNEVEN: Final = 0.04
"""Time for which a rotor turns evenly; part of a packet's time by which stamps may be off."""
_BUCKET_NS: Final = 500_000_000
BUCKETS: Final = 40
"""The clock is followed over this many stretches of this length."""
_APART_NS: Final = 1_000_000_000
"""A slope is computed only over this time or more; in less, the two clocks run alike."""
_STEEPEST: Final = 0.02
"""Largest difference in speed of the two clocks: one without a crystal may be off by a hundredth."""
_EARLY_NS: Final = 100_000_000
_LATE_NS: Final = 2_000_000_000
"""A packet that comes this much earlier or later than its stamp says has a stamp of another clock: the device was
restarted. So has a packet whose stamp is this much earlier than the packet before."""

Stamps: TypeAlias = NDArray[np.int64]
_Point: TypeAlias = tuple[int, int]
"""A time by the device's clock, and how far our clock was ahead then."""


class StampReader:
    """Reads the stamps of one stream.

    Args:
        ticks: How the device's clock counts.
        packet_ns: Time of a packet.
    """

    def __init__(self, ticks: Ticks, packet_ns: float) -> None:
        self._tick_ns, self._wrap = ticks.tick_ns, ticks.wrap
        self._packet_ns = packet_ns
        # Eight packets that are whole revolutions take too long for an even rotor. Fewer are compared then, and one
        # is enough: such packets have many check values.
        self._asked, self._fewest = (_ASKED, _FEWEST) if _ASKED * packet_ns < _EVEN_NS else (_FEWEST, 1)
        self._recent: list[int] = []

    def gaps(self, stamps: Stamps) -> list[tuple[int, float]]:
        """Numbers of the next packets that do not follow the one before, and the nanoseconds between the two.

        There packets are missing, or one is false.
        """
        before = self._recent[-1] if self._recent else int(stamps[0]) - round(self._packet_ns / self._tick_ns)
        apart = np.diff(stamps, prepend=before) % self._wrap * self._tick_ns
        odd = (np.abs(apart - self._packet_ns) > max(1.5 * self._tick_ns, _UNEVEN * self._packet_ns)).nonzero()[0]
        return list(zip(odd.tolist(), apart[odd].tolist(), strict=True))

    def restart(self) -> None:
        """Forget the stamps so far: the next packet does not follow them."""
        self._recent = []

    def add(self, stamps: Stamps) -> None:
        """The next packets came; they follow each other."""
        self._recent = (self._recent + stamps[-self._asked :].tolist())[-self._asked :]

    def measured(self, expected_ns: int) -> int | None:
        """When the last packet was measured, by the device's clock: the time nearest to `expected_ns`.

        None if too few packets follow each other, or they do not agree.
        """
        recent, tick_ns = self._recent, self._tick_ns
        count, wrap_ns = len(recent), self._wrap * tick_ns
        if count < self._fewest:
            return None
        found = sorted(
            (stamp * tick_ns - expected_ns + wrap_ns // 2) % wrap_ns - wrap_ns // 2 + behind * self._packet_ns
            for behind, stamp in enumerate(reversed(recent))
        )
        middle_ns = median_high(found)
        alike = [each for each in found if abs(each - middle_ns) <= 2 * tick_ns]
        if 2 * len(alike) <= count:
            return None
        # Each stamp allows an interval of one tick. The interval that all of them allow is shorter; take its
        # middle.
        return expected_ns + round((alike[0] + alike[-1] + tick_ns) / 2)


class DeviceClock:
    """Follows the device's clock through one stream.

    Args:
        stream: The stream. Arrivals stay as they are in three cases: its packets carry no stamps, the sample time
            is not known, or the bytes were stored without times.
    """

    def __init__(self, stream: Stream) -> None:
        wire = self._wire = stream.format
        self._reader: StampReader | None = None
        if wire.ticks is not None and stream.sample_ns and stream.timed:
            self._reader = StampReader(wire.ticks, wire.pitch * stream.sample_ns)
        # The earliest arrival of each half second, and the line below them: one of its points, and its slope.
        self._earliest: deque[_Point] = deque(maxlen=BUCKETS)
        self._line: tuple[_Point, float] = ((0, 0), 0.0)
        self._ahead_ns = 0
        self._last_ns = EARLIEST_NS

    @property
    def is_told(self) -> bool:
        """Whether packets carry the device's clock, so that no time is late."""
        return self._reader is not None

    def dated(self, packets: Packets) -> Packets:
        """The packets, with the times at which they would have come without any delay."""
        reader = self._reader
        if reader is None:
            return packets
        stamps = self._wire.stamps(packets)
        gaps = deque(reader.gaps(stamps))
        arrivals: list[Arrival] = []
        begin = 0
        for count, at_ns in packets.arrivals:
            while gaps and gaps[0][0] < count:
                gap, apart_ns = gaps.popleft()
                if gap > begin:
                    reader.add(stamps[begin:gap])
                    # Packets that are whole scans are dated from the end of their read, by their own stamps.
                    hides_turns = apart_ns > FASTEST_TURN_NS and not self._wire.whole
                    if hides_turns and (came_ns := self._came(reader, at_ns)) is not None:
                        arrivals.append((gap, came_ns))
                reader.restart()
                begin = gap
            reader.add(stamps[begin:count])
            begin = count
            came_ns = self._came(reader, at_ns, is_last=True, is_cut=packets.cut and count == packets.count)
            self._last_ns = max(self._last_ns, at_ns) if came_ns is None else came_ns
            arrivals.append((count, self._last_ns))
        return Packets(packets.data, packets.blocks, tuple(arrivals), packets.skips)

    def _came(self, reader: StampReader, at_ns: int, *, is_last: bool = False, is_cut: bool = False) -> int | None:
        """When the last packet of a read at `at_ns` should have come, but not before the packet before it.

        If the read was cut behind that packet, `at_ns` was computed, and nothing is learned from it.
        """
        measured_ns = reader.measured(at_ns - self._ahead_ns)
        if measured_ns is None:
            return None
        if is_last and not is_cut:
            should_ns = measured_ns + self._ahead_ns
            went_on = should_ns > self._last_ns - _EARLY_NS and -_EARLY_NS < at_ns - should_ns < _LATE_NS
            if self._earliest and not went_on:
                self._earliest.clear()
                self._ahead_ns = 0
                return self._came(reader, at_ns, is_last=True)
            self._learn(measured_ns, at_ns - measured_ns)
        came_ns = measured_ns + self._ahead_ns
        self._last_ns = max(self._last_ns, came_ns if is_cut else min(came_ns, at_ns))
        return self._last_ns

    def _learn(self, measured_ns: int, ahead_ns: int) -> None:
        """Learn from a packet: when it was measured, and how far our clock was ahead when it came."""
        earliest = self._earliest
        if not earliest or measured_ns // _BUCKET_NS > earliest[-1][0] // _BUCKET_NS:
            earliest.append((measured_ns, ahead_ns))
            self._line = _line_below(earliest)
        elif ahead_ns < earliest[-1][1]:
            earliest[-1] = (measured_ns, ahead_ns)
            self._line = _line_below(earliest)
        (at_ns, then_ns), slope = self._line
        self._ahead_ns = min(then_ns + round(slope * (measured_ns - at_ns)), ahead_ns)


def _line_below(points: Sequence[_Point]) -> tuple[_Point, float]:
    """The line that lies below these points, as near to them as possible: one of its points, and its slope."""
    if points[-1][0] - points[0][0] < _APART_NS:
        return min(points, key=_ahead_of), 0.0
    # The edge of the hull at the middle time counts: a late point after a pause has no influence on it.
    middle_ns = median_high(at_ns for at_ns, _ in points)
    before, after = next(pair for pair in pairwise(_hull(points)) if pair[1][0] >= middle_ns)
    return before, min(max(_slope(before, after), -_STEEPEST), _STEEPEST)


def _hull(points: Iterable[_Point]) -> list[_Point]:
    """The lower convex hull: corners of the line that lies below all points and bends only upwards."""
    hull: list[_Point] = []
    for here in points:
        while len(hull) > 1 and _slope(hull[-2], here) <= _slope(hull[-2], hull[-1]):
            hull.pop()
        hull.append(here)
    return hull


def _ahead_of(point: _Point) -> int:
    return point[1]


def _slope(before: _Point, after: _Point) -> float:
    return (after[1] - before[1]) / (after[0] - before[0])
