"""Packets of one size: many of them are checked as one array, and a CRC of eight bits by one look-up.

A poll brings some ten packets, a file thousands. One by one, each costs some microseconds in Python; as rows of an
array, a few more cost nothing. A CRC is linear: each byte adds to it what its value and its place say, so a table
of that (`Crc8.of_rows`) replaces the loop over the bytes.
"""

from __future__ import annotations

from abc import abstractmethod
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lidario.wire.blocks import Block
from lidario.wire.formats import StreamFormat, Stretch

__all__ = ["Crc8", "Fold15", "RowFormat", "row_begins"]


class RowFormat(StreamFormat):
    """A format whose packets all have the size `shortest`.

    Attributes:
        worth_an_array: Packets from which they are checked as one array. Measured: 2 to 4 us a packet one by one, 5
            to 12 us for up to 12 as an array. Live, a poll brings about 10; a port that is not polled one or two.
    """

    worth_an_array: int = 4

    def run(self, data: bytearray, at: int) -> Stretch:
        """As `StreamFormat.run`; many packets are checked as one array."""
        count = (len(data) - at) // self.shortest
        if count < self.worth_an_array:
            return super().run(data, at)
        intact = self._intact_rows(data, at, count)
        whole = count if np.count_nonzero(intact) == count else int(intact.argmin())
        end = at + whole * self.shortest
        return Stretch((Block(self.shortest, whole),) if whole else (), end, end)

    @abstractmethod
    def _intact_rows(self, data: bytearray, at: int, count: int) -> NDArray[np.bool_]:
        """Which of the `count` packets from `at` on are intact; they are all there."""


@lru_cache(maxsize=256)
def row_begins(rows: int, step: int) -> NDArray[np.intp]:
    """Where each of so many rows begins, for ``reduceat``, which is twice as fast as to reduce along rows."""
    begins = np.arange(0, rows * step, step)
    begins.flags.writeable = False
    return begins


class Crc8:
    """A CRC of eight bits that begins at 0 and is not reflected.

    Args:
        polynomial: Its lower eight bits.
        size: Bytes that are checked by `of_rows`.
    """

    def __init__(self, polynomial: int, size: int) -> None:
        self._table = bytes(_shifted(byte, polynomial) for byte in range(256))
        rows = [np.frombuffer(self._table, np.uint8)]
        while len(rows) < size:
            rows.append(rows[0][rows[-1]])
        # What each byte adds to the CRC, by its place: shape (size, 256).
        self._by_place = np.stack(rows[::-1])
        self._places = np.arange(size)

    def of(self, data: bytes | bytearray) -> int:
        """The check value of any bytes; 0 for bytes with their check value behind them."""
        table, value = self._table, 0
        for byte in data:
            value = table[value ^ byte]
        return value

    def of_rows(self, rows: NDArray[np.uint8]) -> NDArray[np.uint8]:
        """The check value of each row; `rows` has the shape (n, size)."""
        values: NDArray[np.uint8] = np.bitwise_xor.reduce(self._by_place[self._places, rows], axis=1)
        return values


class Fold15:
    """A check value of fifteen bits over words of sixteen: each doubles what came before, and carries are added.

    Several makers of turrets for robot vacuums use it. What is carried twice is lost, so it finds each damaged bit
    of the last fourteen words only.

    Args:
        words: Words that are checked, little-endian; the check value is the next one.
    """

    def __init__(self, words: int) -> None:
        self._words = words
        # Whatever stands above 30 bits disappears below.
        self._weights = np.array([1 << (words - 1 - place) & 0x3FFF_FFFF for place in range(words)], np.int64)

    def holds(self, data: bytearray, at: int) -> bool:
        """Whether the words at `at` have the check value behind them."""
        end, value = at + 2 * self._words, 0
        for place in range(at, end, 2):
            value = (value << 1) + data[place] + (data[place + 1] << 8)
        return bool(_folded(value) == data[end] + (data[end + 1] << 8))

    def of_rows(self, rows: NDArray[np.uint8]) -> NDArray[np.bool_]:
        """Whether the check value of each row holds; `rows` has the shape (n, 2 * words + 2)."""
        words = np.ascontiguousarray(rows).view("<u2").astype(np.int64)
        holds: NDArray[np.bool_] = _folded(words[:, :-1] @ self._weights) == words[:, -1]
        return holds


def _folded(value: Any) -> Any:
    return (value & 0x7FFF) + (value >> 15) & 0x7FFF


def _shifted(byte: int, polynomial: int) -> int:
    for _ in range(8):
        byte = (byte << 1 ^ polynomial) & 0xFF if byte & 0x80 else byte << 1
    return byte
