"""What `Lidar.stats` shows: the counters of the line, of the stream and of the session, in one record."""

from __future__ import annotations

from lidario.model import LineErrors, Stats
from lidario.session.streaming.running import Totals
from lidario.session.talking.dialogue import Dialogue
from lidario.wire.stats import LinkStats


class Counters:
    """Sums the counters of one session over all lines that it has had."""

    def __init__(self) -> None:
        # What was counted on the lines that were lost.
        self._link = LinkStats()
        self._errors = LineErrors()
        self._keepalives = 0
        self._protection_stops = 0

    def line_lost(self, dialogue: Dialogue) -> None:
        """Add what was counted on a line that is not used any more."""
        self._link += dialogue.stats
        self._errors += dialogue.errors
        # What was incomplete when the line was lost will never be complete.
        self._link.skipped_bytes += dialogue.link.buffered
        self._keepalives += dialogue.port.repeated
        self._protection_stops += dialogue.protection_stops

    def stats(self, dialogue: Dialogue, totals: Totals, dropped: int, reconnects: int) -> Stats:
        """Everything that was counted so far, also on the line in use."""
        link, assembled = self._link + dialogue.stats, totals.assembled
        errors = self._errors + dialogue.errors
        return Stats(
            bytes_received=link.bytes_received,
            packets=link.packets,
            packet_bytes=link.packet_bytes,
            lost_packets=assembled.lost_packets,
            scan_packets=assembled.scan_packets,
            discarded_packets=assembled.discarded_packets + link.unread_packets,
            doubled_packets=assembled.doubled_packets,
            false_packets=assembled.false_packets,
            unfinished_packets=assembled.unfinished_packets + assembled.waiting_packets,
            records=link.records,
            record_bytes=link.record_bytes,
            skipped_bytes=link.skipped_bytes,
            skipped_stretches=link.skipped_stretches,
            response_bytes=link.response_bytes,
            stray_bytes=link.stray_bytes,
            drained_bytes=link.drained_bytes,
            discarded_bytes=link.discarded_bytes,
            late_reads=link.late_reads,
            framing_errors=errors.framing,
            parity_errors=errors.parity,
            overruns=errors.overruns,
            breaks=errors.breaks,
            buffered=dialogue.link.buffered,
            late_responses=link.late_responses,
            scans=assembled.scans,
            broken_scans=assembled.broken_scans,
            missed_scans=assembled.missed_scans,
            dropped_scans=dropped,
            interruptions=totals.interruptions,
            keepalives=totals.keepalives + self._keepalives + dialogue.port.repeated,
            restarts=totals.restarts,
            protection_stops=self._protection_stops + dialogue.protection_stops,
            reconnects=reconnects,
        )
