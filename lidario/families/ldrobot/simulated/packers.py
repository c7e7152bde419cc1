"""The device's own way to put measurements into bytes; shares nothing with the host's side.

Layout: LD06 development manual v1.0; records and responses: the vendor's SDKs. Tests use `pack_points` as the
inverse of the decoder.
"""

from __future__ import annotations

import struct

import numpy as np
import numpy.typing as npt

_POLYNOMIAL = 0x4D
_LONGEST = 65535
_POINT = np.dtype([("mm", "<u2"), ("intensity", "u1")])
_PACKET = np.dtype(
    [
        ("mark", "u1", 2), ("speed", "<u2"), ("first", "<u2"), ("points", _POINT, 12), ("last", "<u2"),
        ("time", "<u2"), ("check", "u1"),
    ]
)  # fmt: skip


def _of_bytes() -> npt.NDArray[np.uint8]:
    """The CRC of each byte, made for all of them bit by bit."""
    value = np.arange(256)
    for _ in range(8):
        value = np.where(value & 0x80, value << 1 ^ _POLYNOMIAL, value << 1) & 0xFF
    return value.astype(np.uint8)


_OF_BYTES = _of_bytes()


def check_of(data: npt.NDArray[np.uint8]) -> npt.NDArray[np.uint8]:
    """CRC-8 of each row; shape (packets, bytes) to (packets,)."""
    value = np.zeros(len(data), np.uint8)
    for column in data.T:
        value = _OF_BYTES[value ^ column]
    return value


def pack_points(
    distances_mm: npt.ArrayLike,
    intensities: npt.ArrayLike,
    first: npt.ArrayLike,
    last: npt.ArrayLike,
    *,
    speed: npt.ArrayLike = 3600,
    milliseconds: npt.ArrayLike = 0,
) -> bytes:
    """Pack measurement packets, back to back: distances and intensities of the shape (12,) or (packets, 12).

    Angles are 1/100 degrees, the speed degrees a second. 0 mm is no return, as is what 16 bits cannot hold.
    """
    distances = np.atleast_2d(np.rint(np.asarray(distances_mm, np.float64)))
    packets = np.empty(len(distances), _PACKET)
    packets["mark"] = 0x54, 0x2C
    packets["points"]["mm"] = np.where(distances <= _LONGEST, distances, 0)
    packets["points"]["intensity"] = np.asarray(intensities, np.uint8)
    packets["first"], packets["last"], packets["speed"], packets["time"] = first, last, speed, milliseconds
    packets["check"] = check_of(packets.view(np.uint8).reshape(len(packets), -1)[:, :-1])
    return packets.tobytes()


def pack_response(command: int, payload: bytes = bytes(4)) -> bytes:
    """What the LD14P sends after a request; the contents are documented nowhere."""
    body = struct.pack("<BBB", 0x54, command, len(payload)) + payload
    return body + bytes(check_of(np.frombuffer(body, np.uint8)[None]))
