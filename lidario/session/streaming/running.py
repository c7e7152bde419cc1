"""One started stream, from its descriptor to its end: packets become scans, and somebody watches that they come.

`begin` takes the packets over, those included that came with the descriptor. `end` lets go of everything: no
timer is left, and the port is polled no more. Between them two things are watched: that packets come, and that
they make full revolutions. What must be repeated to keep the device going is repeated. What is wrong with a device
whose packets stay away is not judged here: `lidario.session.streaming.failures` asks it.

`StreamControl` makes one of these for each start and holds at most one.
"""

import asyncio
import logging
import math
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass, fields

from lidario.basics.model import Stats
from lidario.basics.words import counted
from lidario.errors import LidarError
from lidario.families.base import Keepalive, Stream
from lidario.revolution.assemble import AssemblerStats
from lidario.revolution.pipeline import Pipeline
from lidario.session.finding.connection import At
from lidario.session.streaming.forecast import Forecast
from lidario.session.streaming.readers import Hub
from lidario.session.talking.dialogue import Dialogue
from lidario.session.talking.trouble import mistake_of_ours
from lidario.wire.events import Packets
from lidario.wire.stats import LinkStats

_log = logging.getLogger("lidario")

SILENCE_S = 0.6
"""Longest time without a packet once they flow; longer than bytes are held (`lidario.port.reading.HOLD_S`). The
slowest format sends one every 20 ms. With the questions that follow, a dead device is told of within a second."""
NETWORK_SILENCE_S = 0.9
"""The same where the line has no speed: a wireless network may pause for longer."""
REVOLUTIONS_MISSED = 3
"""Revolutions of the slowest kind that may fail to complete before a stream of packets counts as stuck."""
NOISE_S = 0.15
"""Noise is what arrives without being a packet in that last part of the silence, and for as long behind it. What
came before may be half a packet, or an interference that is over; what does not go on, the text of a device that
has booted."""
NOISE_BYTES = 64
"""Fewer in that time are stray bytes. The slowest line carries ten times as many."""
LATE_KEEPALIVES = 2.5
"""Times the interval after which the thread writes a keepalive, since the loop has not."""
_WATCH_MARGIN_S = 0.001
"""Timers may fire early by the resolution of the clock; this much later the time is surely up."""
_NAMES = {each.name for each in fields(Stats)}


@dataclass(slots=True)
class Totals:
    """What outlives a single stream: counters, which only grow, as `Stats` tells them."""

    assembled: AssemblerStats
    interruptions: int = 0
    keepalives: int = 0
    restarts: int = 0


@dataclass(frozen=True, slots=True)
class Failure:
    """What is known of a stream that brings no scans, before the device was asked."""

    what: str  # what is known, in words, as the beginning of a sentence
    cause: str  # the likeliest cause, as a question, if the device turns out to be well
    noise: bool = False  # whether bytes arrive that are no packets
    sends: bool = False  # whether packets arrive that are understood, and measure nothing
    restart: bool = False  # whether it is worth starting the stream again, if the device turns out to be well
    lasted_s: float = 0.0  # seconds from its start to its last packet; 0 when there was none
    error: LidarError | None = None  # what its start failed with, if it did not even begin


