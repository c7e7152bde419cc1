"""The one model: whether its packets have a check value that holds, is heard when it is opened.

The letter ``b`` starts motor and stream, ``e`` stops both; nothing is responded (ROBOTIS' driver,
``lds_driver.cpp``). Since firmware 2017.10 it starts by itself when it gets power.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Final

import numpy as np

from lidario.families.hlds.decode import PacketDecoder
from lidario.families.hlds.formats import SIZE, CheckedFormat, PacketFormat
from lidario.families.slots import FULL_TURN
from lidario.families.talking import Talkers, TalkingModel

_UNCHECKED: Final = TalkingModel(
    "",
    "HLDS LDS-01",
    230_400,
    60e6 / (300 * FULL_TURN),
    3.5,
    PacketFormat,
    PacketDecoder,
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
    sample_us=PacketFormat.sample_us,
    # A revolution: what holds for so many is a rule.
    heard=60,
)
"""The family's model, as it is read with a check value and without."""
