"""Packets of one size: many packets are checked as one array, and an 8-bit CRC by one look-up.

Most such packets are described by tables alone (`LayoutFormat`): the layout, how a packet begins, and the check
value.

A poll brings some ten packets, a file thousands. One by one, each costs some microseconds in Python; as rows of an
array, a few more cost nothing. A CRC is linear: what a byte adds to it depends only on the value and the place of
the byte. So a table of these (`Crc8.of_rows`) replaces the loop over the bytes.
"""

import re
from abc import abstractmethod
from functools import lru_cache
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from lidario.wire.blocks import Block
from lidario.wire.events import Packets
from lidario.wire.formats import NO_PACKET, Headings, StreamFormat, Stretch, headings_of


class RowFormat(StreamFormat):
    """A format whose packets all have the size `shortest`."""

    # From this many packets on, they are checked as one array. Measured: 2 to 4 us a packet one by one, 5 to 12 us
    # for up to 12 as an array. Live, a poll brings about 10, a port that is not polled one or two.
    worth_an_array: int = 4

    def run(self, data: bytearray, at: int) -> Stretch:
        """As `StreamFormat.run`; many packets are checked as one array."""
        count = (len(data) - at) // self.shortest
        if count < self.worth_an_array:
            return super().run(data, at)
        # Counting by numpy would take 10 us more live, where numpy is cold once a revolution.
        first = self._intact_rows(data, at, count).tobytes().find(0)
        whole = count if first < 0 else first
        end = at + whole * self.shortest
        return Stretch((Block(self.shortest, whole),) if whole else (), end, end)

    @abstractmethod
    def _intact_rows(self, data: bytearray, at: int, count: int) -> NDArray[np.bool_]:
        """Which of the `count` packets from `at` on are intact; all their bytes must be there."""


class Check(Protocol):
    """A check value that stands at the end of a packet."""

    def holds(self, data: bytearray, at: int) -> bool:
        """Whether it holds in the packet at `at`, which must be there whole."""
        ...

    def of_rows(self, rows: NDArray[np.uint8]) -> NDArray[np.bool_]:
        """In which packets it holds; `rows` has the shape (n, bytes of a packet)."""
        ...


class LayoutFormat(RowFormat):
    """A format whose packets have one layout. A subclass consists of tables.

    A packet may also say that the rotor is not up to speed, and then tells no angles. Such packets are records, and
    not lost packets of a healthy stream (`_turns`).
    """

    layout: np.dtype[Any]  # the fields of a packet: mostly an angle ``start``, and ``samples``
    # How a packet begins: the values that each of its first bytes may have, two bytes at least.
    marks: tuple[bytes, ...]
    check: Check  # its check value
    told_by: int = 2  # how many bytes show whether a packet begins; 0 for all bytes of a packet
    zero: int = 0  # value of the angle 0
    an_rpm: float  # one revolution a minute in the unit of the field ``speed``

    def __init__(self) -> None:
        super().__init__()
        self.shortest: int = self.layout.itemsize
        self.longest: int = self.shortest
        self.samples: int = self.layout["samples"].shape[0]
        sets = [b"[" + re.escape(values) + b"]" for values in self.marks]
        self.header: re.Pattern[bytes] = re.compile(b"".join(sets[:2]), re.DOTALL)
        # The marks, as far as their bytes have come.
        self._marks = re.compile(b"(?:\\Z|".join(sets) + b")" * (len(sets) - 1), re.DOTALL)
        self._marked = _tables_of(self.marks)

    @classmethod
    def angles_of(cls, rows: NDArray[Any]) -> NDArray[np.int32]:
        """The angles at which packets begin, in the unit of the headings."""
        angles: NDArray[np.int32] = (rows["start"].astype(np.int32) - cls.zero) % cls.full_turn
        return angles

    def measure(self, data: bytearray, at: int) -> int:
        size = self._begun(data, at, self.told_by or self.shortest)
        return size if size <= 0 or self._turns(data, at) else NO_PACKET

    def intact(self, data: bytearray, at: int, size: int) -> bool:  # noqa: ARG002
        return self.check.holds(data, at)

    def headings(self, packets: Packets) -> Headings:
        return headings_of(self.angles_of(np.frombuffer(packets.data, self.layout)))

    def other_record(self, data: bytearray, at: int) -> int:
        """As `StreamFormat.other_record`: a packet that says that the rotor is not up to speed."""
        size = self._begun(data, at, self.shortest)
        if size <= 0:
            return size
        return NO_PACKET if self._turns(data, at) or not self.check.holds(data, at) else size

    def _turns(self, data: bytearray, at: int) -> bool:  # noqa: ARG002 - most do not tell
        """Whether the packet at `at`, by its first `told_by` bytes, is one of a rotor that is up to speed."""
        return True

    def _turning(self, rows: NDArray[Any]) -> NDArray[np.bool_] | bool:  # noqa: ARG002
        """Which of many packets are of a rotor that is up to speed."""
        return True

    def _begun(self, data: bytearray, at: int, needed: int) -> int:
        """As `measure`, by the marks alone; waits until `needed` bytes are there."""
        if self._marks.match(data, at) is None:
            return NO_PACKET
        return self.shortest if len(data) - at >= needed else 0

    def _begin(self, raw: NDArray[np.uint8]) -> NDArray[np.bool_]:
        """Which packets begin with the marks; `raw` has the shape (packets, bytes)."""
        begun = self._marked[0][raw[:, 0]]
        for place, values in enumerate(self._marked[1:], 1):
            begun &= values[raw[:, place]]
        return begun

    def _intact_rows(self, data: bytearray, at: int, count: int) -> NDArray[np.bool_]:
        raw = np.frombuffer(data, np.uint8, count * self.shortest, at).reshape(count, -1)
        intact = self._begin(raw) & self.check.of_rows(raw)
        intact &= self._turning(raw.ravel().view(self.layout))
        return intact


