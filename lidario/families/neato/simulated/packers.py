"""The device's own way to put measurements into bytes; shares nothing with the host's side.

Firmware 2.4 of the XV-11, as its hacking wiki has it: ``FA``, index, speed in 64ths of a revolution a minute, four
times distance and strength, and a check value.
"""

from __future__ import annotations

from collections.abc import Sequence

_NOTHING = 0x8035
"""No return: bit 15, and the code that is the most frequent one in the recording."""


def pack_packet(
    index: int, millimetres: Sequence[float], strengths: Sequence[int], *, rpm: float = 300.0, code: int = 0
) -> bytes:
    """Pack one measurement packet.

    Args:
        index: 0 to 89.
        millimetres: Four of them; 0 = no return, as is what 14 bits cannot hold.
        strengths: Four of them.
        rpm: Speed of the rotor.
        code: Where it is not 0, the error that all samples tell.
    """
    body = bytes((0xFA, 0xA0 + index)) + round(rpm * 64).to_bytes(2, "little")
    for distance, strength in zip(millimetres, strengths, strict=True):
        whole = round(float(distance))
        word = 0x8000 | code if code else whole if 0 < whole < 0x4000 else _NOTHING
        body += word.to_bytes(2, "little") + int(strength).to_bytes(2, "little")
    return body + _check_value(body).to_bytes(2, "little")


def _check_value(body: bytes) -> int:
    total = 0
    for at in range(0, 20, 2):
        total = total * 2 + body[at] + 256 * body[at + 1]
    return (total % 32768 + total // 32768) % 32768
