"""Which decoder belongs to which response type.

The six formats' packets of one stretch of stream are decoded at once into arrays: those of capsules in
`decode_capsules`, those that hold whole nodes in `decode_nodes`.

Sources: S-series interface manual for 0x81 and 0x85; vendor's SDK 2.1.0 for 0x82, 0x83, 0x84 and 0x86 and for
everything the manual leaves out. Two things differ from the SDK on purpose: angles keep their full precision
(the SDK truncates to 1/64 degrees), and formats that carry no intensity report none (the SDK reports 188).

All distances are millimetres, 0 where nothing came back; all angles degrees, clockwise.

A revolution is some thousand samples, and each call of numpy costs as much as a pass over all of them. So arrays
are written where they will stay, in single precision, and in units in which angles are whole numbers until the
very last division. Single precision holds those exactly.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

from lidario.families.base import Decoder
from lidario.families.rplidar.decode_capsules import (
    DenseDecoder,
    ExpressDecoder,
    UltraDecoder,
    UltraDenseDecoder,
)
from lidario.families.rplidar.decode_nodes import HqDecoder, NodeDecoder

DECODERS: Final[dict[int, Callable[[], Decoder]]] = {
    0x81: NodeDecoder,
    0x82: ExpressDecoder,
    0x83: HqDecoder,
    0x84: UltraDecoder,
    0x85: DenseDecoder,
    0x86: UltraDenseDecoder,
}
"""Response type -> decoder, one row for each row of `formats.FORMATS`."""
