"""Camsense X1, and the LDS08RR of the same kind: turrets of robot vacuums, sold bare.

They turn and stream for as long as they have power, and hear nothing. Sources: Camsense's ``T2SDK``, 47 packets
of a real X1 (github.com/thijses/camsense-X1), community ports. The models are told apart by how
their samples lie.
"""

from dataclasses import replace
from typing import Final

from lidario.families.camsense.decode import PacketDecoder
from lidario.families.camsense.formats import LongFormat, PacketFormat
from lidario.families.talking import Talkers, TalkingModel, family_of

_X1: Final = TalkingModel("x1", "Camsense X1", (115_200,), 1e6 / 2080, 8.0, PacketFormat, PacketDecoder)
_LDS08RR: Final = replace(_X1, name="lds08rr", title="LDS08RR of Camsense", wire=LongFormat)

TALKERS: Final = Talkers(
    family="camsense",
    all=(_X1, _LDS08RR),
    unnamed=lambda packets, _: _X1 if packets[2] == 3 else _LDS08RR,
    # A revolution: of less, a rotor that is faster at some places tells another rate. They take 0.2 s.
    heard=50,
    wires=(PacketFormat, LongFormat),
)

FAMILY: Final = family_of(TALKERS, "Camsense")
