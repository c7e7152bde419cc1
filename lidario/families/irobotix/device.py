"""The models: how many frames a revolution has tells two kinds apart, and each kind measures alike."""

from __future__ import annotations

from dataclasses import replace
from typing import Final

from lidario.families.irobotix.decode import FifteenDecoder, FrameDecoder, frames_a_turn, sample_us
from lidario.families.irobotix.formats import DATA, RECORD, AnyFrame, FifteenFormat, FrameFormat
from lidario.families.talking import Rotor, Talkers, TalkingModel

_SLOWEST_S: Final = 0.4
"""One revolution at four a second, and half as long again."""


def _sixteen(name: str, title: str, baudrate: int, us: float) -> TalkingModel:
    return TalkingModel(name, title, baudrate, us, 8.0, FrameFormat, FrameDecoder, slowest_turn_s=_SLOWEST_S)


def _fifteen(name: str, title: str) -> TalkingModel:
    return TalkingModel(
        name, title, 115_200, 1e6 / 1890, 8.0, FifteenFormat, FifteenDecoder, slowest_turn_s=_SLOWEST_S
    )


_UNNAMED: Final = {
    16: _sixteen("", "Delta-2A, 2B or 2D", 230_400, 200.0),
    15: _fifteen("", "Delta-2G or LDS08RR"),
}


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
        replace(_sixteen("delta2a", "Delta-2A", 230_400, 200.0), older_baudrate=115_200),
        _sixteen("delta2b", "Delta-2B", 230_400, 200.0),
        _sixteen("delta2d", "Delta-2D", 115_200, 500.0),
        _fifteen("delta2g", "Delta-2G"),
        _fifteen("lds08rr", "LDS08RR of 3irobotix"),
        *_UNNAMED.values(),
    ),
    unnamed=lambda packets, _: _UNNAMED[frames_a_turn(packets)],
    sample_us=sample_us,
    heard=6,
    # Frames are long, and each is self-evident.
    linked=1,
    # A frame, at one revolution a second.
    rotor=Rotor(AnyFrame, 0.2, _trouble),
)
"""The family's models."""
