"""The device's responses as bytes: a descriptor, and behind it the payload of a single response.

Written from the documents: nothing is shared with the host's parser (S-series interface manual; types 0x15 and
0x20, the static address and the accessory board as in vendor SDK 2.1.0).
"""

from __future__ import annotations

import struct
from typing import Final

from lidario.families.rplidar.simulated.profile import Mode

__all__ = [
    "ADDRESS",
    "BOARD",
    "CONF",
    "CONF_SET",
    "HEALTH",
    "INFO",
    "SAMPLERATE",
    "pack_announcement",
    "pack_response",
]

INFO, HEALTH, SAMPLERATE, CONF, CONF_SET, BOARD = 0x04, 0x06, 0x15, 0x20, 0x21, 0xFF
"""Response types of single responses."""
ADDRESS: Final = 0x0001CCC0
"""Type of configuration of the static address, 12 bytes (frame_grabber of the SDK)."""

_CONTINUOUS: Final = 1 << 30  # send mode in the descriptor's length word


def pack_response(kind: int, data: bytes) -> bytes:
    """A single response."""
    return _descriptor(len(data), kind) + data


def pack_announcement(mode: Mode) -> bytes:
    """The descriptor of a stream, before its first packet."""
    return _descriptor(mode.packet[0] | _CONTINUOUS, mode.response_type)


def _descriptor(length: int, kind: int) -> bytes:
    """``A5 5A``, length of one packet with the send mode in the top bits, response type."""
    return struct.pack("<BBIB", 0xA5, 0x5A, length, kind)
