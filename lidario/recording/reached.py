"""How far a recording was gone through: the place of its bytes, their time, and the stream that runs.

All three are told again by each chunk of a file, or follow from what came before. A chunk may be missing, and a
time may be wrong. So bytes behind a chunk that is missing are used from the next place on that is told, and a time
that jumps farther than any lidar rests is taken back.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import NamedTuple

from lidario.recording.about import About
from lidario.recording.chronicle import Placed, StreamBegan, StreamEnded, StreamEvent, ZeroOffsetSet
from lidario.recording.mcap_records import Damage, Message
from lidario.recording.ros_messages import parse_raw

__all__ = ["Reached", "StoredChunk"]

MOST_BACK_NS = 60 * 10**9
MOST_AHEAD_NS = 366 * 86_400 * 10**9
"""How far the time of a chunk of bytes may be from that of the one before. A chunk that waited for the loop is
seconds late, and a lidar may rest for months; what jumps farther is no time."""


class StoredChunk(NamedTuple):
    """Bytes of one read or write, as they stand in the file.

    Attributes:
        at_ns: When that was, on the clock of the file.
        place: Place of the first of them, where they were received.
        sent: Whether they were sent.
        data: The bytes.
    """

    at_ns: int
    place: int
    sent: bool
    data: bytes


class Reached:
    """How far a file was gone through.

    Attributes:
        place: Place of the next received byte.
        is_known: Whether place and stream are known: behind a chunk that is missing they are not, until the next
            one tells them.
        jumped: Set where a time jumps, which is told and cleared by the caller.
    """

    def __init__(self) -> None:
        self.place: int = 0
        self.is_known: bool = True
        self.jumped: bool = False
        self._running: StreamBegan | None = None
        self._last_ns: int | None = None
        self._shift_ns = 0

    def begin(self, about: About) -> None:
        """The beginning of the file was read."""
        self.place = about.received_before
        for event in about.events:
            self._follow(event)

    def chunk(self, message: Message) -> StoredChunk | None:
        """Bytes of the file, where they can be placed; their time follows that of the bytes before."""
        raw = parse_raw(message.data)
        if raw is None:
            return None
        at_ns = message.at_ns + self._shift_ns
        last_ns = at_ns if self._last_ns is None else self._last_ns
        if not -MOST_BACK_NS <= at_ns - last_ns <= MOST_AHEAD_NS:
            self.jumped = True
            self._shift_ns += last_ns - at_ns
            at_ns = last_ns
        self._last_ns = at_ns
        sent, data = raw
        place = self.place
        if not sent:
            if not self.is_known:
                return None
            self.place += len(data)
        return StoredChunk(at_ns, place, sent, data)

    def event(self, event: StreamEvent) -> Iterator[StreamEvent | Damage]:
        """An event of the file; where one tells what stands there, the events that are missing before it."""
        if not isinstance(event, Placed):
            self._follow(event)
            yield event
            return
        if event.at < self.place:
            return
        if self.is_known and event.at > self.place:
            yield Damage("bytes are missing")
            self.is_known = False
        if not self.is_known:
            for missing in self._missing(event):
                self._follow(missing)
                yield missing
        self.place, self.is_known = event.at, True

    def _missing(self, told: Placed) -> Iterator[StreamEvent]:
        before, now = self._running, told.running
        if before is not None and (now is None or now.at != before.at):
            yield StreamEnded(self.place)
        if now is not None and (before is None or now.at != before.at):
            yield now
        elif now is not None and before is not None and now.zero_offset_deg != before.zero_offset_deg:
            yield ZeroOffsetSet(told.at, now.zero_offset_deg)

    def _follow(self, event: StreamEvent) -> None:
        if isinstance(event, StreamBegan):
            self._running = event
        elif isinstance(event, StreamEnded):
            self._running = None
        elif isinstance(event, ZeroOffsetSet) and self._running is not None:
            self._running = replace(self._running, zero_offset_deg=event.zero_offset_deg)
