"""The frames ``AA 00``: measurements of one sixteenth or fifteenth of a revolution, big-endian.

Layout (3irobotix's SDK 1.7.1, its protocol documents of the Delta-2A and 2D)::

    0   AA
    1   u16     length, all but the sum: 8 and the data
    3   u8      version: 01, 10 and 00 occur
    4   61
    5   u8      AD measurement; AE the rotor is too slow or too fast; A9, AB others
    6   u16     length of the data
    8   data
        u16     sum of all bytes before

Data of AD::

    0   u8      speed of the rotor, 1/20 revolutions a second
    1   i16     calibration, which the vendor's SDK does not apply either
    3   u16     angle of the first sample, 1/100 degrees
   (5   u16     angle of the last one: of a Delta-2C Pro, and of some Delta-2D; the length of the data tells)
        N x     u8 signal; u16 distance in quarter millimetres, 0 where nothing came back

How many samples a frame has, changes with the speed and from frame to frame. Two thirds of a head are fixed and the
lengths must agree, so with the sum a frame is self-evident.
"""

import re
from collections.abc import Iterable, Sequence
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from lidario.wire.blocks import Block, packet_offsets
from lidario.wire.events import Packets
from lidario.wire.formats import NO_PACKET, Headings, StreamFormat, headings_of

MARK: Final = b"\xaa\x00"
FIXED: Final = 0x61
MEASUREMENT: Final = 0xAD
RECORD: Final = 0xAE
RECORDS: Final[dict[int, int | None]] = {RECORD: 1, 0xA9: None, 0xAB: None}
"""Commands of other frames, and how long their data are, where that is known."""
DATA: Final = 8
SUM: Final = 2
HEAD: Final = 5
SAMPLE: Final = 3
FULL_TURN: Final = 36_000  # 360 degrees in hundredths of a degree


def samples_of(size: Any) -> Any:
    """Samples of a measurement of that size; the angle of the last one takes less than one more would."""
    return (size - DATA - HEAD - SUM) // SAMPLE


def frames_of(
    data: bytes, offsets: Sequence[int]
) -> tuple[NDArray[np.int32], NDArray[np.int32], NDArray[np.uint8]]:
    """Where measurements begin, their samples and speeds; by the offset of each, and of the end of the last one."""
    rows, at = np.frombuffer(data, np.uint8), np.array(offsets[:-1]) + DATA
    starts = (rows[at + 3].astype(np.int32) << 8 | rows[at + 4]) % FULL_TURN
    return starts, samples_of(np.diff(offsets)).astype(np.int32), rows[at]


def frames_in(packets: bytes) -> tuple[NDArray[np.int32], NDArray[np.int32], NDArray[np.uint8]]:
    """As `frames_of`, of frames in a row, each of which tells its own length."""
    offsets = [0]
    while offsets[-1] < len(packets):
        offsets.append(offsets[-1] + packets[offsets[-1] + 2] + SUM)
    return frames_of(packets, offsets)


class FrameFormat(StreamFormat):
    """Frames of which a revolution has sixteen: Delta-2A, 2B, 2D. The types are our own numbers."""

    frames: int = 16  # frames of a revolution

    name = "AA 00"
    response_type = 0xAD
    header: re.Pattern[bytes] = re.compile(re.escape(MARK), re.DOTALL)
    shortest = DATA + HEAD + SAMPLE + SUM
    longest = 0xFF + SUM  # as the mark has it: the vendor's SDK takes the length as one byte, too
    samples = 1
    full_turn = FULL_TURN
    self_evident = True

    def measure(self, data: bytearray, at: int) -> int:
        size = _frame(data, at, MEASUREMENT)
        if size > 0 and (size < self.shortest or (size - DATA - SUM) % SAMPLE not in (1, 2)):
            return NO_PACKET
        return size

    def intact(self, data: bytearray, at: int, size: int) -> bool:
        return _sum_holds(data, at, size)

    def headings(self, packets: Packets) -> Headings:
        return headings_of(frames_of(packets.data, packet_offsets(packets.blocks))[0])

    @classmethod
    def sample_us(cls, packets: bytes) -> float:
        """As `StreamFormat.sample_us`; 0 where the rotor stands."""
        _, counts, speeds = frames_in(packets)
        a_second = float(np.median(counts)) * float(np.median(speeds)) / 20 * cls.frames
        return 1e6 / a_second if a_second else 0.0

    def samples_in(self, blocks: Iterable[Block]) -> int:
        return sum([samples_of(size) * count for size, count in blocks])

    def told_sample_ns(self, packets: Packets) -> NDArray[np.float64]:
        _, counts, speeds = frames_of(packets.data, packet_offsets(packets.blocks))
        taken: NDArray[np.float64] = 1e9 / (np.maximum(speeds / 20.0, 0.05) * self.frames * counts)
        return taken

    def other_record(self, data: bytearray, at: int) -> int:
        size = _frame(data, at, *RECORDS)
        if size <= 0:
            return size
        length = RECORDS[data[at + 5]]
        if length not in (None, size - DATA - SUM):
            return NO_PACKET
        if len(data) - at < size:
            return 0
        return size if _sum_holds(data, at, size) else NO_PACKET


class FifteenFormat(FrameFormat):
    """The same frames, of which a revolution has fifteen: Delta-2G, LDS08RR."""

    frames: int = 15
    response_type = 0xAE


class AnyFrame(FrameFormat):
    """All frames: what tells that the rotor does not turn as it should."""

    shortest = DATA + 1 + SUM

    def measure(self, data: bytearray, at: int) -> int:
        return _frame(data, at, MEASUREMENT, RECORD)


def _frame(data: bytearray, at: int, *commands: int) -> int:
    """Length of the frame of one of these commands that begins at `at`, by its own head; as `measure`."""
    head = data[at : at + DATA]
    if not MARK.startswith(head[:2]) or (len(head) > 4 and head[4] != FIXED):
        return NO_PACKET
    if len(head) > 5 and head[5] not in commands:
        return NO_PACKET
    if len(head) < DATA:
        return 0
    size = int.from_bytes(head[6:], "big") + DATA
    return size + SUM if size == head[2] else NO_PACKET


def _sum_holds(data: bytearray, at: int, size: int) -> bool:
    end = at + size - SUM
    return sum(data[at:end]) & 0xFFFF == data[end] << 8 | data[end + 1]
