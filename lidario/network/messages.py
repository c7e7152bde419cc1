"""What is published under the key of a lidar, where no ROS is involved: whole scans, or the bytes of the device.

A *scan message* holds one `Scan` with all its fields, so that it arrives as it was sent. A *raw message* holds what
was read from the device in a while, read by read with its time, and what the session knew beside it
(`StreamEvent`), in order. That is a quarter of the size, and is decoded by the code that decodes it live.

Both come from a network. `parse_scan` and `parse_raw_message` take any bytes. A length in the data is checked
against the bytes that are there, and what has numbers that a scan cannot have is not a scan.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Iterable
from typing import Final, NamedTuple

import numpy as np

from lidario.arguments import printable
from lidario.measured import with_distances
from lidario.recording.chronicle import MOST_NS
from lidario.scan import Scan, read_only

_SCAN_MAGIC: Final = b"LDS1"
_SCAN: Final = struct.Struct("<4sBxHIqqqQIddddd")
"""Magic, what is carried (1: intensities, 2: which samples filters took out, a bit each), bytes of the mode's name,
samples, three times, number, lost packets, two speeds, range, seam, and one spare figure."""
_RAW_MAGIC: Final = b"LDR1"
_RAW: Final = struct.Struct("<4sI")
_ENTRY: Final = struct.Struct("<BxxxIq")

MOST_SAMPLES: Final = 1 << 17
"""Of one scan; several times what any device takes in a revolution."""
MOST_ENTRIES: Final = 1024
MOST_RAW_BYTES: Final = 1 << 18
"""Of a raw message; publishers send some 16 KiB."""
_LONGEST_NAME: Final = 64
_MOST_METRES: Final = 1e6
_MOST_RPM: Final = 1e6
_LONGEST_NS: Final = 10**13


class Entry(NamedTuple):
    """One part of a raw message: a line of the chronicle, or bytes of the device.

    It was read `at_ns`, on the monotonic clock of the publisher.
    """

    is_event: bool
    at_ns: int
    data: bytes


def encode_scan(scan: Scan) -> bytes:
    """A scan message. `Scan.stamp_ns` is not in it: it is a time of this machine alone."""
    name = scan.mode.encode("utf-8", "replace")[:_LONGEST_NAME]
    strengths = scan.intensities
    left_out = scan.left_out
    is_filtered = bool(left_out.any())
    head = _SCAN.pack(
        _SCAN_MAGIC,
        (strengths is not None) | is_filtered << 1,
        len(name),
        len(scan),
        scan.wall_stamp_ns,
        scan.time_increment_ns,
        scan.duration_ns,
        scan.seq,
        scan.lost_packets,
        scan.rpm,
        scan.reported_rpm,
        scan.max_range,
        scan.seam,
        0.0,
    )
    return b"".join(
        (
            head,
            name,
            scan.device_angles.astype("<f4", copy=False).tobytes(),
            scan.device_distances.astype("<f4", copy=False).tobytes(),
            b"" if strengths is None else strengths.tobytes(),
            np.packbits(left_out).tobytes() if is_filtered else b"",
        )
    )


def parse_scan(data: bytes, wall_offset_ns: int) -> Scan | None:
    """The scan that `encode_scan` wrote; None for anything else."""
    if len(data) < _SCAN.size:
        return None
    (magic, carried, named, count, wall_ns, step_ns, duration_ns, seq, lost, rpm, reported_rpm, most, seam, _) = (
        _SCAN.unpack_from(data)
    )
    begin = _SCAN.size + named
    if magic != _SCAN_MAGIC or carried > 3 or named > _LONGEST_NAME or count > MOST_SAMPLES:
        return None
    has_strengths, is_filtered = bool(carried & 1), bool(carried & 2)
    if len(data) != begin + (8 + has_strengths) * count + (count + 7) // 8 * is_filtered:
        return None
    if not (abs(wall_ns) < MOST_NS and 0 <= step_ns < _LONGEST_NS and 0 <= duration_ns < _LONGEST_NS):
        return None
    if seq > MOST_NS or not 0 <= most <= _MOST_METRES or not 0 <= seam < 360:
        return None
    if any(not (math.isnan(each) or 0 <= each <= _MOST_RPM) for each in (rpm, reported_rpm)):
        return None
    angles = np.frombuffer(data, "<f4", count, begin)
    distances = np.frombuffer(data, "<f4", count, begin + 4 * count)
    # Comparing with NaN gives False.
    if not (np.all((angles >= 0) & (angles < 360)) and np.all((distances >= 0) & (distances < 1e3 * _MOST_METRES))):
        return None
    strengths = np.frombuffer(data, np.uint8, count, begin + 8 * count) if has_strengths else None
    name = data[_SCAN.size : begin].decode("utf-8", "replace")
    made = Scan(
        device_angles=read_only(angles.astype(np.float32, copy=False)),
        device_distances=read_only(distances.astype(np.float32, copy=False)),
        intensities=strengths,
        stamp_ns=wall_ns - wall_offset_ns,
        wall_stamp_ns=wall_ns,
        time_increment_ns=step_ns,
        duration_ns=duration_ns,
        rpm=rpm,
        seq=seq,
        dropped_before=0,
        lost_packets=lost,
        mode=printable(name),
        max_range=most,
        seam=seam,
        reported_rpm=reported_rpm,
    )
    if not is_filtered:
        return made
    bits = np.frombuffer(data, np.uint8, offset=begin + (8 + has_strengths) * count)
    left_out = np.unpackbits(bits, count=count).astype(np.bool_)
    # One that was taken out has no return.
    kept = np.where(left_out, np.float32(0), made.device_distances)
    return with_distances(made, lambda _: (kept, left_out))


def encode_raw_message(entries: Iterable[Entry]) -> bytes:
    """A raw message of at most `MOST_ENTRIES` entries."""
    parts = [_ENTRY.pack(is_event, len(data), at_ns) + data for is_event, at_ns, data in entries]
    return _RAW.pack(_RAW_MAGIC, len(parts)) + b"".join(parts)


def is_raw(data: bytes) -> bool:
    """Whether it says of itself that it is a raw message."""
    return data.startswith(_RAW_MAGIC)


def parse_raw_message(data: bytes) -> list[Entry] | None:
    """What `encode_raw_message` wrote; None for anything else."""
    if not _RAW.size <= len(data) <= MOST_RAW_BYTES:
        return None
    magic, count = _RAW.unpack_from(data)
    if magic != _RAW_MAGIC or count > MOST_ENTRIES:
        return None
    entries: list[Entry] = []
    at = _RAW.size
    for _ in range(count):
        if len(data) - at < _ENTRY.size:
            return None
        is_event, size, at_ns = _ENTRY.unpack_from(data, at)
        at += _ENTRY.size
        if is_event > 1 or size > len(data) - at or abs(at_ns) >= MOST_NS:
            return None
        entries.append(Entry(is_event == 1, at_ns, data[at : at + size]))
        at += size
    return entries if at == len(data) else None
