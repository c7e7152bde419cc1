"""The six measurement formats: where their packets begin, how long they are, and whether they are intact.

Sizes, header bits and check values: S-series interface manual for 0x81 and 0x85; the packed structures of the
vendor's SDK 2.1.0 for 0x82, 0x83, 0x84 and 0x86. The four capsule formats share a header: the high nibbles of
the first two bytes are A and 5, their low nibbles hold the XOR of all bytes behind them. The start angle is a
15-bit number of 1/64 degrees. Bit 15 of its word says that the stream began anew (SDK), or a revolution (manual);
`lidario.revolution.seam` handles both.
"""

import re
import struct
from functools import cache
from typing import Final
from zlib import crc32

import numpy as np
from numpy.typing import NDArray

from lidario.families.rplidar.chains import FULL_TURN_Q6
from lidario.families.rplidar.nodes import NodeFormat
from lidario.wire.blocks import Block
from lidario.wire.events import Packets
from lidario.wire.formats import NO_PACKET, RESTARTS, Headings, StreamFormat, Stretch, headings_of
from lidario.wire.rows import RowFormat, row_begins

FULL_TURN_Q14: Final = 65536
ANGLE_MASK: Final = 0x7FFF
STREAM_START_BIT: Final = 0x8000

CAPSULES_WORTH_AN_ARRAY: Final = 160
"""From this many capsules on, headings are an array. Measured: making and following a list takes 4 us, and 0.04 us
a capsule; an array takes 8 us. Live, where numpy is cold once a revolution: 50 and 90 us for 80 capsules."""


def _heads_of() -> NDArray[np.uint16]:
    words = np.arange(1 << 16, dtype=np.uint16)
    folded = (words ^ words >> 8) & 0xFF
    return (0x50A0 | folded & 0xF | (folded & 0xF0) << 4).astype(np.uint16)


_HEADS: Final = _heads_of()  # first word of an intact packet, by the XOR of its other words


