"""One started stream, from its descriptor to its end: packets become scans, and somebody watches that they come.

`begin` takes the packets over, those included that came with the descriptor. `end` lets go of everything: no
timer is left, and the port is polled no more. Between them two things are watched: that packets come, and that
they make full revolutions. What must be repeated to keep the device going is repeated.

`Scanner` makes one of these for each start and holds at most one.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from dataclasses import dataclass

from lidario.errors import StreamFailed
from lidario.families.base import Stream
from lidario.model import Scan, ScanMode
from lidario.revolution.assemble import Assembler, AssemblerStats
from lidario.session.dialogue import Dialogue
from lidario.session.log import Trouble
from lidario.session.pace import Pace
from lidario.wire.events import Packets

__all__ = ["SILENCE_S", "Running", "Totals"]

SILENCE_S = 0.9
"""Longest time without a packet once they flow. The slowest format sends one every 20 ms."""
REVOLUTIONS_MISSED = 3
"""Revolutions of the slowest kind that may fail to complete before a stream of packets counts as stuck."""
_WATCH_MARGIN_S = 0.001
"""Timers may fire early by the resolution of the clock; this much later the time is surely up."""


@dataclass(slots=True)
class Totals:
    """Counters that outlive a single stream; they only grow.

    Attributes:
        assembled: What became of the packets.
        interruptions: Times a stream was stopped for something else and started again.
        keepalives: Keepalive requests sent.
    """

    assembled: AssemblerStats
    interruptions: int = 0
    keepalives: int = 0


class Running:
    """A stream that the device sends.

    Args:
        stream: The stream, as its family described it.
        dialogue: Where its packets come from.
        latency: Seconds by which a scan may be late because the port is polled only from time to time.
        totals: Counters to add to.
        trouble: Where discarded revolutions are logged.
        publish: Called with each scan.
        failed: Called once if the stream falls silent or makes no revolutions; it then should end it.
    """

    def __init__(
        self,
        stream: Stream,
        dialogue: Dialogue,
        *,
        latency: float,
        totals: Totals,
        trouble: Trouble,
        publish: Callable[[Scan], None],
        failed: Callable[[StreamFailed], None],
    ) -> None:
        self._stream = stream
        self._dialogue = dialogue
        self._latency = latency
        self._totals = totals
        self._trouble = trouble
        self._discarded = totals.assembled.broken_scans
        self._publish = publish
        self._failed = failed
        self._loop = asyncio.get_running_loop()
        self._wall_offset_ns = dialogue.wall_offset_ns
        self._assembler = Assembler(stream, dialogue.baudrate, self._wall_offset_ns, totals.assembled)
        self._pace = Pace(stream, dialogue.baudrate, latency, dialogue.bytes_received)
        self._watchdog: asyncio.TimerHandle | None = None
        self._keepalive: asyncio.TimerHandle | None = None
        self._began = self._last_packet = self._last_scan = self._loop.time()

    @property
    def mode(self) -> ScanMode:
        """The scan mode that runs."""
        return self._stream.mode

    def begin(self) -> None:
        """Take the packets over, and watch them."""
        stream = self._stream
        self._dialogue.chronicle.began(
            self._dialogue.stream_at,
            stream.mode,
            stream.format.shortest,
            stream.sample_ns,
            stream.slowest_turn_s,
            self._dialogue.baudrate,
            self._wall_offset_ns,
            stream.zero_offset_deg,
        )
        self._dialogue.deliver_to(self._take)
        self._dialogue.set_polling(self._latency, self._pace)
        if self._dialogue.is_live:
            self._watch()
        if self._stream.keepalive is not None:
            self._keepalive = self._loop.call_later(self._stream.keepalive.interval_s, self._keep_alive)

    def end(self) -> None:
        """Let go of everything; the device is not told. Harmless when done before."""
        self._dialogue.chronicle.ended(self._dialogue.bytes_fed)
        self._dialogue.deliver_to(None)
        self._assembler.end()
        for timer in (self._watchdog, self._keepalive):
            if timer is not None:
                timer.cancel()
        self._watchdog = self._keepalive = None
        if not self._loop.is_closed():
            self._dialogue.set_polling(0.0, None)

    def set_zero_offset(self, degrees: float) -> None:
        """Add another zero-angle offset from the next revolution on, clockwise degrees."""
        self._assembler.set_zero_offset(degrees)

    def _take(self, packets: Packets) -> None:
        self._last_packet = self._loop.time()
        for scan in self._assembler.add(packets):
            self._last_scan = self._last_packet
            self._pace.turned(scan, self._dialogue.bytes_received, self._last_packet)
            self._publish(scan)
        if self._totals.assembled.broken_scans > self._discarded:
            self._trouble.tell("revolutions discarded: %d so far", self._totals.assembled.broken_scans)
            self._discarded = self._totals.assembled.broken_scans

    def _watch(self) -> None:
        stream, now = self._stream, self._loop.time()
        patience = stream.spin_up_s if self._last_packet == self._began else SILENCE_S
        if now - self._last_packet >= patience:
            # The program may have blocked the loop: read what the line holds before judging it.
            self._dialogue.poll()
            now = self._loop.time()
        idle, turning = now - self._last_packet, now - self._last_scan
        if idle >= patience:
            came = self._dialogue.buffered or self._dialogue.stats.skipped_bytes
            why = "only noise arrives: is the baud rate right?" if came else "is it powered, and is the cable in?"
            self._failed(StreamFailed(f"no scan data for {idle:.1f} s; {why}"))
        elif turning >= stream.spin_up_s + REVOLUTIONS_MISSED * stream.slowest_turn_s:
            self._failed(
                StreamFailed(
                    f"scan data arrives, but no full revolution for {turning:.1f} s: is the rotor blocked?"
                )
            )
        else:
            wait = min(patience - idle, SILENCE_S) + _WATCH_MARGIN_S
            self._watchdog = self._loop.call_later(wait, self._watch)

    def _keep_alive(self) -> None:
        keepalive = self._stream.keepalive
        if keepalive is not None:
            self._dialogue.keep_alive(keepalive.request)
            self._totals.keepalives += 1
            self._keepalive = self._loop.call_later(keepalive.interval_s, self._keep_alive)
