"""How far a recording was gone through: the place of its bytes, their time, and the stream that runs.

All three are told again by each chunk of a file, or follow from what came before. A chunk may be missing, and a
time may be wrong. So bytes behind a chunk that is missing are used from the next place on that is told, and a time
that jumps farther than any lidar rests is taken back.
"""

from collections.abc import Iterator
from dataclasses import replace
from typing import NamedTuple

from lidario.errors import RecordingError
from lidario.recording.about import About
from lidario.recording.chronicle import (
    EventState,
    Placed,
    Responded,
    StreamBegan,
    StreamEnded,
    StreamEvent,
    ZeroOffsetSet,
    moved,
)
from lidario.recording.mcap_records import Damage, Message
from lidario.recording.ros_messages import parse_raw

MOST_BACK_NS = 60 * 10**9
MOST_AHEAD_NS = 366 * 86_400 * 10**9
"""How far the time of a chunk of bytes may be from that of the one before. A chunk that waited for the loop is
seconds late, and a lidar may rest for months; what jumps farther is no time."""
OVERLAP_NS = 2 * 10**8
"""Clocks of two recordings may differ by so much, where one begins as soon as the other has ended."""
SAME_TIME = "recordings of the same time are not read one after the other: name one of them"
TWICE = "a recording that was merged with a copy of itself holds each byte twice: name the file that it was made of"


class StoredChunk(NamedTuple):
    """Bytes of one read or write, with its time on the clock of the file.

    `place` is that of the first of them, where they were received.
    """

    at_ns: int
    place: int
    sent: bool
    data: bytes


class Reached:
    """How far a file was gone through."""

    def __init__(self) -> None:
        self.about: About | None = None  # the beginning of the first file; None before that
        self.place: int = 0  # place of the next received byte
        # Whether place and stream are known: behind a chunk that is missing they are not, until the next one tells
        # them.
        self.is_known: bool = True
        self._state = EventState()
        self._last_ns: int | None = None
        self._shift_ns = 0
        self._place_before = 0  # before the bytes of the latest time: what has one time may stand in another order
        # Of the recording that is read: its digits, what is added to its places, the least of them, and its clock
        # minus that of the first one; and whether no chunk of it was seen.
        self._recording = ""
        self._done: set[str] = set()
        self._shift = self._least = 0
        self._clock_ns = 0
        self._is_new = False

    def repeats(self, about: About) -> bool:
        """Whether the file that begins so holds what was read before: a copy, or another name of the same file."""
        place = about.received_before + self._shift
        return bool(self._recording) and about.recording == self._recording and place < self.place

    def begin(self, about: About) -> Iterator[About | StreamEvent | Damage]:
        """The beginning of a file was read. It is the first one, goes on, or is of another recording."""
        if self.about is None:
            self.about, self._recording, self.place = about, about.recording, about.received_before
            self._state = EventState(about.events)
            yield about
            return
        responses = [event for event in about.events if isinstance(event, Responded)]
        if self._recording and about.recording == self._recording:
            yield from self.event(Placed(about.received_before, about.running))
            yield from responses
            return
        if self._state.running is not None:
            yield StreamEnded(self.place)
        if about.recording in self._done:
            raise RecordingError(SAME_TIME)
        self._done |= {self._recording} - {""}
        self._state = EventState()
        self._recording, self.is_known, self._is_new = about.recording, True, True
        self._shift, self._least = self.place - about.received_before, self.place
        self._clock_ns = about.clock_offset_ns - self.about.clock_offset_ns
        yield from responses
        if about.running is not None:
            # What passed between two recordings is no failure of the lidar.
            yield from self.event(replace(about.running, continues=False))

    def chunk(self, message: Message) -> Iterator[StoredChunk | Damage]:
        """Bytes of the file, where they can be placed; their time follows that of the bytes before."""
        raw = parse_raw(message.data)
        if raw is None:
            return
        at_ns = message.at_ns + self._shift_ns
        last_ns = at_ns if self._last_ns is None else self._last_ns
        if not -MOST_BACK_NS <= at_ns - last_ns <= MOST_AHEAD_NS:
            yield Damage("its times jump, and what follows is shown without the jump", missing=False)
            self._shift_ns += last_ns - at_ns
            at_ns = last_ns
        if self._is_new and message.at_ns < last_ns - OVERLAP_NS:
            raise RecordingError(SAME_TIME)
        self._is_new = False
        if at_ns != self._last_ns:
            self._place_before = self.place
        self._last_ns = at_ns
        sent, data = raw
        place = self.place
        if not sent:
            if not self.is_known:
                return
            self.place += len(data)
        yield StoredChunk(at_ns, place, sent, data)

    def event(self, event: StreamEvent) -> Iterator[StreamEvent | Damage]:
        """An event of the file; where one tells what stands there, the events that are missing before it.

        Raises:
            RecordingError: The file tells again what came before.
        """
        # With the places and the clock of the first recording.
        event = moved(event, self._shift, self._least, self._clock_ns)
        is_back = isinstance(event, Placed) and event.at < self._place_before
        if is_back or (isinstance(event, StreamBegan) and event == self._state.running):
            raise RecordingError(TWICE)
        if not isinstance(event, Placed):
            self._state.follow(event)
            yield event
            return
        if event.at < self.place:
            return
        if self.is_known and event.at > self.place:
            yield Damage("bytes are missing")
            self.is_known = False
        if not self.is_known:
            for missing in self._missing(event):
                self._state.follow(missing)
                yield missing
        self.place, self.is_known = event.at, True

    def _missing(self, told: Placed) -> Iterator[StreamEvent]:
        before, now = self._state.running, told.running
        if before is not None and (now is None or now.at != before.at):
            yield StreamEnded(self.place)
        if now is not None and (before is None or now.at != before.at):
            yield now
        elif now is not None and before is not None and now.zero_offset_deg != before.zero_offset_deg:
            yield ZeroOffsetSet(told.at, now.zero_offset_deg)
