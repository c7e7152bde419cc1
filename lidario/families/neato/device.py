"""The models, and what else is known of a device: nothing tells them apart, and the host regulates the motor.

300 revolutions a minute is what vacuums and adapters regulate to. From 349 on the line is full; below 200 nothing
is measured, which is told as the state of the rotor and not as a fault of the line.
"""

from __future__ import annotations

from typing import Final

from lidario.families.neato.decode import BackDecoder, PacketDecoder
from lidario.families.neato.formats import SLOWEST, AnySpeed, BackFormat, PacketFormat
from lidario.families.slots import FULL_TURN
from lidario.families.talking import Rotor, Talkers, TalkingModel

_USUAL_US: Final = 60e6 / (300 * FULL_TURN)
_SENSE_UNKNOWN: Final = (
    "an XV-11 and an LDS01RR or LDS02RR send the same packets. It is read as an XV-11, which turns "
    "counter-clockwise; the scans of the others would be mirrored: name the model, as in ?model=lds02rr, "
    "or ?model=xv11"
)
_UNNAMED: Final = TalkingModel(
    "", "XV-11 or alike", 115_200, _USUAL_US, 0.0, BackFormat, BackDecoder, note=_SENSE_UNKNOWN
)


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
    all=(
        TalkingModel("xv11", "Neato XV-11", 115_200, _USUAL_US, 0.0, BackFormat, BackDecoder),
        TalkingModel("lds02rr", "LDS02RR", 115_200, _USUAL_US, 0.0, PacketFormat, PacketDecoder),
        TalkingModel("lds01rr", "LDS01RR", 115_200, _USUAL_US, 9.0, PacketFormat, PacketDecoder),
    ),
    unnamed=lambda packets, baudrate: _UNNAMED,  # noqa: ARG005 - they tell nothing
    sample_us=PacketFormat.sample_us,
    heard=4,
    # Two packets a revolution at 50 revolutions a minute, as the recording has it.
    rotor=Rotor(AnySpeed, 0.8, _too_slow),
)
"""The family's models."""
