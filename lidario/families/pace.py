"""Finds how many packets the device has measured, by the time between the packets that came.

A device measures at an even pace, so time tells how many packets it has measured, whether they came or not. Bytes
come late, but never early, and the delay may change at any moment. So the number is computed twice: in the first
half and in the second half of the known packets.
"""

from bisect import bisect_right
from collections.abc import Sequence
from itertools import pairwise
from operator import itemgetter
from statistics import median_low
from typing import Final, NamedTuple, Self

import numpy as np

from lidario.families.spans import Ints, Turning
from lidario.wire.copies import copy_of
from lidario.wire.events import Arrival

OFF: Final = 0.25  # by this share a number of packets, found by time or angles, may differ from a whole number
REMEMBERED: Final = 64  # reads, or spans, that are kept while a speed is not sure
SEVERAL: Final = 1.5  # halfway from one arc, or packet, to two
_FEWEST: Final = 8.0
"""Packets that the device must have measured in each half; with fewer, time, off by one or two, proves nothing."""


class _Point(NamedTuple):
    """The state after a read."""

    at_ns: int  # arrival of the read
    turned: int  # how far the rotor had turned at the beginning of its last packet, in heading units
    came: int  # packets up to that one


class Pace:
    """Remembers when packets of one stream came, and where the rotor was then."""

    def __init__(self, full_turn: int) -> None:
        self._full_turn = full_turn
        self._points: list[_Point] = []
        self._turned = self._came = 0
        self._is_doubted = False

    def copy(self) -> Self:
        """An independent copy."""
        twin = copy_of(self)
        twin._points = [*self._points]  # noqa: SLF001 - its own
        return twin

    def clear(self) -> None:
        """Forget all reads: the next packets do not follow them."""
        self._points, self._is_doubted = [], False

    def doubt_last(self) -> None:
        """The latest time was computed as if no packet were missing: the next one shall replace it."""
        self._is_doubted = bool(self._points)

    def add(self, spans: Sequence[int] | Ints, arrivals: Sequence[Arrival]) -> None:
        """Take the next packets: how far ahead of each the next one is, and when they came."""
        begin, turned = 0, self._turned
        if self._is_doubted:
            self._points.pop()
        self._is_doubted = False
        for count, at_ns in arrivals:
            # Of packets with one time, only the last has just been measured.
            if self._points and self._points[-1].at_ns == at_ns:
                self._points.pop()
            turned += int(np.add.reduce(spans[begin : count - 1]))
            begin = count - 1
            self._points.append(_Point(at_ns, turned, self._came + count))
        self._turned = turned + int(np.add.reduce(spans[begin:]))
        self._came += len(spans)
        del self._points[:-REMEMBERED]

    def measured(self, packet_ns: float, arc: float = 0.0) -> tuple[float, float] | None:
        """How many packets the device has measured for each arc, in the first and in the second half of the time.

        Without an `arc`: for each packet that came. None if too little time has passed, or if the time of a packet
        is not known (`packet_ns` is 0).
        """
        found = list[float]()
        for measured, turned, came in self._halves(packet_ns):
            arcs = turned / arc if arc else came
            if measured < _FEWEST or arcs <= 0:
                return None
            found.append(measured / arcs)
        return (found[0], found[1]) if found else None

    def shows_nearly_all(self, packet_ns: float) -> bool:
        """Whether the device has measured hardly more packets than came; False if time does not tell."""
        by_time = self.measured(packet_ns)
        return by_time is not None and max(by_time) < SEVERAL

    def is_too_short(self, packet_ns: float, arc: float) -> bool:
        """Whether the device has measured fewer packets than such arcs passed.

        Either in both halves of the time, and hardly more were measured than came. Or in all of it fewer than half
        of the arcs: in one half the rotor may have stood.
        """
        halves = self._halves(packet_ns)
        measured, turned, came = [sum(each) for each in zip(*halves, strict=True)] or (0.0, 0, 0)
        # What was measured is never less than what came, unless the line was late.
        if max(_FEWEST, (1 - OFF) * came) <= measured and 2 * (measured + 1) < turned / arc:
            return True
        for measured, turned, came in halves:
            # A read may end within a packet, so time may be off by one packet. The times of a few packets are
            # mostly computed, not measured (`Packets.cut`).
            arcs = turned / arc
            if not _FEWEST / 2 <= measured < SEVERAL * came or measured + 1 >= (1 - OFF) * arcs:
                return False
        return bool(halves)

    def _halves(self, packet_ns: float) -> list[tuple[float, int, int]]:
        """In each half of the time: packets that were measured, how far the rotor turned, and packets that came."""
        if not packet_ns or len(self._points) < 3:
            return []
        points = self._without_outages()
        begin, end = points[0], points[-1]
        middle = min(points, key=lambda point: abs(2 * point.at_ns - begin.at_ns - end.at_ns))
        return [
            ((after.at_ns - before.at_ns) / packet_ns, after.turned - before.turned, after.came - before.came)
            for before, after in ((begin, middle), (middle, end))
        ]

    def _without_outages(self) -> list[_Point]:
        """The points without the steps in which angles and time disagree, by the usual time of a turn.

        In such a step a whole turn hides, or noise that passes for a packet made the angle leap there and back.
        """
        steps = [
            _Point(after.at_ns - before.at_ns, after.turned - before.turned, after.came - before.came)
            for before, after in pairwise(self._points)
        ]
        each_ns = [step.at_ns / step.turned for step in steps if step.turned > 0]
        if not each_ns:
            return self._points
        turn_ns = median_low(each_ns) * self._full_turn
        points = [self._points[0]]
        for step in steps:
            last = points[-1]
            if abs(step.at_ns - turn_ns * step.turned / self._full_turn) > turn_ns / 2:
                step = _Point(0, 0, 0)
            points.append(_Point(last.at_ns + step.at_ns, last.turned + step.turned, last.came + step.came))
        return points


