"""Reading a recording: what it is of, and what was received in each stream.

A file is gone through once when it is opened, which tells its streams and what of it is damaged, and again for each
use. Nothing but one chunk of the file is held.

`raw.bin`, bytes as they were received, is read by `lidario.recording.files`.
"""

from abc import ABC, abstractmethod
from collections import Counter, deque
from collections.abc import Callable, Generator, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import zip_longest
from pathlib import Path
from typing import NamedTuple

from lidario.basics.system import working_folder
from lidario.errors import ConnectFailed, RecordingError
from lidario.families.base import Decoder, Family, Stream
from lidario.families.registry import family_named
from lidario.recording.about import About
from lidario.recording.chronicle import (
    MOST_NS,
    EventState,
    LineChanged,
    Responded,
    StreamBegan,
    StreamEnded,
    StreamEvent,
    ZeroOffsetSet,
    text_of,
)
from lidario.recording.mcap_records import MAGIC, Damage, Metadata
from lidario.recording.opened import StoredFile
from lidario.recording.reached import StoredChunk
from lidario.recording.sequence import RecordedFiles
from lidario.recording.write import FileWriter
from lidario.wire.formats import StreamFormat

SPIN_UP_S = 5.0  # until the first packet; a replay does not wait for it
LONGEST_PAUSE_NS = 5_000_000_000
"""Longest pause inside a stream that is played; live, a session starts a silent stream again within that time. A
time that is wrong must not hold up a reader for years."""

Copy = tuple[int, Callable[[FileWriter], None]]
"""The time of a chunk, event or set of texts, and what adds it to another file."""
MOST_TEXTS = 1024
"""Sets of texts that are copied; a report has some 40. Each has a place in the index, which is held to the end."""


class Piece(NamedTuple):
    """Bytes of one read."""

    stream: int  # number of the stream that they belong to
    at_ns: int  # when they were read, on the clock of the recording
    data: bytes
    # The zero-angle offset that holds from the first revolution on that ends in them or later.
    zero_offset_deg: float
    behind: bool = False  # whether it holds only from the revolution behind that one
    place: int = 0  # place of the first of them among all that were received


@dataclass(frozen=True, slots=True)
class StoredStream:
    """One stream of a recording."""

    family: Family  # whose packets it has
    began: StreamBegan  # what is known of it
    end: int | None = None  # place behind its last byte; None where the recording ends in its midst
    offsets: tuple[ZeroOffsetSet, ...] = ()  # where its zero-angle offset changed, in order
    timed: bool = True  # whether it tells when its bytes came

    def open(self) -> Stream:
        """A fresh format and decoder for it, and all that a session must know.

        Raises:
            RecordingError: This version does not know its format.
        """
        wire, decoder = self._format()
        return Stream(
            format=wire,
            decoder=decoder,
            mode=self.began.mode,
            sample_ns=self.began.sample_ns,
            spin_up_s=SPIN_UP_S,
            slowest_turn_s=self.began.slowest_turn_s,
            zero_offset_deg=self.began.zero_offset_deg,
            may_take_ns=self.began.may_take_ns,
            timed=self.timed,
        )

    def _format(self) -> tuple[StreamFormat, Decoder]:
        """The format, and what decodes it; what another machine sends has its own."""
        found = self.family.stream_in(self.began.mode)
        if found is None:
            raise RecordingError(
                f"the recording has packets of an unknown type, 0x{self.began.mode.response_type:02X}"
            )
        return found


