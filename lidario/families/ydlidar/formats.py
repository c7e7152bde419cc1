"""The point cloud packet ``AA 55``: where it begins, how long it is, and whether it is intact.

Layout (4ROS development manual, figures 5 to 8), all words little-endian::

    0   AA 55   the word 0x55AA
    2   CT      bit 0: start packet; bits 7..1 then hold the scan speed
    3   LSN     number of samples; 1 in a start packet
    4   FSA     angle of the first sample: bit 0 is C, always 1; above it 15 bits of 1/64 degrees
    6   LSA     angle of the last sample, likewise
    8   CS      check value: the XOR of all other words
    10  S1 ...  distances in mm, 0 where nothing came back

As CS is the XOR of the other words, the XOR of all words of an intact packet is 0. With the mark, 32 bits have to
agree: packets are self-evident, whatever follows them.

No document bounds LSN, so every value of its byte is accepted. The vendor's SDK 1.2.20 rejects values above 80. A
packet without samples is not accepted.

Relatives of the 4ROS have other samples (the vendor's SDK 1.2.20, `DriverInterface.h` and `CYdLidar.cpp`):

* 3 bytes: a byte of intensity, then the distance word. The low two bits of that word are flags (sunlight, glass),
    or
  bits 8 and 9 of the intensity, and not distance. In the check value the intensity byte counts as a word of its
  own. So the XOR over the words of the packet is not 0: after the first sample, words are not aligned;
* 4 bytes: a word of intensity, the distance word.

The C bit is mostly not checked: the SDK discards packets in which it is 0, though their check value holds. It must
be 1 only in a packet with more samples than any device is known to send, because a row of samples that equal the
mark also has a right check value.

Records that may stand between packets: ``AA 66 cs t0 t1 t2 t3 r``, a time stamp in ms whose ``cs`` is the XOR
of the other seven bytes (vendor SDK, some models); the scan header once more, after a repeated SCAN; and
device information that nobody asked for, header and 20 bytes, which some models send when they start (SDK).
"""

import math
import re
from collections.abc import Iterable, Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from lidario.wire.blocks import Block, join_blocks, packet_offsets, some_blocks
from lidario.wire.envelope import xor_bytes
from lidario.wire.events import Packets
from lidario.wire.formats import BEGINS, HEADINGS_WORTH_AN_ARRAY, NO_PACKET, Headings, StreamFormat, Stretch

HEADER_SIZE: Final = 10
FULL_TURN_Q6: Final = 360 << 6
MOST_SAMPLES: Final = 0xFF
ORDINARY_SAMPLES: Final = 80
"""Most samples that were ever seen: 40 from most models, 80 from a G4, by a comment in the vendor's SDK 1.2.20."""
START_BIT: Final = 0x01
MAGIC_WORD: Final = 0x55AA

AT_ONCE: Final = 64
"""So many packets are compared in one look: about as many as a revolution has between two start packets."""
ONE_SAMPLE: Final = 1 << 8  # in the second word of a packet, with START_BIT off
LAST_Q6: Final = 2 << 6
"""A packet of one sample that is no start packet is the last one of its revolution, wherever it stands. A real
T-mini Plus sent one at 0.27 degrees, before a start packet at 0.72; the start packet before had been at 0.25. Its
heading is moved back by 2 degrees, so that it passes no seam."""

STAMP_MAGIC: Final = b"\xaa\x66"
STAMP_SIZE: Final = 8
SCAN_HEADER: Final = bytes.fromhex("A55A0500004081")
INFO_HEADER: Final = bytes.fromhex("A55A1400000004")
INFO_SIZE: Final = 20


def equal_sizes(data: bytes | bytearray, at: int, size: int) -> int:
    """How many whole packets of `size` bytes follow each other from `at`, by the sizes that they state.

    It looks at `AT_ONCE` packets at most.
    """
    # Each packet states its size, and so where the next begins: packets of equal sizes stand at equal steps.
    lengths = data[at + 3 : min(len(data) - size + 4, at + AT_ONCE * size) : size]
    return len(lengths) - len(lengths.lstrip(lengths[:1]))


def packet_begins(blocks: Sequence[Block]) -> NDArray[np.intp]:
    """The offset at which each packet begins, shape (packets,): as `packet_offsets`, without a number for each."""
    sizes = np.repeat([size for size, _ in blocks], [count for _, count in blocks])
    begins: NDArray[np.intp] = np.add.accumulate(sizes) - sizes
    return begins