class Running:
    """A stream that the device sends.

    `hub` is handed what comes of it; `failed` is called once if it falls silent or makes no revolutions.
    """

    def __init__(
        self, stream: Stream, at: At, latency: float, totals: Totals, hub: Hub, failed: Callable[[Failure], None]
    ) -> None:
        dialogue = at.dialogue
        self._stream = stream
        self._dialogue = dialogue
        self._totals = totals
        self._trouble = at.trouble
        self._discarded = totals.assembled.broken_scans
        self._hub = hub
        self._failed = failed
        self._loop = asyncio.get_running_loop()
        self._baudrate = stream.speed_on(dialogue.port.baudrate)
        wall_offset_ns = dialogue.port.wall_offset_ns
        self._pipeline = Pipeline(stream, self._baudrate, wall_offset_ns, totals.assembled, link=dialogue.link)
        self._forecast = Forecast(stream, self._baudrate, latency, dialogue.stats.bytes_received)
        self._watchdog: asyncio.TimerHandle | None = None
        self._keepalive: asyncio.TimerHandle | None = None
        self._began = self._last_packet = self._last_scan = self._loop.time()
        self._silence_s = SILENCE_S if dialogue.port.baudrate else NETWORK_SILENCE_S
        if stream.format.whole:
            # A damaged byte costs a packet that is a whole revolution.
            self._silence_s = max(self._silence_s, stream.slowest_turn_s)
        # When the last part of a silence began: bytes not understood so far, and packets that measure nothing.
        self._strange = self._records = 0
        self._noisy = False  # whether bytes were not understood at the end of the silence
        self._watch_due = self._began
        self._note_damage()

    def begin(self) -> None:
        """Take the packets over, and watch them."""
        stream = self._stream
        self._dialogue.chronicle.began(
            stream,
            self._dialogue.link.stream_at,
            self._baudrate,
            self._pipeline.assembler.wall_offset_ns,
            continues=self._totals.assembled.left_off is not None,
        )
        self.divide()
        self._dialogue.deliver_to(self._take)
        self._dialogue.port.set_polling(self._forecast)
        if self._dialogue.port.is_live:
            self._watch()
        if (keepalive := stream.keepalive) is not None:
            self._keepalive = self._loop.call_later(keepalive.interval_s, self._keep_alive, keepalive)
            self._dialogue.port.set_repeat(keepalive.request.data, LATE_KEEPALIVES * keepalive.interval_s)

    def end(self) -> None:
        """Let go of everything; the device is not told. Harmless when done before."""
        if self._keepalive is not None:
            # First: a keepalive of the thread behind the stop requests would start the device again.
            self._dialogue.port.set_repeat(b"")
        self._dialogue.chronicle.ended(self._dialogue.link.fed)
        self._dialogue.deliver_to(None)
        for timer in (self._watchdog, self._keepalive):
            if timer is not None:
                timer.cancel()
        self._watchdog = self._keepalive = None
        self._dialogue.port.set_polling(None)
        try:
            for scan in self._pipeline.assembler.end():
                self._hub.publish(scan)
        except Exception as error:  # the stop requests come behind this
            mistake_of_ours("lidario failed when a stream ended", error)

    def set_zero_offset(self, degrees: float, *, behind: bool) -> None:
        """Add another zero-angle offset, as `Assembler.set_zero_offset`."""
        # Recordings hold the place. What was read before is parsed first, as a replay does.
        self._dialogue.port.poll()
        self._dialogue.chronicle.zero_offset_set(
            self._dialogue.link.fed, degrees, behind=behind or self._pipeline.assembler.keeps_offset
        )
        self._pipeline.assembler.set_zero_offset(degrees, behind=behind)

    def divide(self) -> None:
        """Publish the sectors that somebody reads, from the next revolution on."""
        self._pipeline.assembler.divide(self._hub.parts, self._hub.publish_sector)
        self._forecast.expect(math.nan)

    def _take(self, packets: Packets) -> Iterator[None]:
        self._last_packet = self._loop.time()
        port = self._dialogue.port
        if port.is_live and (offset_ns := port.wall_offset_ns) != self._pipeline.assembler.wall_offset_ns:
            self._follow_clock(offset_ns)
        counted = self._totals.assembled
        for scans in self._pipeline.take(packets):
            for scan in scans:
                self._last_scan = self._last_packet
                self._forecast.turned(scan, self._dialogue.stats.bytes_received, self._last_packet)
                self._hub.publish(scan)
            if scans and (note := self._pipeline.take_note()):
                _log.warning(note)
            if counted.broken_scans > self._discarded:
                self._trouble.tell("revolutions discarded: %d so far", counted.broken_scans)
                self._discarded = counted.broken_scans
            yield
        if self._hub.parts:
            self._forecast.expect(self._pipeline.assembler.next_ns)

    def _follow_clock(self, wall_offset_ns: int) -> None:
        step_s = (wall_offset_ns - self._pipeline.assembler.wall_offset_ns) * 1e-9
        _log.warning("the clock of this computer was set by %.3f s, and so are the stamps of scans", step_s)
        self._pipeline.assembler.wall_offset_ns = wall_offset_ns
        self._dialogue.chronicle.clock_set(wall_offset_ns)

    @property
    def _has_turned(self) -> bool:
        """Whether there was a scan."""
        return self._last_scan > self._began

    def _note_damage(self) -> None:
        """Remember what is counted as damaged so far: what is more later has come behind the last scan."""
        self._noted_at = self._last_scan
        self._broken_before = self._totals.assembled.broken_scans
        self._lost_before = self._totals.assembled.lost_packets
        self._late_before = self._dialogue.stats.late_reads
        self._errors_before = self._dialogue.port.errors

    def _watch(self) -> None:
        began = self._last_packet == self._began
        patience = self._stream.spin_up_s if began else self._silence_s
        turns = REVOLUTIONS_MISSED * self._stream.slowest_turn_s
        if not self._has_turned:
            # One that has turned need not speed up again.
            turns += self._stream.spin_up_s
        now = self._loop.time()
        if now - self._last_packet >= patience - NOISE_S or now - self._last_scan >= turns:
            # The program may have blocked the loop: read what the line holds before judging it.
            self._dialogue.port.poll()
            now = self._loop.time()
        idle, turning = now - self._last_packet, now - self._last_scan
        lasted_s = self._last_packet - self._began
        # Records are understood, though nothing is measured: of a rotor that is too fast, for one.
        strange, records, stats = self._strange, self._records, self._dialogue.stats
        self._strange, self._records = stats.bytes_received - stats.record_bytes, stats.records
        was_noisy, noise, sends = self._noisy, self._strange - strange >= NOISE_BYTES, self._records > records
        # On a poor line many packets in a row may be damaged where each is a whole revolution.
        may_come = noise and self._stream.format.whole and turning < turns
        self._noisy = noise and idle >= patience
        if now - self._watch_due > NOISE_S:
            # The program has blocked the loop. What the line holds may not be here yet, and what came before the
            # block says nothing of the time since.
            self._watch_in(NOISE_S)
        elif self._noisy and not was_noisy:
            # Noise goes on; the text of a device that has booted does not.
            self._watch_in(NOISE_S)
        elif idle >= patience and not may_come:
            what = f"no scan data for {idle:.1f} s{', though other packets arrive' * sends}"
            cause, restart = "does the rotor turn? Is the power supply strong enough?", not began
            self._failed(Failure(what, cause, noise=noise, sends=sends, restart=restart, lasted_s=lasted_s))
        elif turning >= turns:
            what = f"scan data arrives, but no full revolution for {turning:.1f} s"
            self._failed(Failure(what, self._why_no_revolution(), lasted_s=lasted_s))
        else:
            if self._last_scan > self._noted_at:
                self._note_damage()
            # First to the last part of the silence, then to its end.
            wait = next((due - idle for due in (patience - NOISE_S, patience) if idle < due), NOISE_S)
            self._watch_in(min(wait, self._silence_s, turns - turning) + _WATCH_MARGIN_S)

    def _why_no_revolution(self) -> str:
        """What to look for where packets come and no revolution does."""
        seen = self._totals.assembled
        lost = seen.lost_packets - self._lost_before
        if seen.broken_scans == self._broken_before or not lost:
            return "is the rotor blocked?"
        lacks = f"it lacks {counted(lost, 'packet')}"
        if self._dialogue.stats.late_reads > self._late_before:
            return f"{lacks}: this computer was too busy to read"
        if errors := (self._dialogue.port.errors - self._errors_before).meaning():
            return f"{lacks}, damaged or missing, with {errors}"
        return f"{lacks}, damaged or missing. Check the cable, the plug and the power supply"

    def _watch_in(self, seconds: float) -> None:
        self._watch_due = self._loop.time() + seconds
        self._watchdog = self._loop.call_at(self._watch_due, self._watch)

    def _keep_alive(self, keepalive: Keepalive) -> None:
        self._totals.keepalives += self._dialogue.keep_alive(keepalive.request)
        self._keepalive = self._loop.call_later(keepalive.interval_s, self._keep_alive, keepalive)