class PacedTurning(Turning):
    """A `Turning` that learns the speed from the angles, and confirms it by time.

    A heading may fall back by `retreat` turns. If it falls back farther, it went the long way round, forwards.
    """

    def __init__(self, full_turn: int, retreat: float, samples: int = 1) -> None:
        self._full_turn = full_turn
        self._retreat = int(full_turn * retreat)
        self._samples = samples
        # Nanoseconds of a packet; 0 if unknown, and then time proves nothing.
        self._packet_ns, self._time_passes = 0.0, True
        self._certain = self._confirmed = False  # whether a speed is known, and whether time confirms it
        # How many spans in a row have not fitted that speed; and how many packets were reported to follow each
        # other while time could still disprove it.
        self._strange = self._close = 0
        self._pace = Pace(full_turn)

    def tell_time(self, sample_ns: float, *, passes: bool = True) -> None:
        self._packet_ns, self._time_passes = self._samples * sample_ns, passes

    def doubt_time(self) -> None:
        self._pace.doubt_last()

    def _most_packets(self, packet: int, arrivals: Sequence[Arrival]) -> float:
        """How many packets may have been measured from this one up to the one behind it, by time; 0 if unknown.

        Bytes come late, but the packet was not there yet with the read before its own.
        """
        read, behind = (bisect_right(arrivals, at, key=itemgetter(0)) for at in (packet, packet + 1))
        if not (read and self._packet_ns and self._time_passes) or behind == len(arrivals):
            return 0.0
        return (arrivals[behind][1] - arrivals[read - 1][1]) / self._packet_ns

    def _lacks_packets(self, arrivals: Sequence[Arrival]) -> bool:
        """Whether time shows that packets are missing between the first read and the last."""
        if not (self._packet_ns and self._time_passes and arrivals):
            return False
        (before, first_ns), (came, last_ns) = arrivals[0], arrivals[-1]
        return (last_ns - first_ns) / self._packet_ns >= max(_FEWEST, SEVERAL * (came - before))

    def _note_close(self, packets: int) -> None:
        """Count packets that are reported to follow each other, while the rotor turned: else no speed tells it."""
        self._close = 0 if self._confirmed else self._close + packets

    def _revoked(self, times: float) -> tuple[int, int]:
        """What to revoke, as `Arcs.revoked`, if arcs were taken as `times` their true length."""
        missing = round(times) - 1
        if missing < 1:
            return 0, 0
        close, self._close = self._close, 0
        return missing, close

    def copy(self) -> Self:
        twin = copy_of(self)
        twin._pace = self._pace.copy()  # noqa: SLF001 - its own
        return twin
