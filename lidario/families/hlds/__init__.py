"""Hitachi-LG LDS-01 (HLS-LFCD2, HLS-LFCD-LDS, LDS360): the first lidar of the TurtleBot3.

A sample a degree, five revolutions a second. The letter ``b`` starts motor and stream, ``e`` stops both; nothing is
responded. Since firmware 2017.10 it starts by itself when it gets power. Whether its packets have a check value
that holds, is heard when it is opened. Source: ROBOTIS' driver ``hls_lfcd_lds_driver``; no request and no packet
was tried with a device.
"""

from dataclasses import replace
from typing import Final

import numpy as np

from lidario.families.hlds.formats import SIZE, CheckedFormat, PacketFormat
from lidario.families.slots import DegreeDecoder, sample_us_at
from lidario.families.talking import TIMING, Talkers, TalkingModel, family_of

_UNCHECKED: Final = TalkingModel(
    "",
    "HLDS LDS-01",
    (230_400,),
    sample_us_at(300),
    3.5,
    PacketFormat,
    DegreeDecoder,
    note="its packets have no check value that is known: damage in them cannot be told from measurements",
    start=b"b",
    stop=b"e",
)
_CHECKED: Final = replace(_UNCHECKED, wire=CheckedFormat, note="")


def _model_of(packets: bytes, _: int | None) -> TalkingModel:
    """By chance a check value holds in one packet of 16 thousand; some of these may be damaged."""
    rows = np.frombuffer(packets, np.uint8).reshape(-1, SIZE)
    return _CHECKED if 2 * np.count_nonzero(CheckedFormat.check.of_rows(rows)) > len(rows) else _UNCHECKED


TALKERS: Final = Talkers(
    family="hlds",
    all=(_UNCHECKED, _CHECKED),
    unnamed=_model_of,
    # A revolution: what holds for so many is a rule.
    heard=60,
)
"""The family's model, as it is read with a check value and without."""

FAMILY: Final = family_of(
    TALKERS,
    "HLDS",
    # One that waits for its letter sends nothing before it turns evenly; no document says how long that takes.
    replace(TIMING, forget_s=0.5, starts_s=2.4),
)