class StoredStreams(ABC):
    """What can be played."""

    about: About  # what stands at its beginning
    streams: tuple[StoredStream, ...]  # the streams, in order; never empty

    def __init__(self, path: Path, *, timed: bool = True) -> None:
        self.path: Path = path  # the file, or what names its files
        self.paths: tuple[Path, ...] = (path,)  # its files
        self.folder: Path = working_folder()  # where relative paths begin
        self.timed: bool = timed  # whether it is known when each byte was read
        self.responses: dict[bytes, Responded] = {}  # request -> the latest response to it
        # What of the file is missing or was changed, as far as that can be told; empty where nothing is.
        self.damage: str = ""
        self.size: int = 0  # bytes of the file
        # When the first byte of the first stream was read, on the clock of the pieces, and the time to the last.
        self.began_ns: int = 0
        self.duration_ns: int = 0
        # How long the device was away, each time that it was lost and the recording went on.
        self.away_ns: tuple[int, ...] = ()

    @abstractmethod
    def pieces(self) -> Iterator[Piece]:
        """What was received in the streams, in order. Each call begins anew."""

    def copies(self) -> Generator[Copy, None, None]:
        """Every chunk, event and set of other texts, in order; nothing where the file has only bytes."""
        yield from ()


class Player:
    """Goes through the pieces of a recording, so many times as fast; first `pieces`, if that is not all of it."""

    def __init__(self, recording: StoredStreams, rate: float, pieces: Iterator[Piece] | None = None) -> None:
        self._recording = recording
        self._rate = rate
        self._pieces = recording.pieces() if pieces is None else pieces
        self._next: Piece | None = None
        # The caller's time and the recorded time that belong together; None while it rests.
        self._base: tuple[int, int] | None = None
        self._stream = -1
        self._reached_ns = 0

    def peek(self) -> Piece | None:
        """The next piece; None at the end.

        Raises:
            RecordingError: The file cannot be read any more; behind that is the end.
        """
        if self._next is None:
            self._next = next(self._pieces, None)
        return self._next

    def take(self, piece: Piece) -> None:
        """The next piece is played: go on to the one behind it."""
        self._next = None
        self._reached_ns = piece.at_ns

    def due(self, piece: Piece, now_ns: int) -> int:
        """When the next piece is due, on the caller's clock.

        The first one of a stream, behind a rest, and behind a pause that is too long is due at once.
        """
        pause_ns = piece.at_ns - self._reached_ns
        if self._base is None or piece.stream != self._stream or pause_ns > LONGEST_PAUSE_NS:
            self._base = (now_ns, piece.at_ns)
            self._stream, self._reached_ns = piece.stream, piece.at_ns
        began_ns, first_ns = self._base
        return began_ns + round((piece.at_ns - first_ns) / self._rate)

    def rest(self) -> None:
        """Nothing is played now: what comes next is due at once."""
        self._base = None

    def begin_anew(self) -> None:
        """Go back to the beginning of the recording."""
        self._pieces, self._next = self._recording.pieces(), None
        self.rest()

    def end(self) -> None:
        """Play no more: the file is closed."""
        self._pieces, self._next = iter(()), None


def is_mcap(path: Path) -> bool:
    """Whether a file says that it is MCAP; raises as `StoredFile`."""
    with StoredFile(path) as file:
        return file.read(len(MAGIC)) == MAGIC


