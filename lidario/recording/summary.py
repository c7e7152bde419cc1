"""What a recording holds, in figures."""

import os
from dataclasses import dataclass

from lidario.families.base import Known
from lidario.model import DeviceInfo
from lidario.recording.decode_file import FileDecoder


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