@lru_cache(maxsize=64)
def _tables_of(marks: tuple[bytes, ...]) -> tuple[NDArray[np.bool_], ...]:
    """For each of the first bytes, a table of the values that it may have."""
    return tuple(np.isin(np.arange(256), list(values)) for values in marks)


@lru_cache(maxsize=256)
def row_begins(rows: int, step: int) -> NDArray[np.intp]:
    """Where each row begins, for ``reduceat``, which is twice as fast as a reduction along rows."""
    begins = np.arange(0, rows * step, step)
    begins.flags.writeable = False
    return begins


class Crc8:
    """An 8-bit CRC behind `size` bytes, with initial value 0 and not reflected."""

    def __init__(self, polynomial: int, size: int) -> None:
        self._table = bytes(_shifted(byte, polynomial) for byte in range(256))
        rows = [np.frombuffer(self._table, np.uint8)]
        while len(rows) < size:
            rows.append(rows[0][rows[-1]])
        # What each byte adds to the CRC, by its place and value: shape (size, 256).
        self._by_place = np.stack(rows[::-1])
        self._places = np.arange(size)

    def of(self, data: bytes | bytearray) -> int:
        """The check value of any bytes; 0 for bytes with their check value behind them."""
        table, value = self._table, 0
        for byte in data:
            value = table[value ^ byte]
        return value

    def holds(self, data: bytearray, at: int) -> bool:
        return self.of(data[at : at + len(self._places) + 1]) == 0

    def of_rows(self, rows: NDArray[np.uint8]) -> NDArray[np.bool_]:
        values = np.bitwise_xor.reduce(self._by_place[self._places, rows[:, :-1]], axis=1)
        holds: NDArray[np.bool_] = values == rows[:, -1]
        return holds


class Fold15:
    """A 15-bit check value over 16-bit words: for each word, the sum so far is doubled and the word added.

    At the end the carry is added once. Several makers of turrets for robot vacuums use it. A second carry is lost,
    so a single damaged bit is always found only in the last fourteen words. The check value is the word behind
    `words` words, little-endian.
    """

    def __init__(self, words: int) -> None:
        self._words = words
        # Bits above the lowest 30 do not reach the result of `_folded`.
        self._weights = np.array([1 << (words - 1 - place) & 0x3FFF_FFFF for place in range(words)], np.int64)

    def holds(self, data: bytearray, at: int) -> bool:
        end, value = at + 2 * self._words, 0
        for place in range(at, end, 2):
            value = (value << 1) + data[place] + (data[place + 1] << 8)
        return bool(_folded(value) == data[end] + (data[end + 1] << 8))

    def of_rows(self, rows: NDArray[np.uint8]) -> NDArray[np.bool_]:
        words = np.ascontiguousarray(rows).view("<u2").astype(np.int64)
        holds: NDArray[np.bool_] = _folded(words[:, :-1] @ self._weights) == words[:, -1]
        return holds


def _folded(value: Any) -> Any:
    return (value & 0x7FFF) + (value >> 15) & 0x7FFF


def _shifted(byte: int, polynomial: int) -> int:
    for _ in range(8):
        byte = (byte << 1 ^ polynomial) & 0xFF if byte & 0x80 else byte << 1
    return byte