class McapRecording(StoredStreams):
    """A recording that `Lidar.record` made: a file, or the files that a pattern names, in the order of their times.

    Raises:
        RecordingError: It is none, or no stream can be read of it; the text says why.
    """

    def __init__(self, path: Path, paths: Sequence[Path] = ()) -> None:
        super().__init__(path)
        self._files = RecordedFiles(path, paths or (path,))
        self.paths: tuple[Path, ...] = self._files.paths
        events = self._go_through()
        self.size: int = self._files.size
        self.responses: dict[bytes, Responded] = EventState(events).responses
        if not self.about.info.family:
            raise RecordingError(f"{path} is of a device that responds in no known way: nothing is decoded")
        try:
            family = family_named(self.about.info.family)
        except ConnectFailed as error:
            raise RecordingError(f"{path}: {error}") from error
        self.streams: tuple[StoredStream, ...] = tuple(self._find_streams(family, events))
        if not self.streams:
            why = f": {self.damage}" if self.damage else ""
            raise RecordingError(f"{path} has no measurement stream{why}")
        for stream in self.streams:
            stream.open()

    def _go_through(self) -> list[StreamEvent]:
        """Read all of it once: what it is of, what is damaged, when it began and ended. Returns its events."""
        about: About | None = None
        events: list[StreamEvent] = []
        first = last = None
        told: Counter[str] = Counter()
        for record in self._files.records():
            if isinstance(record, StoredChunk):
                if first is None and any(isinstance(each, StreamBegan) for each in events):
                    first = record.at_ns
                last = record.at_ns
            elif isinstance(record, About):
                about = record
                events += record.events
            elif isinstance(record, Damage):
                told[record.why] += 1
            elif isinstance(record, LineChanged):
                self.away_ns: tuple[int, ...] = (*self.away_ns, record.away_ns)
            elif isinstance(record, StreamEvent):
                events.append(record)
        self.damage: str = "; ".join(f"{why} ({times} times)" if times > 1 else why for why, times in told.items())
        if about is None:
            why = self.damage or "it says nothing of a lidar"
            raise RecordingError(f"{self.path} is not a recording of lidario: {why}")
        self.about = about
        if first is not None and last is not None:
            self.duration_ns: int = max(0, last - first)
        self.began_ns: int = (first or 0) - about.clock_offset_ns
        return events

    def pieces(self) -> Iterator[Piece]:
        offset_ns = self.about.clock_offset_ns
        stretches = deque(_stretches(self.streams))
        for record in self._files.records():
            if not isinstance(record, StoredChunk) or record.sent:
                continue
            at_ns, begin, _, data = record
            place = begin + len(data)
            at_ns = min(max(at_ns - offset_ns, -MOST_NS // 2), MOST_NS // 2)
            while stretches:
                number, first, end, offset = stretches[0]
                low, high = max(begin, first), min(place, end)
                if low < high:
                    data_here = data[low - begin : high - begin]
                    yield Piece(number, at_ns, data_here, offset.zero_offset_deg, offset.behind, low)
                if place < end:
                    break
                stretches.popleft()

    def copies(self) -> Generator[Copy, None, None]:
        at_ns, texts = self.about.began_ns, 0
        for record in self._files.records():
            if isinstance(record, StoredChunk):
                at_ns = min(max(record.at_ns, 0), MOST_NS)
                yield at_ns, partial(FileWriter.add_chunk, **record._replace(at_ns=at_ns)._asdict())
            elif isinstance(record, StreamEvent):
                yield at_ns, partial(FileWriter.add_event, at_ns=at_ns, text=text_of(record))
            elif isinstance(record, Metadata) and texts < MOST_TEXTS:
                texts += 1
                yield at_ns, partial(FileWriter.add_metadata, name=record.name, texts=record.texts)

    def _find_streams(self, family: Family, events: Sequence[StreamEvent]) -> Iterator[StoredStream]:
        began: StreamBegan | None = None
        offsets: list[ZeroOffsetSet] = []
        least = self.about.received_before
        for event in events:
            if isinstance(event, StreamBegan):
                # Places only grow; a file that says otherwise is not ours.
                if event.at >= least or began is None:
                    began, offsets = event, []
            elif isinstance(event, ZeroOffsetSet):
                if began is not None and event.at >= (offsets[-1] if offsets else began).at:
                    offsets.append(event)
            elif isinstance(event, StreamEnded) and began is not None:
                if event.at > max(began.at, least):
                    yield StoredStream(family, began, event.at, tuple(offsets))
                    least = event.at
                began = None
        if began is not None:
            yield StoredStream(family, began, offsets=tuple(offsets))


def _stretches(streams: Sequence[StoredStream]) -> Iterator[tuple[int, int, int, ZeroOffsetSet]]:
    """From where to where which stream has which zero-angle offset, in places, in order."""
    for number, stream in enumerate(streams):
        end = 2 * MOST_NS if stream.end is None else stream.end
        offsets = ZeroOffsetSet(stream.began.at, stream.began.zero_offset_deg), *stream.offsets
        for offset, following in zip_longest(offsets, stream.offsets):
            yield number, offset.at, end if following is None else min(following.at, end), offset
