"""The requests of the LD14P, the only model that hears any: ``54 cmd 04 p0 p1 p2 p3 crc``.

Codes: the vendor's SDK (``ldlidar_protocol.h``) and a community port; not tried on a device. Responses exist, but
are not documented. So they are passed over as records, and the stream tells whether a request was obeyed.
"""

from __future__ import annotations

from typing import Final

from lidario.families.ldrobot.formats import CRC, HEAD
from lidario.families.talking import SETTLE_S
from lidario.wire.envelope import Request


def encode(command: int, parameter: int = 0) -> bytes:
    """The bytes of a request."""
    body = bytes((HEAD, command, 4)) + parameter.to_bytes(4, "little")
    return body + bytes((CRC.of(body),))


START: Final = encode(0xA0)
STOP: Final = encode(0xA1)


def speed(degrees_per_second: int) -> Request:
    """Set the speed of the rotor."""
    return Request("SET_SPEED", encode(0xA2, degrees_per_second), settle=SETTLE_S, in_stream=True)
