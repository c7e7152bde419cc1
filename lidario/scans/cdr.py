"""CDR, the binary form of ROS 2 messages: four bytes that name the byte order, then the fields in order.

Each number is aligned to its own size, counted from behind those four bytes. A text is its length with the NUL that
ends it, then its bytes; a sequence is its length, then its elements. (OMG DDS-XTypes, plain CDR version 1.)

It is written by hand because a general encoder takes hundreds of times as long; the tests compare every message
with an independent one. `CdrReader` reads what others have sent: every length is compared with the bytes that are
there before anything is made of it.
"""

import struct
from typing import Final

import numpy as np
from numpy.typing import NDArray

from lidario.basics.arguments import printable

LITTLE_ENDIAN: Final = b"\0\1\0\0"  # the representation header of plain CDR with the lowest byte first

_ORDERS: Final = {b"\0\0": ">", b"\0\1": "<"}
_SECOND: Final = 1_000_000_000
_MOST_SECONDS: Final = (1 << 31) - 1
_LONGEST_TEXT: Final = 4096
"""Bytes of the longest text that is read; frames, names and units have a few dozen."""
_STAMP: Final = struct.Struct("<iI")
_LENGTH: Final = struct.Struct("<I")


class NotCdr(ValueError):
    """The bytes are no message of that type. Never leaves this package's parsers, which return None for it."""


def stamp_bytes(nanoseconds: int) -> bytes:
    """Nanoseconds since the Unix epoch as ``builtin_interfaces/Time``, which ends in 2038."""
    seconds, rest = divmod(nanoseconds, _SECOND)
    return _STAMP.pack(min(max(seconds, -_MOST_SECONDS), _MOST_SECONDS), rest)


class CdrWriter:
    """One message that is being written. For messages of few fields; the large ones pack theirs at once."""

    def __init__(self) -> None:
        self._data = bytearray()

    def align(self, size: int) -> None:
        """Fill up to a multiple of `size`."""
        self._data += bytes(-len(self._data) % size)

    def raw(self, data: bytes) -> None:
        """Bytes as they are."""
        self._data += data

    def byte(self, value: int) -> None:
        """One ``uint8``, ``byte`` or ``bool``."""
        self._data.append(value)

    def uint32(self, value: int) -> None:
        """One ``uint32``, or the length of a sequence."""
        self.align(4)
        self._data += _LENGTH.pack(value)

    def text(self, value: str) -> None:
        """One ``string``. A character that UTF-8 cannot carry becomes a question mark; a NUL would end the text."""
        data = value.encode("utf-8", "replace").replace(b"\0", b"?") + b"\0"
        self.uint32(len(data))
        self._data += data

    def header(self, stamp_ns: int, frame_id: str) -> None:
        """One ``std_msgs/Header``, at the begin of the message."""
        self._data += stamp_bytes(stamp_ns)
        self.text(frame_id)

    def finish(self) -> bytes:
        """The whole message."""
        return LITTLE_ENDIAN + self._data


class CdrReader:
    """One message that is being read, its first four bytes included, of either byte order.

    Raises:
        NotCdr: It has no such bytes. Every method raises it where the message ends too early.
    """

    def __init__(self, data: bytes) -> None:
        order = _ORDERS.get(data[:2])
        if order is None or len(data) < len(LITTLE_ENDIAN):
            raise NotCdr("no representation header of plain CDR")
        self.order: str = order
        self._data = memoryview(data)[len(LITTLE_ENDIAN) :]
        self._at = 0

    def take(self, size: int, align: int = 1) -> memoryview:
        """The next `size` bytes, at a multiple of `align`."""
        begin = self._at + -self._at % align
        if size < 0 or size > len(self._data) - begin:
            raise NotCdr(f"{size} bytes are announced, {len(self._data) - begin} are there")
        self._at = begin + size
        return self._data[begin : self._at]

    def uint32(self) -> int:
        """One ``uint32``."""
        value: int = struct.unpack(f"{self.order}I", self.take(4, 4))[0]
        return value

    def text(self) -> str:
        """One ``string``; what cannot be printed is left out."""
        size = self.uint32()
        if size > _LONGEST_TEXT:
            raise NotCdr(f"a text of {size} bytes")
        text = bytes(self.take(size)).rstrip(b"\0").decode("utf-8", "replace")
        return printable(text)

    def stamp_ns(self) -> int:
        """One ``builtin_interfaces/Time``, nanoseconds since the Unix epoch."""
        seconds, rest = struct.unpack(f"{self.order}iI", self.take(8, 4))
        return int(seconds) * _SECOND + int(rest)

    def float32(self) -> float:
        """One ``float32``."""
        value: float = struct.unpack(f"{self.order}f", self.take(4, 4))[0]
        return value

    def float_sequence(self) -> NDArray[np.float32]:
        """One ``float32[]``; a copy in the byte order of this machine."""
        count = self.uint32()
        return np.frombuffer(self.take(4 * count, 4), f"{self.order}f4").astype(np.float32)
