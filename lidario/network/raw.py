"""Scans from the raw messages of one publisher, as they come: the same parser and decoders as live, no session.

The bytes alone do not tell whose packets they are. That stands in the status, which each publisher sends once a
second, and in the messages themselves where a stream begins or ends. Until it is known, bytes are left out.
"""

from collections import OrderedDict
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from itertools import groupby
from operator import attrgetter
from typing import Final

from lidario.families.base import Family
from lidario.families.registry import FAMILIES
from lidario.network.messages import Entry, parse_raw_message
from lidario.network.status import Status
from lidario.port.wall_clock import WallClock
from lidario.recording.chronicle import MOST_NS, StreamBegan, StreamEnded, StreamEvent, ZeroOffsetSet, event_of
from lidario.recording.read import StoredStream
from lidario.revolution.assemble import AssemblerStats
from lidario.revolution.pipeline import Pipeline
from lidario.revolution.together import join_reads
from lidario.scans.scan import Scan
from lidario.wire.events import EARLIEST_NS

MOST_DECODER_BYTES: Final = 32 << 20  # of all decoders of a fleet: those of a thousand lidars
DECODER_BYTES: Final = 12288
PACKET_BYTES: Final = 128
"""What a packet takes at most beside its bytes, about: when it came."""


def in_order(entries: Iterable[Entry]) -> Iterator[list[Entry] | StreamEvent | None]:
    """What a message holds: reads that follow each other together, and the events between them (None: unknown)."""
    for is_event, group in groupby(entries, attrgetter("is_event")):
        if is_event:
            yield from (event_of(entry.data.decode("utf-8", "replace")) for entry in group)
        else:
            yield list(group)


def reads_here(entries: Iterable[Entry], began: StreamBegan, wall_offset_ns: int) -> list[tuple[bytes, int]]:
    """Reads with their times on the clock of this machine; both agree about the wall clock, as far as machines do.

    Reads with a time that cannot be are left out: the sums of a scan's times would not fit in 64 bits.
    """
    ahead_ns = began.wall_offset_ns - wall_offset_ns
    return [(entry.data, entry.at_ns + ahead_ns) for entry in entries if abs(entry.at_ns + ahead_ns) < MOST_NS]


class RawDecoder:
    """Decodes what one publisher sends; `clock` is that of this machine, `stats` what became of the packets."""

    def __init__(self, clock: WallClock) -> None:
        self.stats: AssemblerStats = AssemblerStats()
        self._clock = clock
        self._wall_offset_ns = 0  # as it was when the stream began, or was first heard of: a stream has one clock
        self._family: Family | None = None
        self._began: StreamBegan | None = None
        self._pipeline: Pipeline | None = None
        self._last_ns = EARLIEST_NS

    @property
    def held(self) -> int:
        """Bytes that it takes, about: what it is itself, and the packets of the revolution in the making."""
        longest = 0 if self._pipeline is None else self._pipeline.stream.format.longest
        return DECODER_BYTES + self.stats.unfinished_packets * (longest + PACKET_BYTES)

    def learn(self, status: Status) -> None:
        """Take what the publisher tells of its lidar, and of the stream that runs.

        Where that has ended, the message that said so is missing, and scans that it would have brought are, too.
        """
        name = status.about.info.family
        if self._family is None or self._family.name != name:
            self._end()
            self._family = next((each for each in FAMILIES if each.name == name), None)
        if status.about.running is None:
            self._end()
        else:
            self._begin(status.about.running)

    def steps(self, message: bytes) -> Iterator[list[Scan]] | None:
        """Take a message, in steps of bounded work: the scans that each completes. None where it is no message."""
        entries = parse_raw_message(message)
        return None if entries is None else self._decode(entries)

    def _decode(self, entries: Sequence[Entry]) -> Iterator[list[Scan]]:
        for each in in_order(entries):
            if isinstance(each, list):
                yield from self._receive(each)
                continue
            left = list[Scan]()
            if isinstance(each, StreamBegan):
                left = self._begin(each)
            elif isinstance(each, ZeroOffsetSet) and self._began is not None:
                left = self._begin(replace(self._began, zero_offset_deg=each.zero_offset_deg), behind=each.behind)
            elif isinstance(each, StreamEnded):
                left = self._end()
            yield left

    def _receive(self, entries: Sequence[Entry]) -> Iterator[list[Scan]]:
        """Parse and decode what was read."""
        if self._pipeline is None or self._began is None:
            return
        if reads := reads_here(entries, self._began, self._wall_offset_ns):
            data, self._last_ns, arrivals = join_reads(reads, self._last_ns)
            yield from self._pipeline.steps(data, self._last_ns, arrivals)

    def _begin(self, began: StreamBegan, *, behind: bool = False) -> list[Scan]:
        """Begin with a stream, or go on with it; returns what is left of the one before, as `Assembler.end`."""
        before, pipeline = self._began, self._pipeline
        if began == before:
            return []
        if pipeline and before and before == replace(began, zero_offset_deg=before.zero_offset_deg):
            # The same stream goes on.
            pipeline.assembler.set_zero_offset(began.zero_offset_deg, behind=behind)
            self._began = began
            return []
        left = self._end()
        if self._family is None or self._family.stream_in(began.mode) is None:
            return left
        self._began, self._wall_offset_ns = began, self._clock.wall_offset_ns
        stream = StoredStream(self._family, began).open()
        self._pipeline = Pipeline(stream, began.baudrate, self._wall_offset_ns, self.stats)
        self._last_ns = EARLIEST_NS
        return left

    def _end(self) -> list[Scan]:
        left = [] if self._pipeline is None else self._pipeline.assembler.end()
        self._began = self._pipeline = None
        return left


class Decoders:
    """The decoders of a fleet; those not heard for longest are forgotten where all take too much."""

    def __init__(self, clock: WallClock) -> None:
        self._clock = clock
        self._known: OrderedDict[tuple[str, bytes], tuple[RawDecoder, int]] = OrderedDict()
        self._size = 0

    def __len__(self) -> int:
        return len(self._known)

    def of(self, key: str, gid: bytes) -> RawDecoder:
        """The one for a publisher; a new one where it is not known."""
        found, counted = self._known.pop((key, gid), (None, 0))
        decoder = found or RawDecoder(self._clock)
        size = decoder.held + len(key)
        self._known[key, gid] = decoder, size
        self._size += size - counted
        while self._size > MOST_DECODER_BYTES and len(self._known) > 1:
            _, (_, least) = self._known.popitem(last=False)
            self._size -= least
        return decoder
