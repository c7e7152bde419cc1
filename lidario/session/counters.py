"""What `Lidar.stats` shows: the counters of the line, of the stream and of the session, in one record."""

from __future__ import annotations

from collections import Counter
from dataclasses import fields

from lidario.model import Stats
from lidario.revolution.stats import AssemblerStats
from lidario.session.streaming.running import Totals
from lidario.session.talking.dialogue import Dialogue
from lidario.wire.stats import LinkStats

_NAMES = {each.name for each in fields(Stats)}


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
