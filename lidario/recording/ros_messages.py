"""The three ROS 2 messages that a recording holds: their definitions, and the encoding of the small ones.

`lidario.scans.cdr` tells what CDR is; `LaserScan.to_cdr` encodes scans. The tests compare it with an independent
decoder.

The definitions are in the form that rosbag2 stores (``ros2msg``): the fields of the message, then those of each
message type that it contains.
"""

import struct

from lidario.scans.cdr import LITTLE_ENDIAN

RAW_TYPE = "lidario_msgs/msg/Raw"  # one chunk of bytes as it was read from the port or written to it
TEXT_TYPE = "std_msgs/msg/String"
LASERSCAN_TYPE = "sensor_msgs/msg/LaserScan"
DEFINITIONS = {
    RAW_TYPE: """\
uint8 RECEIVED=0
uint8 SENT=1
uint8 direction
uint8[] data
""",
    TEXT_TYPE: "string data\n",
    LASERSCAN_TYPE: """\
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
""",
}

_RAW = struct.Struct("<4sB3xI")
_LENGTH = struct.Struct("<I")


def encode_raw(sent: bool, data: bytes) -> bytes:
    """A chunk as ``lidario_msgs/msg/Raw``."""
    return _RAW.pack(LITTLE_ENDIAN, sent, len(data)) + data


def parse_raw(message: bytes | memoryview) -> tuple[bool, bytes] | None:
    """Whether a chunk was sent, and its bytes; None when the message is none."""
    if len(message) < _RAW.size:
        return None
    order, direction, length = _RAW.unpack_from(message)
    end = _RAW.size + length
    if order != LITTLE_ENDIAN or direction > 1 or end > len(message):
        return None
    return direction == 1, bytes(message[_RAW.size : end])


def encode_text(text: str) -> bytes:
    """A text as ``std_msgs/msg/String``."""
    data = text.encode() + b"\0"
    return LITTLE_ENDIAN + _LENGTH.pack(len(data)) + data


def parse_text(message: bytes | memoryview) -> str | None:
    """The text of a ``std_msgs/msg/String``; None when the message is none."""
    if len(message) < 8 or bytes(message[:4]) != LITTLE_ENDIAN:
        return None
    (length,) = _LENGTH.unpack_from(message, 4)
    if not 0 < length <= len(message) - 8:
        return None
    return bytes(message[8 : 7 + length]).decode("utf-8", "replace")
