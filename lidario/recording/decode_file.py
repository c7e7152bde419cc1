"""Decoding a whole file, without a session and without an event loop.

Scans have the stamps that the live ones had. Nothing larger is held than a block of bytes and its scans.
"""

from __future__ import annotations

import logging
import os
from collections.abc import Iterator

from lidario.arguments import path_of
from lidario.families.base import Known
from lidario.filters.base import Filter
from lidario.recording.files import open_stored
from lidario.recording.offline import BLOCK, OfflineDecoder, ScanArrays, arrays_of
from lidario.recording.opened import StoredFile
from lidario.recording.raw import SEARCHED
from lidario.recording.read import StoredStreams
from lidario.revolution.assemble import AssemblerStats
from lidario.revolution.together import join_runs
from lidario.revolution.whole import assembler_of
from lidario.scan import Scan
from lidario.wire.events import Packets
from lidario.wire.link import Link

__all__ = ["FileDecoder", "decode_file", "decode_file_arrays"]

_log = logging.getLogger("lidario")

_BLOCK = 64 * 1024
"""Bytes that are decoded together, as in `lidario.recording.offline`."""


class FileDecoder:
    """Decodes a file as `decode_file` does, and counts what became of it. It is iterated over once.

    Args:
        path: The file.
        known: What the user says of bare bytes, as for `decode_file`.

    Raises:
        RecordingError: Nothing can be read of it; or, while it is iterated over, it cannot be read any more.

    Attributes:
        recording: The file.
        skipped_bytes: Bytes of the streams that belong to no packet, so far.
        packets: Intact packets, so far.
        stats: What became of them.
        filters: What each scan passes, in this order.
    """

    def __init__(self, path: str | os.PathLike[str], known: Known = Known()) -> None:  # noqa: B008
        self._known = known
        self.recording: StoredStreams = open_stored(path_of(path, "a recording"), known)
        self.skipped_bytes: int = 0
        self.packets: int = 0
        self.stats: AssemblerStats = AssemblerStats()
        self.filters: tuple[Filter, ...] = ()

    def __iter__(self) -> Iterator[Scan]:
        for scan in self._timed() if self.recording.timed else self._untimed():
            yield scan.filtered(*self.filters) if self.filters else scan

    def _untimed(self) -> Iterator[Scan]:
        with StoredFile(self.recording.path, self.recording.size) as file:
            decoder = OfflineDecoder(file.read(SEARCHED), self._known)
            self.stats = decoder.assembler_stats
            file.seek(decoder.begin)
            yield from decoder.scans_of(_blocks_of(file))
        self._count(decoder.link_stats.skipped_bytes, decoder.link_stats.packets)

    def _timed(self) -> Iterator[Scan]:
        number, link, assembler, offset_deg = -1, Link(), None, 0.0
        last: Scan | None = None
        for begun, data, arrivals, block_deg, behind in self._blocks():
            if begun != number or assembler is None:
                if assembler is not None:
                    assembler.end()
                    self._count(link.stats.skipped_bytes, link.stats.packets)
                number = begun
                stored = self.recording.streams[number]
                stream = stored.open()
                if stored.began.continues and last is not None:
                    self.stats.leave_off(last)
                link = Link()
                link.enter_stream(stream.format)
                assembler = assembler_of(stream, stored.began.baudrate, stored.began.wall_offset_ns, self.stats)
                offset_deg = stored.began.zero_offset_deg
            if block_deg != offset_deg:
                offset_deg = block_deg
                assembler.set_zero_offset(offset_deg, behind=behind)
            last_ns = arrivals.pop()[1]
            link.receive_data(data, last_ns, arrivals)
            for event in join_runs(list(link.events_received())):
                if isinstance(event, Packets):
                    for last in assembler.add(event):
                        yield last
                    if note := assembler.incoming.time.take_note():
                        _log.warning("%s: %s", self.recording.path, note)
        if assembler is not None:
            assembler.end()
            self._count(link.stats.skipped_bytes, link.stats.packets)

    def _blocks(self) -> Iterator[tuple[int, bytes, list[tuple[int, int]], float, bool]]:
        """Pieces of one stream and zero-angle offset, joined; where in the block each one ends, and its time."""
        number, size, last_ns, offset_deg, behind = -1, 0, 0, 0.0, False
        parts: list[bytes] = []
        arrivals: list[tuple[int, int]] = []
        for piece in self.recording.pieces():
            if parts and (piece.stream != number or piece.zero_offset_deg != offset_deg or size >= _BLOCK):
                yield number, b"".join(parts), arrivals, offset_deg, behind
                size, parts, arrivals = 0, [], []
            number, offset_deg, behind = piece.stream, piece.zero_offset_deg, piece.behind
            # Time never goes back, whatever a file says.
            last_ns = max(last_ns, piece.at_ns) if arrivals or size or last_ns else piece.at_ns
            parts.append(piece.data)
            size += len(piece.data)
            arrivals.append((size, last_ns))
        if parts:
            yield number, b"".join(parts), arrivals, offset_deg, behind

    def _count(self, skipped: int, packets: int) -> None:
        self.skipped_bytes += skipped
        self.packets += packets


def _blocks_of(file: StoredFile) -> Iterator[memoryview]:
    """The rest of a file; each block takes the place of the one before."""
    buffer = memoryview(bytearray(BLOCK))
    while block := file.read_into(buffer):
        yield block


def decode_file(
    path: str | os.PathLike[str],
    *,
    family: str | None = None,
    model: str | None = None,
    sample_us: float | None = None,
) -> Iterator[Scan]:
    """Decode a recording, one revolution after the other: MCAP as `Lidar.record` writes it, or bare bytes.

    It needs no event loop, and its arguments and the scans can be pickled, so it can run on other processes. A file
    that was cut gives all that is in it.

    Args:
        path: The file.
        family: Of bare bytes, the short name of the family; None to tell it from the bytes.
        model: Of bare bytes, the model; None to tell it from the bytes. Where they leave a choice, it is a guess,
            which is logged.
        sample_us: Of bare bytes, microseconds a sample; None for what they tell, or the model usually takes.

    Raises:
        RecordingError: Nothing can be read of it; or, while it is iterated over, it cannot be read any more.
        InvalidValue: `path` cannot be the name of a file, or `sample_us` is no number that can be right.
        ConnectFailed: There is no such family or model (reason ``source``).
    """
    return iter(FileDecoder(path, Known(family, model, sample_us)))


def decode_file_arrays(
    path: str | os.PathLike[str],
    *,
    family: str | None = None,
    model: str | None = None,
    sample_us: float | None = None,
) -> ScanArrays:
    """As `decode_file`, all scans at once as a few arrays; the arguments and errors are the same."""
    return arrays_of(FileDecoder(path, Known(family, model, sample_us)))
