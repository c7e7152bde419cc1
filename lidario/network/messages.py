"""What is published under the key of a lidar: whole scans, or the bytes of the device.

A *scan message* holds one `Scan` with all its fields, so that it arrives as it was sent. A *raw message* holds what
was read from the device in a while, read by read with its time, and what the session knew beside it
(`StreamEvent`), in order. That is a quarter of the size, and is decoded by the code that decodes it live.

Where anybody's node of ROS 2 publishes, a message is a LaserScan, of which `scan_of_laserscan` makes a scan.

All of it comes from a network. The functions that parse take any bytes. A length in the data is checked against the
bytes that are there, and what has numbers that a scan cannot have is not a scan.
"""

import math
import struct
from collections.abc import Iterable
from typing import Final, NamedTuple

import numpy as np

from lidario.basics.arguments import printable
from lidario.network.bus import Sample
from lidario.network.keys import LASERSCAN_IN_KEY
from lidario.recording.chronicle import MOST_NS
from lidario.scans.laserscan import LaserScan
from lidario.scans.measured import with_distances
from lidario.scans.samples import read_only
from lidario.scans.scan import Scan

_SCAN_MAGIC: Final = b"LDS1"
_SCAN: Final = struct.Struct("<4sBxHIqqqQIddddd")
"""Magic, what is carried (1: intensities, 2: which samples filters took out, a bit each), bytes of the mode's name,
samples, three times, number, lost packets, two speeds, range, seam, and one spare figure."""
_RAW_MAGIC: Final = b"LDR1"
_RAW: Final = struct.Struct("<4sI")
_ENTRY: Final = struct.Struct("<BxxxIq")

MOST_SAMPLES: Final = 1 << 17  # of one scan; several times what any device takes in a revolution
MOST_ENTRIES: Final = 1024
MOST_RAW_BYTES: Final = 1 << 18
"""Of a raw message; publishers send some 16 KiB."""
_LONGEST_NAME: Final = 64
_MOST_METRES: Final = 1e6
_MOST_RPM: Final = 1e6
_LONGEST_NS: Final = 10**13
_LONGEST_S: Final = 1e3
_WHOLE_DEG: Final = 350.0
"""A LaserScan that covers this much is taken for a whole revolution."""


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


def whole_scan(sample: Sample, wall_offset_ns: int, seq: int = 0) -> Scan | None:
    """The scan that a message holds, with the number `seq` where it tells none; None where it holds no scan."""
    if LASERSCAN_IN_KEY not in sample.key:
        return parse_scan(sample.payload, wall_offset_ns)
    laser = LaserScan.from_cdr(sample.payload)
    return None if laser is None else scan_of_laserscan(laser, seq, wall_offset_ns)


def scan_of_laserscan(laser: LaserScan, seq: int, wall_offset_ns: int) -> Scan | None:
    """The beams as samples, in the order in which the message says that they were measured.

    A beam without a valid range becomes a sample without a return. Intensities below 0 become 0, those above 255
    become 255. None where the figures cannot be those of a scan.
    """
    every_s = _seconds_of_beam(laser)
    if every_s is None:
        return None
    count, wall_ns, step_deg = len(laser.ranges), laser.stamp_ns, -math.degrees(laser.angle_increment)
    ranges, strengths = laser.ranges, laser.intensities if len(laser.intensities) == count else None
    angles = -np.degrees(laser.angle_min + laser.angle_increment * np.arange(count))
    if every_s < 0:
        ranges, angles, step_deg = ranges[::-1], angles[::-1], -step_deg
        strengths = None if strengths is None else strengths[::-1]
        wall_ns += round((count - 1) * every_s * 1e9) if count else 0
    farthest = laser.range_max if 0 < laser.range_max < _MOST_METRES else _MOST_METRES
    valid = (ranges >= laser.range_min) & (ranges <= farthest) & (ranges > 0)
    turned = (angles % 360.0).astype(np.float32)
    # Just below 360 degrees, single precision rounds up to 360.
    turned[turned >= 360.0] = 0.0
    whole = abs(step_deg) * count >= _WHOLE_DEG
    duration_ns = round(abs(every_s) * count * 1e9)
    return Scan(
        device_angles=read_only(turned),
        device_distances=read_only(np.where(valid, ranges, np.float32(0)) * np.float32(1000)),
        intensities=None
        if strengths is None
        else read_only(np.nan_to_num(strengths).clip(0, 255).astype(np.uint8)),
        stamp_ns=wall_ns - wall_offset_ns,
        wall_stamp_ns=wall_ns,
        time_increment_ns=round(abs(every_s) * 1e9),
        duration_ns=duration_ns,
        rpm=60e9 / duration_ns if whole and duration_ns else math.nan,
        seq=seq,
        dropped_before=0,
        lost_packets=0,
        mode="LaserScan",
        max_range=farthest if farthest < _MOST_METRES else 0.0,
        # The beams stand in the middle of their steps.
        seam=float((angles[0] - step_deg / 2) % 360.0) if count and step_deg > 0 and whole else 0.0,
    )


def _seconds_of_beam(laser: LaserScan) -> float | None:
    """Seconds from one beam to the next, negative where the last one was measured first.

    None where the figures cannot be those of a scan.
    """
    count = len(laser.ranges)
    figures = (laser.angle_min, laser.angle_increment, laser.time_increment, laser.scan_time)
    if count > MOST_SAMPLES or abs(laser.stamp_ns) >= MOST_NS // 2 or not all(map(math.isfinite, figures)):
        return None
    if abs(laser.angle_increment) * count > 4 * math.pi or abs(laser.angle_min) > 4 * math.pi:
        return None
    every_s = laser.time_increment
    if not every_s and 0 < laser.scan_time <= _LONGEST_S and count:
        # It says nothing of the time of a beam: the devices of most drivers turn clockwise.
        every_s = -math.copysign(laser.scan_time / count, laser.angle_increment)
    return every_s if abs(every_s) * max(count, 1) <= _LONGEST_S else None


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
