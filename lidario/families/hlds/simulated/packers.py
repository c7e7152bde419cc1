"""The device's own way to put measurements into bytes; shares nothing with the host's side.

As ROBOTIS' driver reads it: ``FA``, number, speed in tenths of a revolution a minute, six times intensity, distance
and two bytes more, and a check value of which only that it stands twice is known.
"""

from __future__ import annotations

from collections.abc import Sequence


def pack_packet(
    index: int,
    millimetres: Sequence[float],
    intensities: Sequence[int],
    *,
    rpm: float = 300.0,
    reserved: int = 0,
    check: bytes | None = None,
) -> bytes:
    """Pack one measurement packet.

    Args:
        index: 0 to 59.
        millimetres: Six of them; 0 = no return.
        intensities: Six of them.
        rpm: Speed of the rotor.
        reserved: What stands behind each distance.
        check: The last two bytes; by default 255 less the sum of all others, twice.
    """
    body = bytes((0xFA, 0xA0 + index)) + round(rpm * 10).to_bytes(2, "little")
    for distance, intensity in zip(millimetres, intensities, strict=True):
        for word in (int(intensity), round(float(distance)), reserved):
            body += word.to_bytes(2, "little")
    if check is None:
        check = bytes((255 - sum(body) % 256,)) * 2
    return body + check
