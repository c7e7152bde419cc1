"""The device's own way to put measurements into bytes; shares nothing with the host's side.

As 3irobotix's protocol documents have it: big-endian frames with their length, a version, a command, and a sum.
"""

from __future__ import annotations

from collections.abc import Sequence


def pack_frame(command: int, data: bytes, *, version: int = 1) -> bytes:
    """Pack any frame."""
    body = b"\xaa" + (8 + len(data)).to_bytes(2, "big") + bytes((version, 0x61, command))
    body += len(data).to_bytes(2, "big") + data
    return body + (sum(body) % 65536).to_bytes(2, "big")


def pack_measurement(
    start: int,
    millimetres: Sequence[float],
    signals: Sequence[int],
    *,
    hertz: float = 6.0,
    end: int | None = None,
    version: int = 1,
) -> bytes:
    """Pack one measurement frame.

    Args:
        start: Hundredths of a degree.
        millimetres: Sent as quarters; 0 = no return, as is what 16 bits cannot hold.
        signals: As many.
        hertz: Speed of the rotor.
        end: The angle of the last sample, of a model that sends it.
        version: As in the head.
    """
    # The calibration is 0.
    data = bytes((min(round(hertz * 20), 255), 0, 0)) + start.to_bytes(2, "big")
    if end is not None:
        data += end.to_bytes(2, "big")
    for distance, signal in zip(millimetres, signals, strict=True):
        quarters = round(float(distance) * 4)
        data += bytes((int(signal),)) + (quarters if quarters < 65536 else 0).to_bytes(2, "big")
    return pack_frame(0xAD, data, version=version)


def pack_failure(hertz: float) -> bytes:
    """Pack the frame that tells of a rotor that is too slow or too fast."""
    return pack_frame(0xAE, bytes((min(round(hertz * 20), 255),)))
