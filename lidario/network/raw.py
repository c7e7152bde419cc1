"""Scans from the raw messages of one publisher, as they come: the same parser and decoders as live, no session.

The bytes alone do not tell whose packets they are. That stands in the status, which each publisher sends once a
second, and in the messages themselves where a stream begins or ends. Until it is known, bytes are left out.
"""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Iterator, Sequence
from typing import Final

from lidario.families.base import Family
from lidario.families.registry import FAMILIES
from lidario.families.stream import Stream
from lidario.network.messages import Entry, parse_raw_message
from lidario.network.status import Status
from lidario.recording.chronicle import MOST_NS, StreamBegan, StreamEnded, event_of
from lidario.recording.read import StoredStream
from lidario.revolution.assemble import Assembler, AssemblerStats
from lidario.revolution.partial import parts_of
from lidario.revolution.together import join_runs, slices
from lidario.revolution.whole import assembler_of
from lidario.scan import Scan
from lidario.wire.events import Packets
from lidario.wire.link import Link

__all__ = ["Decoders", "RawDecoder", "joined", "time_here"]

MOST_DECODER_BYTES: Final = 32 << 20
"""Of all decoders of a fleet: those of a thousand lidars."""
DECODER_BYTES: Final = 12288
PACKET_BYTES: Final = 128
"""What a packet takes at most beside its bytes, about: when it came."""


def time_here(at_ns: int, began: StreamBegan, wall_offset_ns: int) -> int | None:
    """From the clock of the publisher of a stream to ours; both agree about the wall clock, as far as machines do.

    Args:
        at_ns: A time of the publisher.
        began: Its stream.
        wall_offset_ns: Wall clock minus monotonic clock of this machine.

    Returns:
        None for a time that cannot be: the sums of a scan's times would not fit in 64 bits.
    """
    here_ns = at_ns + began.wall_offset_ns - wall_offset_ns
    return here_ns if abs(here_ns) < MOST_NS else None


def joined(
    reads: Sequence[tuple[bytes, int]], earliest_ns: int = -(1 << 63)
) -> tuple[bytes, int, list[tuple[int, int]]]:
    """Reads and their times as one piece, as `Receiver.data_received` takes it; at least one.

    Args:
        reads: The bytes, and when they were read. Time never goes back, whatever a message says.
        earliest_ns: When what came before was read.
    """
    arrivals: list[tuple[int, int]] = []
    size = 0
    for data, at_ns in reads:
        size += len(data)
        earliest_ns = max(earliest_ns, at_ns)
        if arrivals and arrivals[-1][1] == earliest_ns:
            arrivals.pop()
        arrivals.append((size, earliest_ns))
    arrivals.pop()
    return b"".join([data for data, _ in reads]), earliest_ns, arrivals


class RawDecoder:
    """Decodes what one publisher sends.

    Args:
        wall_offset_ns: Wall clock minus monotonic clock of this machine.

    Attributes:
        stats: What became of the packets.
    """

    def __init__(self, wall_offset_ns: int) -> None:
        self.stats: AssemblerStats = AssemblerStats()
        self._wall_offset_ns = wall_offset_ns
        self._family: Family | None = None
        self._began: StreamBegan | None = None
        self._link = Link()
        self._stream: Stream | None = None
        self._assembler: Assembler | None = None
        self._last_ns = -(1 << 63)

    @property
    def held(self) -> int:
        """Bytes that it takes, about: what it is itself, and the packets of the revolution in the making."""
        longest = 0 if self._stream is None else self._stream.format.longest
        return DECODER_BYTES + self.stats.unfinished_packets * (longest + PACKET_BYTES)

    def learn(self, status: Status) -> None:
        """Take what the publisher tells of its lidar, and of the stream that runs."""
        name = status.about.info.family
        if self._family is None or self._family.name != name:
            self._end()
            self._family = next((each for each in FAMILIES if each.name == name), None)
        running = next((event for event in status.about.events if isinstance(event, StreamBegan)), None)
        if running is None:
            self._end()
        else:
            self._begin(running)

    def add(self, message: bytes) -> list[Scan] | None:
        """Take a message; return the scans that it completes, usually one or none. None where it is no message."""
        taken = self.steps(message)
        return None if taken is None else [scan for scans in taken for scan in scans]

    def steps(self, message: bytes) -> Iterator[list[Scan]] | None:
        """As `add`, in steps of bounded work."""
        entries = parse_raw_message(message)
        return None if entries is None else self._decode(entries)

    def _decode(self, entries: Sequence[Entry]) -> Iterator[list[Scan]]:
        reads: list[tuple[bytes, int]] = []
        for entry in entries:
            if entry.is_event:
                yield from self._receive(reads)
                reads = []
                event = event_of(entry.data.decode("utf-8", "replace"))
                if isinstance(event, StreamBegan):
                    self._begin(event)
                elif isinstance(event, StreamEnded):
                    self._end()
                yield []
            elif self._began is not None:
                here_ns = time_here(entry.at_ns, self._began, self._wall_offset_ns)
                if here_ns is not None:
                    reads.append((entry.data, here_ns))
        yield from self._receive(reads)

    def _receive(self, reads: Sequence[tuple[bytes, int]]) -> Iterator[list[Scan]]:
        """Parse and decode what was read at those times."""
        stream, assembler, runs = self._stream, self._assembler, list[Packets]()
        if assembler is None or stream is None or not reads:
            return
        wire, sample_ns = stream.format, stream.sample_ns
        data, now, arrivals = joined(reads, self._last_ns)
        self._last_ns = now
        for piece in slices(data, now, arrivals):
            self._link.receive_data(*piece)
            runs += [event for event in self._link.events_received() if isinstance(event, Packets)]
            yield []
        for event in join_runs(runs):
            if isinstance(event, Packets):
                for part in parts_of(event, wire, sample_ns):
                    yield from assembler.ends(part)

    def _begin(self, began: StreamBegan) -> None:
        if began == self._began:
            return
        self._end()
        if self._family is None or self._family.stream_in(began.mode) is None:
            return
        stream = self._stream = StoredStream(self._family, began).open()
        self._began = began
        self._link = Link()
        self._link.enter_stream(stream.format)
        self._assembler = assembler_of(stream, began.baudrate, self._wall_offset_ns, self.stats)
        self._last_ns = -(1 << 63)

    def _end(self) -> None:
        if self._assembler is not None:
            self._assembler.end()
        self._began = self._assembler = None


class Decoders:
    """The decoders of a fleet; those not heard for longest are forgotten where all take too much.

    Args:
        wall_offset_ns: Wall clock minus monotonic clock of this machine.
    """

    def __init__(self, wall_offset_ns: int) -> None:
        self._wall_offset_ns = wall_offset_ns
        self._known: OrderedDict[tuple[str, bytes], tuple[RawDecoder, int]] = OrderedDict()
        self._size = 0

    def __len__(self) -> int:
        return len(self._known)

    def of(self, key: str, gid: bytes) -> RawDecoder:
        """The one for a publisher; a new one where it is not known."""
        found, counted = self._known.pop((key, gid), (None, 0))
        decoder = found or RawDecoder(self._wall_offset_ns)
        size = decoder.held + len(key)
        self._known[key, gid] = decoder, size
        self._size += size - counted
        while self._size > MOST_DECODER_BYTES and len(self._known) > 1:
            _, (_, least) = self._known.popitem(last=False)
            self._size -= least
        return decoder
