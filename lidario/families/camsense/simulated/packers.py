"""The device's own way to put measurements into bytes; shares nothing with the host's side.

As Camsense's SDK reads it: a mark, how the samples lie, their number, speed and first angle, samples, last angle,
check value.
"""

from __future__ import annotations

from collections.abc import Sequence

_NOTHING = 0x8000
_KINDS = {8: (3, 1), 12: (7, 2)}
"""By the number of samples: how they are told to lie, and the bytes of a quality."""


def pack_packet(
    start: int, end: int, millimetres: Sequence[float], qualities: Sequence[int], *, rpm: float = 312.0
) -> bytes:
    """Pack one measurement packet.

    Args:
        start: Angle of the first sample as it is sent: A000 hexadecimal and 64ths of a degree.
        end: That of the last one.
        millimetres: 8 or 12 of them; 0 = no return, as is what 14 bits cannot hold.
        qualities: As many.
        rpm: Speed of the rotor.
    """
    kind, width = _KINDS[len(millimetres)]
    body = bytes((0x55, 0xAA, kind, len(millimetres)))
    body += round(rpm * 64).to_bytes(2, "little") + start.to_bytes(2, "little")
    for distance, quality in zip(millimetres, qualities, strict=True):
        whole = round(float(distance))
        word = whole if 0 < whole < 0x4000 else _NOTHING
        body += word.to_bytes(2, "little") + int(quality if word != _NOTHING else 0).to_bytes(width, "little")
    body += end.to_bytes(2, "little")
    check = 0
    for at in range(0, len(body), 2):
        check = 2 * check + body[at] + 256 * body[at + 1]
    return body + ((check % 32768 + check // 32768) % 32768).to_bytes(2, "little")
