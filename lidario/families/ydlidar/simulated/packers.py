"""The device's own way to put its responses and measurements into bytes; shares nothing with the host's side.

Layouts: 4ROS development manual, figures 3 to 15; the time stamp record and the samples of other models are the
vendor SDK's. Tests use `pack_points` as the inverse of the decoder.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

SCAN_HEADER = b"\xa5\x5a\x05\x00\x00\x40\x81"
TIME_STAMP_BYTES = 8
_LONGEST = 65535


@dataclass(frozen=True, slots=True)
class Layout:
    """How one sample lies in its bytes (the vendor's SDK 1.2.20).

    Attributes:
        size: Bytes: 2, 3 or 4.
        unit: Parts of a millimetre that the distance word counts.
        flags: Whether its low two bits are none of the distance.
        bits: Of the intensity: 0, 8, 10 or 16.
    """

    size: int = 2
    unit: int = 1
    flags: bool = False
    bits: int = 0


MILLIMETRES = Layout()
"""What a 4ROS sends."""


def start_control(hertz: float, base: int = 30) -> int:
    """The CT byte of a start packet: the speed above the start bit, in tenths of Hz from `base` on."""
    return min(max(round(hertz * 10) - base, 0), 127) << 1 | 1


def pack_points(
    distances_mm: npt.ArrayLike,
    first_q6: npt.ArrayLike,
    last_q6: npt.ArrayLike,
    *,
    control: int = 0,
    marked: bool = True,
    layout: Layout = MILLIMETRES,
    intensities: npt.ArrayLike = 0,
) -> bytes:
    """Pack point cloud packets of equal length.

    Args:
        distances_mm: (n,) for one packet or (packets, n); 0 = no return, as is what 16 bits cannot hold.
        first_q6: Angle of the first sample in 1/64 degrees, a number or (packets,).
        last_q6: Angle of the last sample, likewise.
        control: The CT byte; see `start_control`.
        marked: Whether the C bit of both angles is 1, as it should be.
        layout: How a sample lies in its bytes.
        intensities: As the distances, or one number for all; for layouts that carry them.

    Returns:
        The packets, back to back.
    """
    exact = np.atleast_2d(np.asarray(distances_mm, dtype=np.float64))
    distances = np.rint(exact * layout.unit)
    packets, samples = distances.shape
    words = np.empty((packets, 5 + samples), dtype="<u2")
    words[:, 0] = 0x55AA
    words[:, 1] = control | samples << 8
    words[:, 2] = np.asarray(first_q6, dtype=np.int64) * 2 + marked
    words[:, 3] = np.asarray(last_q6, dtype=np.int64) * 2 + marked
    words[:, 4] = 0
    words[:, 5:] = np.where(distances <= _LONGEST, distances, 0.0)
    if layout.size == 2:
        words[:, 5:] &= 0xFFFC if layout.flags else 0xFFFF
        words[:, 4] = np.bitwise_xor.reduce(words, axis=1)
        return words.tobytes()
    lights = np.broadcast_to(np.asarray(intensities, np.uint16), (packets, samples))
    if layout.flags:
        words[:, 5:] &= 0xFFFC
    if layout.bits == 10:
        words[:, 5:] |= lights >> 8 & 3
    first = lights if layout.size == 4 else lights & 0xFF
    words[:, 4] = np.bitwise_xor.reduce(words, axis=1) ^ np.bitwise_xor.reduce(first, axis=1)
    return b"".join(_interleaved(row, light, layout.size) for row, light in zip(words, first, strict=True))


def _interleaved(words: npt.NDArray[np.uint16], lights: npt.NDArray[np.uint16], size: int) -> bytes:
    """One packet whose samples have an intensity of one or two bytes before the distance."""
    body = np.empty((len(lights), size), np.uint8)
    body[:, : size - 2] = lights.astype("<u2")[:, None].view(np.uint8)[:, : size - 2]
    body[:, size - 2 :] = words[5:, None].view(np.uint8)
    return words[:5].tobytes() + body.tobytes()


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
