"""The device's own way to put its responses and measurements into bytes; shares nothing with the host's side.

Layouts: 4ROS development manual, figures 3 to 15; the time stamp record is the vendor SDK's. Tests use
`pack_points` as the inverse of the decoder.
"""

from __future__ import annotations

import struct

import numpy as np
import numpy.typing as npt

__all__ = ["SCAN_HEADER", "TIME_STAMP_BYTES", "pack_points", "pack_response", "pack_time_stamp", "start_control"]

SCAN_HEADER = b"\xa5\x5a\x05\x00\x00\x40\x81"
TIME_STAMP_BYTES = 8
_LONGEST = 65535


def start_control(hertz: float) -> int:
    """The CT byte of a start packet: the speed, 3.0 to 15.7 Hz, above the start bit."""
    return min(max(round(hertz * 10) - 30, 0), 127) << 1 | 1


def pack_points(
    distances_mm: npt.ArrayLike,
    first_q6: npt.ArrayLike,
    last_q6: npt.ArrayLike,
    *,
    control: int = 0,
    marked: bool = True,
) -> bytes:
    """Pack point cloud packets of equal length.

    Args:
        distances_mm: (n,) for one packet or (packets, n); 0 = no return, as is what 16 bits cannot hold.
        first_q6: Angle of the first sample in 1/64 degrees, a number or (packets,).
        last_q6: Angle of the last sample, likewise.
        control: The CT byte; see `start_control`.
        marked: Whether the C bit of both angles is 1, as it should be.

    Returns:
        The packets, back to back.
    """
    distances = np.atleast_2d(np.rint(np.asarray(distances_mm, dtype=np.float64)))
    packets, samples = distances.shape
    words = np.empty((packets, 5 + samples), dtype="<u2")
    words[:, 0] = 0x55AA
    words[:, 1] = control | samples << 8
    words[:, 2] = np.asarray(first_q6, dtype=np.int64) * 2 + marked
    words[:, 3] = np.asarray(last_q6, dtype=np.int64) * 2 + marked
    words[:, 4] = 0
    words[:, 5:] = np.where(distances <= _LONGEST, distances, 0.0)
    words[:, 4] = np.bitwise_xor.reduce(words, axis=1)
    return words.tobytes()


def pack_time_stamp(milliseconds: int, last: int = 0) -> bytes:
    """The time stamp record that may stand between packets on some models."""
    body = struct.pack("<IB", milliseconds, last)
    check = 0xAA ^ 0x66
    for byte in body:
        check ^= byte
    return bytes((0xAA, 0x66, check)) + body


def pack_response(kind: int, payload: bytes) -> bytes:
    """A single response: ``A5 5A``, the length, the response type, the payload."""
    return struct.pack("<BBIB", 0xA5, 0x5A, len(payload), kind) + payload
