"""The block of lines that is one whole scan.

::

    MD0044072501000   echo of the request: first and last step, steps joined, scans left out, scans still to come
    99b               status: data follow
    ooe4g             time in ms, 24 bits, and a check character
    0F]0FT...M        distances, three characters each; 64 characters a line, and a check character behind them
    (an empty line)

``ME`` has an intensity of three characters behind each distance. A character holds six bits, the most significant
first, plus 30 hexadecimal. A value may lie across the end of a line (SCIP 2.0 specification). How long a block is,
follows from its echo. A block with a status other than 99 has no data; ``0M`` comes while the speed is not stable.
"""

import re
from collections.abc import Iterable
from typing import Final

import numpy as np
from numpy.typing import NDArray

from lidario.families.hokuyo.commands import check_of
from lidario.families.hokuyo.geometry import MOST_STEP, Geometry
from lidario.wire.blocks import Block, packet_offsets
from lidario.wire.events import Packets
from lidario.wire.formats import BEGINS, NO_PACKET, Headings, StreamFormat, Ticks

ECHO: Final = 16  # bytes of the echo, with its line feed
HEAD: Final = ECHO + 4 + 6  # with the status and the time
LINE: Final = 64  # characters of a full line
_RECORD: Final = ECHO + 4 + 1
_DATA: Final = b"99b\n"


class DistanceFormat(StreamFormat):
    """Blocks of ``MD``: distances alone; `geometry` is what the device told of its field, None for any."""

    name = "MD"
    response_type = 0x4D
    word: bytes = b"MD"
    mode: str = "Standard"
    characters: int = 3
    full_turn = 360
    first_seam: int | None = None
    self_evident = True
    ticks: Ticks | None = Ticks(1_000_000, 1 << 24)
    whole = True

    def __init__(self, geometry: Geometry | None = None) -> None:
        super().__init__()
        field = b"\\d{8}" if geometry is None else b"%04d%04d" % (geometry.first, geometry.last)
        # Short, for a longer one could be missed where bytes end in its midst.
        self.header: re.Pattern[bytes] = re.compile(self.word)
        self._head: re.Pattern[bytes] = re.compile(self.word + field + rb"01\d{3}\n[0-9][0-9A-Z].\n")
        self._turn = 1 if geometry is None else geometry.turn
        steps = (1, MOST_STEP + 1) if geometry is None else (geometry.steps, geometry.steps)
        self.samples: int = steps[0]
        self.shortest: int = self._size(steps[0])
        self.longest: int = self._size(steps[1])
        if geometry is not None:
            step = 360 / geometry.turn
            # Half a step around each sample belongs to it.
            self.begin_deg: float = (geometry.front - geometry.first + 0.5) * step
            self.field_deg: float = -geometry.steps * step

    @property
    def pitch(self) -> int:
        return self._turn

    def _size(self, steps: int) -> int:
        """Bytes of a block of so many steps."""
        count = steps * self.characters
        return HEAD + count + 2 * -(-count // LINE) + 1

    def measure(self, data: bytearray, at: int) -> int:
        if len(data) - at < ECHO + 4:
            return 0 if self.word.startswith(data[at : at + 2]) else NO_PACKET
        found = self._head.match(data, at)
        if found is None or not data.startswith(_DATA, at + ECHO):
            return NO_PACKET
        first, last = range_of(data, at)
        return self._size(last - first + 1) if first <= last else NO_PACKET

    def intact(self, data: bytearray, at: int, size: int) -> bool:
        end = at + size - 1
        time = data[at + ECHO + 4 : at + HEAD]
        if data[end] != 0x0A or time[5] != 0x0A or time[4] != check_of(time[:4]):
            return False
        full = (end - at - HEAD) // (LINE + 2)
        rows = np.frombuffer(data, np.uint8, full * (LINE + 2), at + HEAD).reshape(full, LINE + 2)
        sums = (np.add.reduce(rows[:, :LINE], axis=1, dtype=np.int64) & 0x3F) + 0x30
        last = data[at + HEAD + rows.size : end]
        return bool(
            np.all(sums == rows[:, LINE])
            and np.all(rows[:, LINE + 1] == 0x0A)
            and (not last or (last[-1] == 0x0A and last[-2] == check_of(last[:-2])))
        )

    def headings(self, packets: Packets) -> Headings:
        return [BEGINS] * packets.count

    def stamps(self, packets: Packets) -> NDArray[np.int64]:
        begins = packet_offsets(packets.blocks)[:-1]
        times = b"".join([packets.data[at + ECHO + 4 : at + HEAD - 2] for at in begins])
        return values(np.frombuffer(times, np.uint8), 4)

    def samples_in(self, blocks: Iterable[Block]) -> int:
        # Of what ends the lines and the block, less remains than a sample.
        return sum((size - HEAD) * LINE // (LINE + 2) // self.characters * count for size, count in blocks)

    def other_record(self, data: bytearray, at: int) -> int:
        if len(data) - at < _RECORD:
            return 0 if self.word.startswith(data[at : at + 2]) else NO_PACKET
        status = data[at + ECHO : at + ECHO + 3]
        if self._head.match(data, at) is None or status == _DATA[:3] or check_of(status[:2]) != status[2]:
            return NO_PACKET
        return _RECORD if data[at + _RECORD - 1] == 0x0A else NO_PACKET


class StrengthFormat(DistanceFormat):
    """Blocks of ``ME``: distances and intensities."""

    name = "ME"
    response_type = 0x45
    word = b"ME"
    mode = "Intensity"
    characters = 6


def range_of(data: bytes | bytearray | memoryview, at: int = 0) -> tuple[int, int]:
    """The first and the last step of the block at `at`."""
    return int(data[at + 2 : at + 6]), int(data[at + 6 : at + 10])


def characters(block: bytes) -> NDArray[np.uint8]:
    """The characters of a block's values, without what ends the lines."""
    body = np.frombuffer(block, np.uint8)[HEAD:-1]
    full, rest = divmod(len(body), LINE + 2)
    lines = body[: len(body) - rest].reshape(full, LINE + 2)[:, :LINE].ravel()
    return np.concatenate((lines, body[-rest:-2])) if rest else lines


def values(text: NDArray[np.uint8], width: int) -> NDArray[np.int64]:
    """Numbers of so many characters each."""
    # Characters that none may be are kept within six bits: check characters do not exclude them.
    digits = (text.astype(np.int64) - 0x30 & 0x3F).reshape(-1, width)
    found: NDArray[np.int64] = digits @ (1 << 6 * np.arange(width - 1, -1, -1, dtype=np.int64))
    return found
