"""Tells a late line from an outage: after a silence of about a revolution, the next reads show which it is.

A network may deliver nothing for a tenth of a second, and then everything in pieces, perhaps with more pauses
between. Judged by the first piece alone, this looks like an outage in which the rotor turned once, which angles
cannot show: a revolution that lacks nothing would be taken for parts of two. But bytes may come late, never early.
If the bytes behind the first piece come faster than they were measured, the line was late. Behind an outage they
come at the pace of the device.

How late the line is after a silence follows from the time it took to measure the packets that came. Packets that
are late by most of a revolution wait for the reads behind them: until the line has caught up, or until half a
revolution and three reads have brought it no nearer to that. If the line has caught up, the packets are dated by
what came behind them. If the stream ends before, nothing shows that the line was late.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import Final, NamedTuple

from lidario.families.base import Stream
from lidario.revolution.clock import NOISE, STAYED_LATE
from lidario.revolution.partial import part_of
from lidario.revolution.stats import AssemblerStats
from lidario.revolution.together import joined
from lidario.wire.blocks import Block, some_blocks
from lidario.wire.events import Arrival, Packets

LATE: Final = 1 - NOISE
"""Revolutions by which packets must be late to wait."""
_READS: Final = 3
"""Behind an outage, this many reads must stay as late. Fewer may come from a machine that has no time to read."""


class _Line(NamedTuple):
    """How late a line is, by the reads so far."""

    late_ns: float = 0.0  # how late the last read was
    stayed: int = 0  # reads since then that brought it no nearer to being on time
    stayed_ns: float = 0.0  # for how long that has been so
    most_ns: float = 0.0  # how late it was at most meanwhile


_ON_TIME: Final = _Line()


class _Wait(NamedTuple):
    """The place in a run from which on packets wait."""

    read: int  # number of the first read that waits
    packets: int  # how many packets came before it
    before: _Line  # the line before it
    before_ns: int  # time of the read before it


class Pauses:
    """Follows the reads of one stream.

    Args:
        stream: The stream.
        stats: Counts the packets that wait.
    """

    def __init__(self, stream: Stream, stats: AssemblerStats) -> None:
        self._wire, self._stats = stream.format, stats
        self._samples_a_byte = self._wire.samples_in((Block(self._wire.longest, 1),)) / self._wire.longest
        self._most_ns = stream.most_ns
        # The line, and the time of the last read, without the packets that wait.
        self._line = _ON_TIME
        self._read_ns: int | None = None
        self._waiting: Packets | None = None

    def take(self, event: Packets, sample_ns: float, turn_ns: float) -> Packets | None:
        """Take the next packets; returns all that need not wait, also of those that waited. None if all wait.

        Args:
            event: The packets that came.
            sample_ns: Time of a sample; 0 if unknown, and then none wait.
            turn_ns: Time of a revolution; 0 if unknown, and then none wait.
        """
        run, least = event, LATE
        if self._waiting is not None:
            run, least = joined([self._waiting, event]), NOISE
            self.left()
        line, self._line = self._line, _ON_TIME
        last_ns, self._read_ns = self._read_ns, run.arrivals[-1][1]
        if last_ns is None or not (sample_ns and turn_ns):
            return run
        if not line.late_ns and not self._is_late(run, last_ns, sample_ns, NOISE * turn_ns):
            return run
        arrivals, done, wait = [*run.arrivals], 0, None
        for read, (complete, at_ns) in enumerate(run.arrivals):
            before, silent_ns = line, at_ns - last_ns
            if silent_ns > self._most_ns:
                # After so long a silence the revolution is given up.
                line, wait = _ON_TIME, None
            elif line.late_ns or silent_ns >= NOISE * turn_ns:
                line = _behind(line, silent_ns, self._measured(run, done, complete) * sample_ns, turn_ns)
            else:
                line = _ON_TIME
            has_stayed = line.stayed_ns >= STAYED_LATE * turn_ns and line.stayed >= _READS
            if line.late_ns >= (LATE if has_stayed else least) * turn_ns:
                # What waits, waits until the line has caught up: the rotor may have become faster meanwhile.
                wait, least = wait or _Wait(read, done, before, last_ns), NOISE
            elif wait is not None:
                self._date(arrivals, wait, read, run.blocks, sample_ns)
                wait = None
            if has_stayed:
                # It was an outage, or a delay too small to matter.
                line, wait = _ON_TIME, None
            done, last_ns = complete, at_ns
        self._line = line
        if (dated := tuple(arrivals)) != run.arrivals:
            run = replace(run, arrivals=dated)
        return run if wait is None else self._wait(run, wait, sample_ns)

    def _is_late(self, run: Packets, at_ns: int, sample_ns: float, noise_ns: float) -> bool:
        """Whether a silence is longer, by more than noise, than it took to measure the packets read after it."""
        if run.arrivals[-1][1] - at_ns < noise_ns:
            return False
        packet_ns, done = self._wire.samples_in(run.blocks) * sample_ns / run.count, 0
        for complete, come_ns in run.arrivals:
            if come_ns - at_ns - (complete - done) * packet_ns >= noise_ns:
                return True
            done, at_ns = complete, come_ns
        return False

    def left(self) -> Packets | None:
        """Release the packets that wait; returns them, or None if there are none."""
        waiting, self._waiting = self._waiting, None
        self._stats.waiting_packets -= 0 if waiting is None else waiting.count
        return waiting

    def _wait(self, run: Packets, wait: _Wait, sample_ns: float) -> Packets | None:
        """Keep the packets that wait; returns those before them."""
        self._line, self._read_ns = wait.before, wait.before_ns
        self._stats.waiting_packets += run.count - wait.packets
        if not wait.packets:
            self._waiting = run
            return None
        self._waiting = part_of(run, wait.packets, run.count, None, self._wire, sample_ns)
        return part_of(run, 0, wait.packets, None, self._wire, sample_ns)

    def _date(
        self, arrivals: list[Arrival], wait: _Wait, last: int, blocks: Sequence[Block], sample_ns: float
    ) -> None:
        """Date the reads that waited, up to number `last`: each by the time to measure what came behind it."""
        for read in range(last, wait.read, -1):
            (before, at_ns), (complete, behind_ns) = arrivals[read - 1], arrivals[read]
            measured_ns = behind_ns - round(self._samples(blocks, before, complete) * sample_ns)
            arrivals[read - 1] = before, max(wait.before_ns, min(at_ns, measured_ns))

    def _measured(self, run: Packets, begin: int, end: int) -> float:
        """Samples of these packets, and about how many were in the skipped bytes: those took time, too."""
        skipped = sum([size for number, size in run.skips if begin <= number < end])
        return self._samples(run.blocks, begin, end) + skipped * self._samples_a_byte

    def _samples(self, blocks: Sequence[Block], begin: int, end: int) -> int:
        return self._wire.samples_in(some_blocks(blocks, begin, end))


def _behind(line: _Line, silent_ns: int, came_ns: float, turn_ns: float) -> _Line:
    """How late a line is after a silence and the next read, whose packets took `came_ns` to measure."""
    noise_ns = NOISE * turn_ns
    later_ns = silent_ns - came_ns
    if silent_ns < noise_ns:
        # The line was not silent: what has not come is missing.
        later_ns = min(later_ns, 0.0)
    late_ns = max(0.0, line.late_ns + later_ns)
    if not line.late_ns and late_ns < noise_ns:
        # That little is noise: adapters hold bytes back for some milliseconds.
        return _ON_TIME
    if line.late_ns < LATE * turn_ns <= late_ns or not line.late_ns or late_ns <= line.most_ns - noise_ns:
        # Count anew: it has become late, so late that packets wait, or it is catching up.
        return _Line(late_ns, most_ns=late_ns)
    return _Line(late_ns, line.stayed + 1, line.stayed_ns + silent_ns, max(late_ns, line.most_ns))
