"""Decoding a whole file, without a session and without an event loop: its scans, or what it holds in figures.

Scans have the stamps that the live ones had. Nothing larger is held than a block of bytes and its scans.
"""

import logging
import os
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import groupby

from lidario.basics.arguments import path_of
from lidario.basics.model import DeviceInfo
from lidario.families.base import Known
from lidario.filters.base import Filter
from lidario.recording.files import open_stored
from lidario.recording.offline import BLOCK, ScanArrays, UntimedScans, arrays_of
from lidario.recording.opened import StoredFile
from lidario.recording.read import Piece, StoredStreams
from lidario.revolution.assemble import AssemblerStats
from lidario.revolution.pipeline import Pipeline
from lidario.revolution.together import join_reads
from lidario.scans.scan import Scan
from lidario.wire.events import EARLIEST_NS
from lidario.wire.stats import LinkStats

_log = logging.getLogger("lidario")

_BLOCK = 64 * 1024  # bytes that are decoded together
BLOCK_NS = 4_000_000_000  # time of a block at most: of slow lidars, so many bytes are a minute


class FileDecoder:
    """Decodes a file as `decode_file` does, and counts what became of it. It is iterated over once.

    Each scan passes the `filters`, in this order.

    Raises:
        RecordingError: Nothing can be read of it; or, while it is iterated over, it cannot be read any more.
    """

    def __init__(self, path: str | os.PathLike[str], known: Known = Known()) -> None:  # noqa: B008
        self.recording: StoredStreams = open_stored(path_of(path, "a recording"), known)
        self.skipped_bytes: int = 0
        self.packets: int = 0
        self.stats: AssemblerStats = AssemblerStats()
        self.filters: tuple[Filter, ...] = ()

    def __iter__(self) -> Iterator[Scan]:
        for scan in self._timed() if self.recording.timed else self._untimed():
            yield scan.filtered(*self.filters)

    def _untimed(self) -> Iterator[Scan]:
        stored = self.recording.streams[0]
        decoder = UntimedScans(stored.open())
        self.stats = decoder.pipeline.stats
        with StoredFile(self.recording.path, self.recording.size, self.recording.folder) as file:
            file.seek(stored.began.at)
            yield from decoder.scans_of(iter(lambda: file.read(BLOCK), b""))
        self._count(decoder.pipeline.link.stats)

    def _timed(self) -> Iterator[Scan]:
        number, offset_deg = -1, 0.0
        pipeline: Pipeline | None = None
        last: Scan | None = None
        last_ns = EARLIEST_NS
        for _, block in groupby(self.recording.pieces(), _block_of):
            pieces = list(block)
            begun, _, _, block_deg, behind, _ = pieces[-1]
            if begun != number or pipeline is None:
                for last in self._end(pipeline):
                    yield last
                number = begun
                stored = self.recording.streams[number]
                began = stored.began
                if began.continues and last is not None:
                    self.stats.leave_off(last)
                pipeline = Pipeline(stored.open(), began.baudrate, began.wall_offset_ns, self.stats)
                offset_deg = began.zero_offset_deg
            if block_deg != offset_deg:
                offset_deg = block_deg
                pipeline.assembler.set_zero_offset(offset_deg, behind=behind)
            data, last_ns, arrivals = join_reads([(piece.data, piece.at_ns) for piece in pieces], last_ns)
            for last in pipeline.receive(data, last_ns, arrivals):
                yield last
            if note := pipeline.take_note():
                _log.warning("%s: %s", self.recording.path, note)
        yield from self._end(pipeline)

    def _end(self, pipeline: Pipeline | None) -> list[Scan]:
        if pipeline is None:
            return []
        self._count(pipeline.link.stats)
        return pipeline.assembler.end()

    def _count(self, found: LinkStats) -> None:
        self.skipped_bytes += found.skipped_bytes
        self.packets += found.packets


def _block_of(piece: Piece) -> tuple[int, float, int, int]:
    """Alike for reads of one stream and zero-angle offset that are decoded together."""
    return piece.stream, piece.zero_offset_deg, piece.place // _BLOCK, piece.at_ns // BLOCK_NS


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


@dataclass(frozen=True, slots=True)
class RecordingSummary:
    """What a recording holds.

    Attributes:
        path: The file.
        size: Its bytes.
        timed: Whether it is known when each byte was read; bare bytes have no times.
        damage: What of it is missing or was changed, as far as that can be told; empty where nothing is.
        info: The device.
        source: What was opened when it was recorded; empty where that is not known.
        lidario: Version that wrote it; empty where that is not known.
        modes: Names of the scan modes that were recorded.
        streams: How often a stream was started.
        began_ns: Time of the first sample of the first scan, nanoseconds since the Unix epoch; 0 where not known.
        duration_s: Seconds from the first sample of the first scan to the end of the last one.
        scans: Full revolutions.
        samples: Their samples.
        returns: Those with a return.
        packets: Intact packets.
        lost_packets: Packets that were damaged or lost.
        skipped_bytes: Bytes that belong to no packet.
        missed_scans: Revolutions that are missing between the scans.
        losses: Times the line to the lidar was lost, and the recording went on when it was back.
        away_s: Seconds that it was away, all together.
    """

    path: str
    size: int
    timed: bool
    damage: str
    info: DeviceInfo
    source: str
    lidario: str
    modes: tuple[str, ...]
    streams: int
    began_ns: int
    duration_s: float
    scans: int
    samples: int
    returns: int
    packets: int
    lost_packets: int
    skipped_bytes: int
    missed_scans: int
    losses: int
    away_s: float


def summarize(
    path: str | os.PathLike[str],
    *,
    family: str | None = None,
    model: str | None = None,
    sample_us: float | None = None,
) -> RecordingSummary:
    """Decode a whole recording and count; the arguments and errors are those of `decode_file`."""
    decoder = FileDecoder(path, Known(family, model, sample_us))
    recording = decoder.recording
    scans = samples = returns = 0
    first = last = None
    for scan in decoder:
        first = scan if first is None else first
        last = scan
        scans += 1
        samples += len(scan)
        returns += int(scan.valid.sum())
    duration_ns = 0 if first is None or last is None else last.stamp_ns + last.duration_ns - first.stamp_ns
    return RecordingSummary(
        path=str(recording.path),
        size=recording.size,
        timed=recording.timed,
        damage=recording.damage,
        info=recording.about.info,
        source=recording.about.source if recording.timed else "",
        lidario=recording.about.lidario,
        modes=tuple(dict.fromkeys(stream.began.mode.name for stream in recording.streams)),
        streams=len(recording.streams),
        began_ns=first.wall_stamp_ns if first is not None and recording.timed else 0,
        duration_s=duration_ns * 1e-9,
        scans=scans,
        samples=samples,
        returns=returns,
        packets=decoder.packets,
        lost_packets=decoder.stats.lost_packets,
        skipped_bytes=decoder.skipped_bytes,
        missed_scans=decoder.stats.missed_scans,
        losses=len(recording.away_ns),
        away_s=sum(recording.away_ns) * 1e-9,
    )