def packet_heads(packets: Packets) -> NDArray[np.uint16]:
    """The words before the samples, shape (packets, 5)."""
    data = packets.data
    # A view with a head at each byte, of which those are taken that begin a packet: they may begin at odd places.
    anywhere = np.ndarray(len(data) - HEADER_SIZE + 1, f"V{HEADER_SIZE}", data, strides=(1,))
    heads: NDArray[np.uint16] = anywhere[packet_begins(packets.blocks)].view("<u2").reshape(-1, HEADER_SIZE // 2)
    return heads


class PointCloud(StreamFormat):
    """0x81 of the 4ROS: up to 255 distances between two angles."""

    sample_size: int = 2  # bytes of one sample
    # From this many packets on, they are checked as one array. Measured: 4 us a packet one by one, 8 us for up to
    # 32 as an array.
    worth_an_array: float = 4

    name = "point cloud"
    response_type = 0x81
    header: re.Pattern[bytes] = re.compile(rb"\xaa\x55")
    shortest: int = HEADER_SIZE + 2
    longest: int = HEADER_SIZE + 2 * MOST_SAMPLES
    samples = 1
    full_turn = FULL_TURN_Q6
    # The device decides where the start packet stands: usually, but not necessarily, at 0.
    first_seam: int | None = None
    self_evident = True

    @property
    def ordinary(self) -> int:
        return HEADER_SIZE + self.sample_size * ORDINARY_SAMPLES

    def measure(self, data: bytearray, at: int) -> int:
        if data[at] != 0xAA:
            return NO_PACKET
        available = len(data) - at
        if available < 2:
            return 0
        if data[at + 1] != 0x55:
            return NO_PACKET
        if available < 8:
            return 0
        samples = data[at + 3]
        if samples > ORDINARY_SAMPLES and not data[at + 4] & data[at + 6] & 1:
            return NO_PACKET
        return HEADER_SIZE + self.sample_size * samples if samples else NO_PACKET

    def intact(self, data: bytearray, at: int, size: int) -> bool:
        word = int.from_bytes(data[at : at + size], "little")
        # Folding one long integer in halves is several times faster than a loop over its words.
        for shift in (8192, 4096, 2048, 1024, 512, 256, 128, 64, 32, 16):
            word ^= word >> shift
        return not word & 0xFFFF

    def run(self, data: bytearray, at: int) -> Stretch:
        found: list[Block] = []
        end = at
        while len(data) - end >= self.shortest:
            size = self.measure(data, end)
            if not 0 < size <= len(data) - end:
                break
            rows = equal_sizes(data, end, size) if size <= self.ordinary else 1
            join_blocks(found, (Block(size, rows),))
            end += rows * size
        count = sum([rows for _, rows in found])
        if count < self.worth_an_array:
            return super().run(data, at)
        words = np.frombuffer(data, "<u2", (end - at) // 2, at)
        begins = packet_begins(found) >> 1
        wrong = np.bitwise_xor.reduceat(words, begins)
        wrong |= words.take(begins) ^ MAGIC_WORD
        if np.count_nonzero(wrong):
            found = list(some_blocks(found, 0, int((wrong != 0).argmax())))
            end = at + sum([size * rows for size, rows in found])
        return Stretch(tuple(found), end, end)

    def samples_in(self, blocks: Iterable[Block]) -> int:
        return sum([(size - HEADER_SIZE) // self.sample_size * count for size, count in blocks])

    def headings(self, packets: Packets) -> Headings:
        if packets.count >= HEADINGS_WORTH_AN_ARRAY:
            heads = packet_heads(packets)
            starts = heads[:, 1] & START_BIT
            angles = (heads[:, 2] >> 1).astype(np.int32)
            last = (heads[:, 1] & (0xFF00 | START_BIT)) == ONE_SAMPLE
            if np.count_nonzero(last):
                angles[last] -= LAST_Q6
            angles %= FULL_TURN_Q6
            return angles + starts * np.int32(BEGINS) if np.count_nonzero(starts) else angles
        data, found = packets.data, []
        for at in packet_offsets(packets.blocks)[:-1]:
            angle = data[at + 4] >> 1 | data[at + 5] << 7
            if data[at + 2] & START_BIT:
                found.append(angle % FULL_TURN_Q6 | BEGINS)
            else:
                found.append((angle - LAST_Q6 * (data[at + 3] == 1)) % FULL_TURN_Q6)
        return found

    def other_record(self, data: bytearray, at: int) -> int:
        """As `StreamFormat.other_record`: a time stamp, a repeated scan header, unsolicited device information."""
        begin = bytes(data[at : at + len(SCAN_HEADER)])
        if begin[0] == SCAN_HEADER[0]:
            if begin == SCAN_HEADER:
                return len(SCAN_HEADER)
            if begin == INFO_HEADER:
                whole = len(INFO_HEADER) + INFO_SIZE
                return whole if len(data) - at >= whole else 0
            return 0 if SCAN_HEADER.startswith(begin) or INFO_HEADER.startswith(begin) else NO_PACKET
        if not STAMP_MAGIC.startswith(begin[:2]):
            return NO_PACKET
        if len(data) - at < STAMP_SIZE:
            return 0
        # With its check byte, the XOR of all eight bytes is 0.
        return NO_PACKET if xor_bytes(data[at : at + STAMP_SIZE]) else STAMP_SIZE


class PointCloud3(PointCloud):
    """Samples of three bytes. Words are not aligned, so that an array would not be faster."""

    response_type = 0xA6
    sample_size = 3
    worth_an_array: float = math.inf
    shortest = HEADER_SIZE + 3
    longest = HEADER_SIZE + 3 * MOST_SAMPLES

    def intact(self, data: bytearray, at: int, size: int) -> bool:
        """As `StreamFormat.intact`: by the XOR of the words in the head, the intensities and the distance words."""
        packet = data[at : at + size]
        low = xor_bytes(packet[0:10:2]) ^ xor_bytes(packet[10::3]) ^ xor_bytes(packet[11::3])
        return not low and xor_bytes(packet[1:10:2]) == xor_bytes(packet[12::3])


class PointCloud4(PointCloud):
    """Samples of four bytes."""

    response_type = 0xA7
    sample_size = 4
    shortest = HEADER_SIZE + 4
    longest = HEADER_SIZE + 4 * MOST_SAMPLES


FORMATS: Final = (PointCloud, PointCloud3, PointCloud4)  # by the bytes of a sample
