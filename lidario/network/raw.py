"""Scans from the raw messages of one publisher, as they come: the same parser and decoders as live, no session.

The bytes alone do not tell whose packets they are. That stands in the status, which each publisher sends once a
second, and in the messages themselves where a stream begins or ends. Until it is known, bytes are left out.
"""

from __future__ import annotations

from lidario.families.base import Family
from lidario.families.registry import FAMILIES
from lidario.network.messages import parse_raw_message
from lidario.network.status import Status
from lidario.recording.chronicle import MOST_NS, StreamBegan, StreamEnded, event_of
from lidario.recording.read import StoredStream
from lidario.revolution.assemble import Assembler, AssemblerStats
from lidario.scan import Scan
from lidario.wire.events import Packets
from lidario.wire.link import Link

__all__ = ["RawDecoder", "time_here"]


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
        self._assembler: Assembler | None = None
        self._last_ns = -(1 << 63)

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
        entries = parse_raw_message(message)
        if entries is None:
            return None
        scans: list[Scan] = []
        for entry in entries:
            if not entry.is_event:
                scans += self._decode(entry.data, entry.at_ns)
                continue
            event = event_of(entry.data.decode("utf-8", "replace"))
            if isinstance(event, StreamBegan):
                self._begin(event)
            elif isinstance(event, StreamEnded):
                self._end()
        return scans

    def _decode(self, data: bytes, at_ns: int) -> list[Scan]:
        began, assembler = self._began, self._assembler
        if began is None or assembler is None:
            return []
        here_ns = time_here(at_ns, began, self._wall_offset_ns)
        if here_ns is None:
            return []
        # Time never goes back, whatever a message says.
        self._last_ns = max(self._last_ns, here_ns)
        self._link.receive_data(data, self._last_ns)
        return [
            scan
            for event in self._link.events_received()
            if isinstance(event, Packets)
            for scan in assembler.add(event)
        ]

    def _begin(self, began: StreamBegan) -> None:
        if began == self._began:
            return
        self._end()
        if self._family is None or self._family.stream_of(began.mode.response_type) is None:
            return
        stream = StoredStream(self._family, began).open()
        self._began = began
        self._link = Link()
        self._link.enter_stream(stream.format)
        self._assembler = Assembler(stream, began.baudrate, self._wall_offset_ns, self.stats)
        self._last_ns = -(1 << 63)

    def _end(self) -> None:
        if self._assembler is not None:
            self._assembler.end()
        self._began = self._assembler = None
