"""The three ROS 2 messages that a recording holds: their definitions, and their CDR encoding.

CDR is the binary form of ROS 2 messages: four bytes that name the byte order, then the fields in order, each
aligned to its own size, counted from behind those four bytes. It is written by hand because a general encoder takes
hundreds of times as long. The tests compare it with an independent decoder.

The definitions are in the form that rosbag2 stores (``ros2msg``): the fields of the message, then those of each
message type that it contains.
"""

from __future__ import annotations

import struct

import numpy as np

from lidario.laserscan import LaserScan

__all__ = [
    "LASERSCAN_DEFINITION",
    "LASERSCAN_TYPE",
    "RAW_DEFINITION",
    "RAW_TYPE",
    "TEXT_DEFINITION",
    "TEXT_TYPE",
    "encode_laserscan",
    "encode_raw",
    "encode_text",
    "parse_raw",
    "parse_text",
]

RAW_TYPE = "lidario_msgs/msg/Raw"
RAW_DEFINITION = """\
uint8 RECEIVED=0
uint8 SENT=1
uint8 direction
uint8[] data
"""
"""One chunk of bytes as it was read from the port or written to it."""

TEXT_TYPE = "std_msgs/msg/String"
TEXT_DEFINITION = "string data\n"

LASERSCAN_TYPE = "sensor_msgs/msg/LaserScan"
LASERSCAN_DEFINITION = """\
std_msgs/Header header
float32 angle_min
float32 angle_max
float32 angle_increment
float32 time_increment
float32 scan_time
float32 range_min
float32 range_max
float32[] ranges
float32[] intensities
================================================================================
MSG: std_msgs/Header
builtin_interfaces/Time stamp
string frame_id
================================================================================
MSG: builtin_interfaces/Time
int32 sec
uint32 nanosec
"""

_LITTLE_ENDIAN = b"\0\1\0\0"
_RAW = struct.Struct("<4sB3xI")
_LENGTH = struct.Struct("<I")
_TIME_AND_LENGTH = struct.Struct("<iII")
_SEVEN = struct.Struct("<7f")
_SECOND = 1_000_000_000
_MOST_SECONDS = (1 << 31) - 1


def encode_raw(sent: bool, data: bytes) -> bytes:
    """A chunk as ``lidario_msgs/msg/Raw``."""
    return _RAW.pack(_LITTLE_ENDIAN, sent, len(data)) + data


def parse_raw(message: bytes | memoryview) -> tuple[bool, bytes] | None:
    """Whether a chunk was sent, and its bytes; None when the message is none."""
    if len(message) < _RAW.size:
        return None
    order, direction, length = _RAW.unpack_from(message)
    if order != _LITTLE_ENDIAN or direction > 1 or length > len(message) - _RAW.size:
        return None
    return direction == 1, bytes(message[_RAW.size : _RAW.size + length])


def encode_text(text: str) -> bytes:
    """A text as ``std_msgs/msg/String``."""
    data = text.encode() + b"\0"
    return _LITTLE_ENDIAN + _LENGTH.pack(len(data)) + data


def parse_text(message: bytes | memoryview) -> str | None:
    """The text of a ``std_msgs/msg/String``; None when the message is none."""
    if len(message) < 8 or bytes(message[:4]) != _LITTLE_ENDIAN:
        return None
    (length,) = _LENGTH.unpack_from(message, 4)
    if not 0 < length <= len(message) - 8:
        return None
    return bytes(message[8 : 7 + length]).decode("utf-8", "replace")


def encode_laserscan(scan: LaserScan) -> bytes:
    """A scan as ``sensor_msgs/msg/LaserScan``. A stamp after 2038 does not fit in the message."""
    seconds, nanoseconds = divmod(scan.stamp_ns, _SECOND)
    seconds = min(max(seconds, -_MOST_SECONDS), _MOST_SECONDS)
    frame = scan.frame_id.encode() + b"\0"
    head = _TIME_AND_LENGTH.pack(seconds, nanoseconds, len(frame)) + frame
    return b"".join(
        (
            _LITTLE_ENDIAN,
            head,
            bytes(-len(head) % 4),
            _SEVEN.pack(
                scan.angle_min,
                scan.angle_max,
                scan.angle_increment,
                scan.time_increment,
                scan.scan_time,
                scan.range_min,
                scan.range_max,
            ),
            _LENGTH.pack(len(scan.ranges)),
            scan.ranges.astype(np.dtype("<f4"), copy=False).tobytes(),
            _LENGTH.pack(len(scan.intensities)),
            scan.intensities.astype(np.dtype("<f4"), copy=False).tobytes(),
        )
    )