class CapsuleFormat(RowFormat):
    """The base of the four capsule formats."""

    header: re.Pattern[bytes] = re.compile(rb"[\xa0-\xaf][\x50-\x5f]")
    full_turn = FULL_TURN_Q6
    own_angles = False
    start_at = 2  # offset of the start angle

    def measure(self, data: bytearray, at: int) -> int:
        if data[at] >> 4 != 0xA:
            return NO_PACKET
        if at + 1 >= len(data):
            return 0
        return self.shortest if data[at + 1] >> 4 == 0x5 else NO_PACKET

    def intact(self, data: bytearray, at: int, size: int) -> bool:
        word = int.from_bytes(data[at + 2 : at + size], "little")
        # Folding one long integer in halves is several times faster than a loop over its bytes.
        for shift in (1024, 512, 256, 128, 64, 32, 16, 8):
            word ^= word >> shift
        return word & 0xFF == (data[at] & 0xF) | (data[at + 1] & 0xF) << 4

    def headings(self, packets: Packets) -> Headings:
        told = np.frombuffer(packets.data, "<u2")[self.start_at // 2 :: self.shortest // 2]
        few: list[int] | None = told.tolist() if len(told) < CAPSULES_WORTH_AN_ARRAY else None
        # The flag is the highest bit: if every word is below 360 degrees, none is set.
        if few and max(few) < FULL_TURN_Q6:
            return few
        words = told.astype(np.int32)
        if words.max() >= FULL_TURN_Q6:
            restarts = (words & STREAM_START_BIT) * (RESTARTS // STREAM_START_BIT)
            words = (words & ANGLE_MASK) % FULL_TURN_Q6 | restarts
        return words.tolist() if few else words

    def _intact_rows(self, data: bytearray, at: int, count: int) -> NDArray[np.bool_]:
        step = self.shortest // 2
        words = np.frombuffer(data, "<u2", count * step, at)
        first = words[::step]
        intact: NDArray[np.bool_] = first == _HEADS.take(
            first ^ np.bitwise_xor.reduceat(words, row_begins(count, step))
        )
        return intact


class ExpressFormat(CapsuleFormat):
    """0x82: 16 cabins of two samples."""

    name = "express"
    response_type = 0x82
    shortest = longest = 84
    samples = 32


class UltraFormat(CapsuleFormat):
    """0x84: 32 cabins of three samples."""

    name = "ultra"
    response_type = 0x84
    shortest = longest = 132
    samples = 96


class DenseFormat(CapsuleFormat):
    """0x85: 40 distances."""

    name = "dense"
    response_type = 0x85
    shortest = longest = 84
    samples = 40


class UltraDenseFormat(CapsuleFormat):
    """0x86: a time stamp, a status word, and 32 cabins of two samples with intensity."""

    name = "ultra-dense"
    response_type = 0x86
    shortest = longest = 170
    samples = 64
    start_at = 8


HQ_NODE: Final = np.dtype([("angle", "<u2"), ("distance", "<u4"), ("quality", "u1"), ("flag", "u1")])
HQ: Final = np.dtype([("sync", "u1"), ("time", "<u8"), ("nodes", HQ_NODE, 96), ("crc", "<u4")])
CRC_AT: Final = HQ.itemsize - 4
_stated = struct.Struct("<I").unpack_from


def _crc_off(data: bytearray, at: int) -> int:
    """The bits in which the stated CRC of a packet differs from the computed one; 0 if the packet is intact."""
    end = at + CRC_AT
    stated: int = _stated(data, end)[0]
    return crc32(b"\0\0\0", crc32(data[at:end])) ^ stated


@cache
def _single_bits() -> dict[int, int]:
    """For each value of `_crc_off` that a single flipped bit of a packet, CRC included, causes: that bit."""
    packet = bytearray(HQ.itemsize)
    clean, found = _crc_off(packet, 0), dict[int, int]()
    for bit in range(8 * HQ.itemsize):
        packet[bit // 8] = 1 << bit % 8
        found[_crc_off(packet, 0) ^ clean] = bit
        packet[bit // 8] = 0
    return found


class HqFormat(StreamFormat):
    """0x83: 96 whole nodes behind a time stamp, with a CRC-32.

    The CRC covers all other bytes, padded with zeros to a multiple of four bytes.

    Each single flipped bit changes the CRC in a different way (over 6248 bits its least distance is 4). So, while
    in step, a packet with one flipped bit is repaired in the buffer. Two flipped bits never look like one; other
    damage does once in 687,000 times.
    """

    name = "hq"
    response_type = 0x83
    shortest = longest = 781
    samples = 96
    header: re.Pattern[bytes] = re.compile(rb"\xa5")
    full_turn = FULL_TURN_Q14
    self_evident = True

    def measure(self, data: bytearray, at: int) -> int:
        return self.shortest if data[at] == 0xA5 else NO_PACKET

    def intact(self, data: bytearray, at: int, size: int) -> bool:  # noqa: ARG002
        return not _crc_off(data, at)

    def run(self, data: bytearray, at: int) -> Stretch:
        """As `StreamFormat.run`; a packet with one flipped bit is repaired in `data`."""
        size, begin = self.shortest, at
        last = len(data) - size
        while at <= last and data[at] == 0xA5 and (not _crc_off(data, at) or self.mend(data, at)):
            at += size
        return Stretch((Block(size, (at - begin) // size),) if at > begin else (), at, at)

    def mend(self, data: bytearray, at: int) -> bool:
        bit = _single_bits().get(_crc_off(data, at))
        if bit is None:
            return False
        data[at + bit // 8] ^= 1 << bit % 8
        return True

    def headings(self, packets: Packets) -> Headings:
        return headings_of(np.frombuffer(packets.data, HQ)["nodes"]["angle"][:, 0].astype(np.int32))


FORMATS: Final[dict[int, type[StreamFormat]]] = {
    kind.response_type: kind
    for kind in (NodeFormat, ExpressFormat, HqFormat, UltraFormat, DenseFormat, UltraDenseFormat)
}
"""Response type -> format, for every format this family knows."""
