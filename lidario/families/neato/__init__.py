"""Neato XV-11 (the lidar of the vacuums XV-11 to Botvac), and the LDS01RR and LDS02RR of Xiaomi and Roborock.

They stream for as long as their rotor turns, and hear nothing. The host powers the motor by wires of its own and so
decides about the speed, which no request can do: what is measured is told. Sources: firmware 2.4 as documented by
the XV-11 hacking wiki and community ports; a recording of a real XV-11 (github.com/Xevel/NXV11); the specification
of the LDS01RR. The pre-production firmware 2.1, which has no check value, is not supported, nor are the frames
``E7 7E`` of the board that the LDS01RR is sold with.

Nothing tells the models apart. 300 revolutions a minute is what vacuums and adapters regulate to. From 349 on the
line is full; below 200 nothing is measured, which is told as the state of the rotor and not as a fault of the line.
"""

from dataclasses import replace
from typing import Final

from lidario.families.neato.formats import SLOWEST, AnySpeed, BackFormat, PacketFormat
from lidario.families.slots import DegreeDecoder, sample_us_at
from lidario.families.talking import Rotor, Talkers, TalkingModel, family_of

_USUAL_US: Final = sample_us_at(300)
_SENSE_UNKNOWN: Final = (
    "an XV-11 and an LDS01RR or LDS02RR send the same packets. It is read as an XV-11, which turns "
    "counter-clockwise; the scans of the others would be mirrored: name the model, as in ?model=lds02rr, "
    "or ?model=xv11"
)
_LDS02RR: Final = TalkingModel("lds02rr", "LDS02RR", (115_200,), _USUAL_US, 0.0, PacketFormat, DegreeDecoder)
_XV11: Final = replace(_LDS02RR, name="xv11", title="Neato XV-11", wire=BackFormat)
_UNNAMED: Final = replace(_XV11, name="", title="XV-11 or alike", note=_SENSE_UNKNOWN)


def _too_slow(packets: bytes) -> str:
    rpm = PacketFormat.rpm_of(packets)
    if rpm * 64 >= SLOWEST:
        return ""
    return (
        f"the motor does not turn as it should: {rpm:.0f} revolutions a minute, and below {SLOWEST / 64:.0f} "
        "nothing is measured. The host powers it: about 3 V, regulated to 300 revolutions a minute"
    )


TALKERS: Final = Talkers(
    family="neato",
    all=(_XV11, _LDS02RR, replace(_LDS02RR, name="lds01rr", title="LDS01RR", reach=9.0)),
    unnamed=lambda packets, baudrate: _UNNAMED,  # noqa: ARG005 - they tell nothing
    heard=4,
    # Two packets a revolution at 50 revolutions a minute, as the recording has it.
    rotor=Rotor(AnySpeed, 0.8, _too_slow),
)

FAMILY: Final = family_of(TALKERS, "Neato")
