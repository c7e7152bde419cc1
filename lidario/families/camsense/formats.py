"""The measurement packet ``55 AA``: so many samples between two angles, under a folded check value.

Layout (Camsense's ``T2SDK``, and 47 packets of a real X1, all of whose check values hold), little-endian::

    0        55 AA
    2        how samples lie: 03 with 3 bytes, 07 with 4
    3        number of samples n: 8 of an X1, 12 of an LDS08RR
    4        u16     speed of the rotor, 1/64 revolutions a minute
    6        u16     angle of the first sample, A000 + 1/64 degrees
    8        n x     u16 distance in mm, 14 bits; bit 15: none; and quality, 8 or 16 bits
    8 + kn   u16     angle of the last sample, likewise
    10 + kn  u16     check value of fifteen bits over all words before

While the rotor speeds up, packets have the start 0, then A000, and the end the same: they tell no angles, and are
records here.
"""

from __future__ import annotations

import re
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from lidario.wire.events import Packets
from lidario.wire.formats import HEADINGS_WORTH_AN_ARRAY, NO_PACKET, Headings
from lidario.wire.rows import Fold15, RowFormat

__all__ = ["FULL_TURN", "LDS08RR", "X1", "ZERO", "LongFormat", "PacketFormat"]

MARK: Final = b"\x55\xaa"
ZERO: Final = 0xA000
FULL_TURN: Final = 360 << 6


def _layout(samples: int, quality: str) -> np.dtype[Any]:
    sample = np.dtype([("distance", "<u2"), ("quality", quality)])
    return np.dtype(
        [
            ("mark", "u1", 4),
            ("speed", "<u2"),
            ("start", "<u2"),
            ("samples", sample, samples),
            ("end", "<u2"),
            ("check", "<u2"),
        ]
    )


X1: Final = _layout(8, "u1")
LDS08RR: Final = _layout(12, "<u2")


class PacketFormat(RowFormat):
    """The packets of an X1. The types are our own numbers.

    Attributes:
        begin: Its first four bytes.
        layout: What stands where.
    """

    begin: bytes = MARK + b"\x03\x08"
    layout: np.dtype[Any] = X1

    name = "55 AA"
    response_type = 0x55
    header: re.Pattern[bytes] = re.compile(re.escape(MARK), re.DOTALL)
    shortest: int = X1.itemsize
    longest: int = X1.itemsize
    samples = 8
    full_turn = FULL_TURN

    def __init__(self) -> None:
        super().__init__()
        self._fold = Fold15(self.shortest // 2 - 1)

    def measure(self, data: bytearray, at: int) -> int:
        """As `StreamFormat.measure`: its angles tell whether the rotor is up to speed."""
        size = self._size(data, at)
        return size if size <= 0 or self._turns(data, at) else NO_PACKET

    def intact(self, data: bytearray, at: int, size: int) -> bool:  # noqa: ARG002
        return self._fold.holds(data, at)

    def other_record(self, data: bytearray, at: int) -> int:
        """As `StreamFormat.other_record`: a packet of a rotor that speeds up."""
        size = self._size(data, at)
        if size <= 0:
            return size
        return NO_PACKET if self._turns(data, at) or not self._fold.holds(data, at) else size

    def headings(self, packets: Packets) -> Headings:
        starts = (np.frombuffer(packets.data, self.layout)["start"].astype(np.int32) - ZERO) % FULL_TURN
        return starts if len(starts) >= HEADINGS_WORTH_AN_ARRAY else starts.tolist()

    def _size(self, data: bytearray, at: int) -> int:
        if not self.begin.startswith(data[at : at + 4]):
            return NO_PACKET
        return self.shortest if len(data) - at >= self.shortest else 0

    def _turns(self, data: bytearray, at: int) -> bool:
        end = at + self.shortest - 4
        return data[at + 7] >= ZERO >> 8 and data[at + 6 : at + 8] != data[end : end + 2]

    def _intact_rows(self, data: bytearray, at: int, count: int) -> NDArray[np.bool_]:
        raw = np.frombuffer(data, np.uint8, count * self.shortest, at)
        rows = raw.view(self.layout)
        intact: NDArray[np.bool_] = (
            (rows["mark"] == np.frombuffer(self.begin, np.uint8)).all(axis=1)
            & (rows["start"] >= ZERO)
            & (rows["start"] != rows["end"])
            & self._fold.of_rows(raw.reshape(count, -1))
        )
        return intact


class LongFormat(PacketFormat):
    """The packets of an LDS08RR of this kind."""

    begin: bytes = MARK + b"\x07\x0c"
    layout: np.dtype[Any] = LDS08RR

    response_type = 0x56
    shortest: int = LDS08RR.itemsize
    longest: int = LDS08RR.itemsize
    samples = 12
