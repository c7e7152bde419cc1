"""Delta-2A, 2B, 2D and 2G of 3irobotix (Shanchuan), and the LDS08RR of the same kind: turrets of robot vacuums.

They stream for as long as their rotor turns, and hear nothing. The host powers the motor by wires of its own, so no
request sets the speed; what is measured is told. Sources: 3irobotix's SDK 1.7.1 and protocol documents, community
ports, and what owners of four turrets tell of their frames; nothing was tried with a device.

How many frames a revolution has tells two kinds of models apart, and each kind measures alike.
"""

from dataclasses import replace
from typing import Final

from lidario.families.irobotix.decode import FrameDecoder, frames_a_turn
from lidario.families.irobotix.formats import DATA, RECORD, AnyFrame, FifteenFormat, FrameFormat
from lidario.families.talking import Rotor, Talkers, TalkingModel, family_of

_SIXTEEN: Final = TalkingModel(
    "", "Delta-2A, 2B or 2D", (230_400,), 200.0, 8.0, FrameFormat, FrameDecoder, slowest_turn_s=0.4
)
"""The slowest revolution: at four a second, and half as long again."""
_FIFTEEN: Final = replace(
    _SIXTEEN, title="Delta-2G or LDS08RR", baudrates=(115_200,), sample_us=1e6 / 1890, wire=FifteenFormat
)


def _trouble(packets: bytes) -> str:
    if packets[5] != RECORD:
        return ""
    return (
        f"the motor does not turn as it should: {packets[DATA] * 3} revolutions a minute, and nothing is measured. "
        "The host powers it: about 3.3 V, regulated to 240 to 600 revolutions a minute"
    )


TALKERS: Final = Talkers(
    family="irobotix",
    all=(
        # more_families_2.md 5.1
        replace(_SIXTEEN, name="delta2a", title="Delta-2A", baudrates=(230_400, 115_200)),
        replace(_SIXTEEN, name="delta2b", title="Delta-2B"),
        replace(_SIXTEEN, name="delta2d", title="Delta-2D", baudrates=(115_200,), sample_us=500.0),
        replace(_FIFTEEN, name="delta2g", title="Delta-2G"),
        replace(_FIFTEEN, name="lds08rr", title="LDS08RR of 3irobotix"),
        _SIXTEEN,
        _FIFTEEN,
    ),
    unnamed=lambda packets, _: _SIXTEEN if frames_a_turn(packets) == FrameFormat.frames else _FIFTEEN,
    heard=6,
    # A frame, at one revolution a second.
    rotor=Rotor(AnyFrame, 0.2, _trouble),
)

FAMILY: Final = family_of(TALKERS, "3irobotix")
