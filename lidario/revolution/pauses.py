"""A line that pauses and catches up, or an outage: where packets stay away for about a turn, the next reads tell.

A network may bring nothing for a tenth of a second, and then all of it in pieces. By the first piece alone this
looks like an outage in which the rotor has turned once, of which the angles tell nothing: a revolution that lacks
nothing would be taken for parts of two. But bytes come late, and never early. If those behind the first piece come
faster than they were measured, the line was late. Behind an outage they come at the pace of the device.

So packets that come so late wait for the reads behind them, until the line has caught up, or has not for half a
turn. If it has, they are dated by what came behind them.
"""

from __future__ import annotations

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
"""Turns by which packets must be late to wait."""


class _Silence(NamedTuple):
    """One behind which packets wait."""

    read: int  # number of the first read behind it
    packets: int  # how many came before it
    began_ns: int  # when the last of these came
    ended_ns: int  # when the first one behind it came


class Pauses:
    """Follows the reads of one stream.

    Args:
        stream: The stream.
        stats: Where packets are counted that wait.
    """

    def __init__(self, stream: Stream, stats: AssemblerStats) -> None:
        self._wire, self._stats = stream.format, stats
        self._most_ns = stream.most_ns
        self._before_ns: int | None = None  # the read before those of which packets wait
        self._waiting: list[Packets] = []

    def take(self, event: Packets, sample_ns: float, turn_ns: float) -> Packets | None:
        """The next packets, but for those that wait; None where all do.

        Args:
            event: The packets that came.
            sample_ns: What a sample takes; 0 where that is not known, and then none wait.
            turn_ns: What a revolution takes, likewise.
        """
        run = event if (waited := self.left()) is None else joined([waited, event])
        before_ns, self._before_ns = self._before_ns, run.received_ns
        late_ns = LATE * turn_ns
        if before_ns is None or not (sample_ns and turn_ns) or run.received_ns - before_ns < late_ns:
            return run
        arrivals, silence, done = [*run.arrivals], None, 0
        damaged = {number for number, _ in run.skips}
        for read, (complete, at_ns) in enumerate(run.arrivals):
            # Where bytes were skipped the line was not silent; in a longer silence the revolution is given up.
            if silence is None and done not in damaged and late_ns <= at_ns - before_ns <= self._most_ns:
                silence = _Silence(read, done, before_ns, at_ns)
            if silence is not None:
                passed_ns = self._samples(run.blocks, silence.packets, complete) * sample_ns
                is_late = at_ns - silence.began_ns - passed_ns >= late_ns
                if not is_late:
                    self._date(arrivals, silence, read, run.blocks, sample_ns)
                if not is_late or at_ns - silence.ended_ns >= STAYED_LATE * turn_ns:
                    silence = None
            before_ns, done = at_ns, complete
        if (dated := tuple(arrivals)) != run.arrivals:
            run = replace(run, arrivals=dated)
        return run if silence is None else self._wait(run, silence, sample_ns)

    def left(self) -> Packets | None:
        """The packets that wait, which do so no longer; None where none do."""
        if not self._waiting:
            return None
        waited = joined(self._waiting)
        self._waiting = []
        self._stats.waiting_packets -= waited.count
        return waited

    def _wait(self, run: Packets, silence: _Silence, sample_ns: float) -> Packets | None:
        """Packets behind a silence wait; returns those before it."""
        self._before_ns = silence.began_ns
        self._stats.waiting_packets += run.count - silence.packets
        if not silence.packets:
            self._waiting = [run]
            return None
        self._waiting = [part_of(run, silence.packets, run.count, None, self._wire, sample_ns)]
        return part_of(run, 0, silence.packets, None, self._wire, sample_ns)

    def _date(
        self, arrivals: list[Arrival], silence: _Silence, last: int, blocks: Sequence[Block], sample_ns: float
    ) -> None:
        """The reads behind a silence, up to the `last` one, came late: by what came behind each."""
        for read in range(last, silence.read, -1):
            (before, at_ns), (complete, behind_ns) = arrivals[read - 1], arrivals[read]
            measured_ns = behind_ns - round(self._samples(blocks, before, complete) * sample_ns)
            arrivals[read - 1] = before, max(silence.began_ns, min(at_ns, measured_ns))

    def _samples(self, blocks: Sequence[Block], begin: int, end: int) -> int:
        return self._wire.samples_in(some_blocks(blocks, begin, end))
