"""When packets were measured, by the clock of the device, where packets tell that.

Bytes come late, by what the adapter, the kernel and the program add: one packet by 1 ms, the next one by 16. The
device's clock is even. So what it says of a packet, plus how far our clock is ahead of it, is when the packet would
have come on a line that delays nothing. How far ahead ours is, the packets tell that came soonest: a line below
all arrivals of the last twenty seconds, and as near to them as can be, since two clocks never run alike.

Where decoding began makes no difference: half seconds are those of the device's clock, times are whole numbers, and
nothing older than the line is remembered. So parts of a file can be decoded apart.

Such a clock counts in milliseconds, begins anew after half a minute, and a damaged packet that passes its check
says anything. So several packets that follow each other are asked, each by its own stamp and the samples since, and
most must agree. Where packets are missing the stamps tell how long, whole revolutions too, which angles hide.
"""

from __future__ import annotations

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
"""Packets whose stamps are compared: of an LD06 20 ms, in which a wrong sample time makes no difference."""
_FEWEST: Final = 3
_EVEN_NS: Final = 50_000_000
_UNEVEN: Final = 0.04
"""Time in which a rotor is even; part of a packet's time by which it may be off."""
_BUCKET_NS: Final = 500_000_000
BUCKETS: Final = 40
"""Over so much time the clock is followed: stretches, and how many of them."""
_APART_NS: Final = 1_000_000_000
"""Least time in which a line is seen; in less, the two clocks run alike."""
_STEEPEST: Final = 0.02
"""By so much one clock is faster than another at most: one without a crystal may be off by a hundredth."""
_EARLY_NS: Final = 100_000_000
_LATE_NS: Final = 2_000_000_000
"""What comes so much earlier or later than any has come is told by another clock: the device was restarted. So is
what should have come so much earlier than the packet before it."""

Stamps: TypeAlias = NDArray[np.int64]
_Point: TypeAlias = tuple[int, int]
"""When by the device's clock, and how far ours was ahead then."""


class StampReader:
    """Reads the stamps of one stream.

    Args:
        ticks: How the device's clock counts.
        packet_ns: What a packet takes.
    """

    def __init__(self, ticks: Ticks, packet_ns: float) -> None:
        self._tick_ns, self._wrap = ticks.tick_ns, ticks.wrap
        self._packet_ns = packet_ns
        # In eight packets that are whole revolutions, the rotor is not even enough, but check values are many.
        self._asked, self._fewest = (_ASKED, _FEWEST) if _ASKED * packet_ns < _EVEN_NS else (_FEWEST, 1)
        self._recent: list[int] = []

    def gaps(self, stamps: Stamps) -> list[tuple[int, float]]:
        """Which of the next packets do not follow the one before, and how far they are apart in nanoseconds.

        Something is missing there, or a packet is false.
        """
        before = self._recent[-1] if self._recent else int(stamps[0]) - round(self._packet_ns / self._tick_ns)
        apart = np.diff(stamps, prepend=before) % self._wrap * self._tick_ns
        odd = (np.abs(apart - self._packet_ns) > max(1.5 * self._tick_ns, _UNEVEN * self._packet_ns)).nonzero()[0]
        return list(zip(odd.tolist(), apart[odd].tolist(), strict=True))

    def restart(self) -> None:
        """What comes does not follow what came."""
        self._recent = []

    def add(self, stamps: Stamps) -> None:
        """The next packets came; they follow each other."""
        self._recent = (self._recent + stamps[-self._asked :].tolist())[-self._asked :]

    def measured(self, expected_ns: int) -> int | None:
        """When the last packet was measured by that clock, as near as can be to the time expected.

        None where too few packets follow each other to be believed, or they do not agree.
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
        # Each tells from when to when, a tick long. What all of them allow is shorter.
        return expected_ns + round((alike[0] + alike[-1] + tick_ns) / 2)


class DeviceClock:
    """Follows the device's clock through one stream.

    Args:
        stream: The stream. Times stay as they are in three cases: its packets carry no clock, the sample time is
            not known, or the bytes were stored without times.
    """

    def __init__(self, stream: Stream) -> None:
        wire = self._wire = stream.format
        self._reader: StampReader | None = None
        if wire.ticks is not None and stream.sample_ns and stream.timed:
            self._reader = StampReader(wire.ticks, wire.pitch * stream.sample_ns)
        # The earliest arrival of each half a second, and the line below them: one of its points, and its slope.
        self._earliest: deque[_Point] = deque(maxlen=BUCKETS)
        self._line: tuple[_Point, float] = ((0, 0), 0.0)
        self._ahead_ns = 0
        self._last_ns = EARLIEST_NS

    @property
    def is_told(self) -> bool:
        """As `Clock.is_told`."""
        return self._reader is not None

    def dated(self, packets: Packets) -> Packets:
        """The packets, with the times at which they would have come if nothing delayed them."""
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
                    if apart_ns > FASTEST_TURN_NS and (came_ns := self._came(reader, at_ns)) is not None:
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
        """When the last packet of a read at `at_ns` should have come, and not before the one before.

        Where the read was cut behind it, that time was reckoned, and tells nothing.
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
        """A packet was measured then, and came when our clock was so far ahead."""
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
    """A point of the line that lies below these and as near as can be, and its slope."""
    if points[-1][0] - points[0][0] < _APART_NS:
        return min(points, key=_ahead_of), 0.0
    # Half of them lie behind it: one that came late after a pause has no say.
    middle_ns = median_high(at_ns for at_ns, _ in points)
    before, after = next(pair for pair in pairwise(_hull(points)) if pair[1][0] >= middle_ns)
    return before, min(max(_slope(before, after), -_STEEPEST), _STEEPEST)


def _hull(points: Iterable[_Point]) -> list[_Point]:
    """The corners of the line that lies below all points and bends upwards only."""
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
