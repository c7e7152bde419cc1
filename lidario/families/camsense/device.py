"""The models, told apart by how their samples lie."""

from __future__ import annotations

from typing import Final

from lidario.families.camsense.decode import LongDecoder, PacketDecoder, sample_us
from lidario.families.camsense.formats import LongFormat, PacketFormat
from lidario.families.talking import Talkers, TalkingModel

_SAMPLE_US: Final = 1e6 / 2080
_X1: Final = TalkingModel("x1", "Camsense X1", 115_200, _SAMPLE_US, 8.0, PacketFormat, PacketDecoder)
_LDS08RR: Final = TalkingModel("lds08rr", "LDS08RR of Camsense", 115_200, _SAMPLE_US, 8.0, LongFormat, LongDecoder)

TALKERS: Final = Talkers(
    family="camsense",
    all=(_X1, _LDS08RR),
    unnamed=lambda packets, _: _X1 if packets[2] == 3 else _LDS08RR,
    sample_us=sample_us,
    # By so many the rate is known to half a percent.
    heard=24,
    wires=(PacketFormat, LongFormat),
)
"""The family's models."""
