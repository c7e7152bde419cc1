"""The device's own way to put its responses and measurements into bytes; shares nothing with the host's side.

Layouts: 4ROS development manual, figures 3 to 15; the time stamp record and the samples of other models are the
vendor SDK's. Tests use `pack_points` as the inverse of the decoder.
"""

import struct
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

SCAN_HEADER = b"\xa5\x5a\x05\x00\x00\x40\x81"
TIME_STAMP_BYTES = 8
_LONGEST = 65535
_SAMPLES = {
    2: np.dtype([("word", "<u2")]),
    3: np.dtype([("light", "u1"), ("word", "<u2")]),
    4: np.dtype([("light", "<u2"), ("word", "<u2")]),
}


@dataclass(frozen=True, slots=True)
class Layout:
    """How one sample lies in its bytes (the vendor's SDK 1.2.20)."""

    size: int = 2  # bytes: 2, 3 or 4
    unit: int = 1  # parts of a millimetre that the distance word counts
    flags: bool = False  # whether its low two bits are none of the distance
    bits: int = 0  # of the intensity: 0, 8, 10 or 16


MILLIMETRES = Layout()  # what a 4ROS sends


def start_control(hertz: float, base: int = 30) -> int:
    """The CT byte of a start packet: the speed above the start bit, in tenths of Hz from `base` on."""
    return min(max(round(hertz * 10) - base, 0), 127) << 1 | 1


def pack_points(
    distances_mm: npt.ArrayLike,
    first_q6: npt.ArrayLike,
    last_q6: npt.ArrayLike,
    *,
    control: int = 0,
    layout: Layout = MILLIMETRES,
    intensities: npt.ArrayLike = 0,
) -> bytes:
    """Pack point cloud packets of equal length, back to back: distances of the shape (n,) or (packets, n).

    0 mm is no return, as is what 16 bits cannot hold. `control` is the CT byte, see `start_control`.
    """
    distances = np.rint(np.atleast_2d(np.asarray(distances_mm, dtype=np.float64)) * layout.unit)
    packets, samples = distances.shape
    rows = np.zeros(packets, [("head", "<u2", 5), ("sample", _SAMPLES[layout.size], samples)])
    head, light = rows["head"], np.zeros((packets, samples), np.uint16)
    word = np.where(distances <= _LONGEST, distances, 0.0).astype(np.uint16) & (0xFFFC if layout.flags else 0xFFFF)
    if layout.size > 2:
        light[...] = intensities
        if layout.bits == 10:
            word |= light >> 8 & 3
        light &= 0xFFFF if layout.size == 4 else 0xFF
        rows["sample"]["light"] = light
    rows["sample"]["word"] = word
    head[:, 0], head[:, 1] = 0x55AA, control | samples << 8
    head[:, 2] = np.asarray(first_q6, dtype=np.int64) * 2 + 1  # the C bit of both angles
    head[:, 3] = np.asarray(last_q6, dtype=np.int64) * 2 + 1
    head[:, 4] = np.bitwise_xor.reduce(np.concatenate((head, word, light), axis=1), axis=1)
    return rows.tobytes()


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
