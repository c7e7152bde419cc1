"""Makes scans of the bytes of one stream: parses, joins, dates and assembles.

Sessions, files and the messages of other machines use the same `Pipeline`. They differ in who holds the parser and
in how much is done at once. A session parses for itself, since its line also carries responses.
"""

from collections.abc import Iterator, Sequence
from typing import TypeAlias

from lidario.families.base import Stream
from lidario.revolution.incoming import Clock
from lidario.revolution.partial import MOST_IN_A_PART, parts_of
from lidario.revolution.sectors import SectorAssembler
from lidario.revolution.stats import AssemblerStats
from lidario.revolution.together import joined, slices
from lidario.revolution.whole import assembler_of
from lidario.scans.scan import Scan
from lidario.wire.events import Arrival, Packets
from lidario.wire.link import Link

RawBytes: TypeAlias = bytes | bytearray | memoryview


class Pipeline:
    """Makes scans of the bytes of one stream.

    Args:
        stream: The stream, as its family described it.
        baudrate: Speed of the line in bits a second; 0 when bytes take no time.
        wall_offset_ns: Wall clock minus monotonic clock.
        stats: Counters to add to; fresh ones by default.
        link: The parser; by default one that expects packets at once, without a descriptor.
        clock: Dates packets that were stored without times, as for `Incoming`.
    """

    def __init__(
        self,
        stream: Stream,
        baudrate: int = 0,
        wall_offset_ns: int = 0,
        stats: AssemblerStats | None = None,
        *,
        link: Link | None = None,
        clock: Clock | None = None,
    ) -> None:
        self.stream: Stream = stream
        self.link: Link = link or Link()  # the parser
        if link is None:
            self.link.enter_stream(stream.format)
        # Builds the scans, and their sectors.
        self.assembler: SectorAssembler = assembler_of(stream, baudrate, wall_offset_ns, stats, clock)
        self._is_stored = clock is not None

    @property
    def stats(self) -> AssemblerStats:
        """The counters of the assembler: what became of the packets."""
        return self.assembler.stats

    def receive(self, data: RawBytes, now: int = 0, arrivals: Sequence[Arrival] = ()) -> list[Scan]:
        """Take bytes, all at once; return the scans that they complete. The arguments are those of `Link`."""
        runs = self._parse(data, now, arrivals)
        # Stored packets are dated by counting samples from one place where bytes were skipped to the next.
        runs = [joined(runs)] if runs and not self._is_stored else runs
        return [scan for packets in runs for scan in self.assembler.add(packets)]

    def steps(self, data: bytes, now: int, arrivals: Sequence[Arrival] = ()) -> Iterator[list[Scan]]:
        """As `receive`, in steps of bounded work: between two steps, other tasks may run."""
        runs: list[Packets] = []
        for piece in slices(data, now, arrivals):
            runs += self._parse(*piece)
            yield []
        if runs:
            yield from self.take(joined(runs))

    def take(self, packets: Packets) -> Iterator[list[Scan]]:
        """Take packets that were parsed elsewhere, in steps of bounded work.

        Packets that are left when it is closed, or when the stream is ended meanwhile, are counted as discarded.
        """
        if packets.count <= MOST_IN_A_PART:
            return self.assembler.ends(packets)
        return self._take_parts(packets)

    def _take_parts(self, packets: Packets) -> Iterator[list[Scan]]:
        assembler, ended = self.assembler, self.assembler.ended
        parts = parts_of(packets, self.stream.format, self.stream.sample_ns)
        try:
            for part in parts:
                yield from assembler.ends(part)
                # A step also for a part that ended no revolution.
                yield []
                if assembler.ended != ended:
                    return
        finally:
            assembler.stats.discarded_packets += sum(part.count for part in parts)

    def take_note(self) -> str:
        """A sentence for the log about the time of a sample, given once; mostly empty."""
        return self.assembler.incoming.time.take_note()

    def _parse(self, data: RawBytes, now: int, arrivals: Sequence[Arrival]) -> list[Packets]:
        self.link.receive_data(data, now, arrivals)
        return [event for event in self.link.events_received() if isinstance(event, Packets)]