class Counters:
    """Sums the counters of one session over all lines that it has had."""

    def __init__(self) -> None:
        # What was counted on the lines that were lost, by its name in `Stats`.
        self._before = Counter[str]()

    def line_lost(self, dialogue: Dialogue) -> None:
        """Add what was counted on a line that is not used any more."""
        self._before.update(_of_line(dialogue))
        # What was incomplete when the line was lost will never be complete.
        self._before["skipped_bytes"] += dialogue.link.buffered

    def stats(self, dialogue: Dialogue, totals: Totals, dropped: int, reconnects: int) -> Stats:
        """Everything that was counted so far, also on the line in use."""
        counted = self._before.copy()
        for each in (_of_line(dialogue), _named(totals), _named(totals.assembled)):
            counted.update(each)
        counted["unfinished_packets"] += totals.assembled.waiting_packets
        return Stats(**counted, buffered=dialogue.link.buffered, dropped_scans=dropped, reconnects=reconnects)


def _of_line(dialogue: Dialogue) -> dict[str, int]:
    errors = dialogue.errors
    return _named(dialogue.stats) | {
        "discarded_packets": dialogue.stats.unread_packets,
        "framing_errors": errors.framing,
        "parity_errors": errors.parity,
        "overruns": errors.overruns,
        "breaks": errors.breaks,
        "keepalives": dialogue.port.repeated,
        "protection_stops": dialogue.protection_stops,
    }


def _named(counted: LinkStats | AssemblerStats | Totals) -> dict[str, int]:
    """The counters that `Stats` has by the same name."""
    return {each.name: getattr(counted, each.name) for each in fields(counted) if each.name in _NAMES}
