"""A bounded byte queue between the port and the parser.

Bytes are appended at the end and consumed at the front; nothing is copied before a whole packet is there.
The bound is a guarantee, not a policy: `Link` feeds the buffer in slices and consumes noise at once, so the
bound is only ever reached by a mistake in the parser, which should show at once and not as growing memory.
"""

from __future__ import annotations

__all__ = ["ReceiveBuffer"]


class ReceiveBuffer:
    """Bytes received and not yet understood, at most `limit` of them.

    Attributes:
        limit: The largest number of bytes it will hold.
        data: The bytes themselves, for parsers that read without copying; change it only through the methods.
    """

    __slots__ = ("data", "limit")

    def __init__(self, limit: int) -> None:
        self.limit: int = limit
        self.data: bytearray = bytearray()

    def __len__(self) -> int:
        return len(self.data)

    def append(self, chunk: bytes | bytearray | memoryview) -> None:
        """Add bytes at the end; raises OverflowError past the limit."""
        if len(chunk) + len(self.data) > self.limit:
            raise OverflowError(f"{len(chunk)} bytes do not fit: {len(self.data)} of {self.limit} are in use")
        self.data += chunk

    def find(self, pattern: bytes) -> int:
        """Offset of the first `pattern`, or -1."""
        return self.data.find(pattern)

    def peek(self, size: int, start: int = 0) -> bytes:
        """A copy of up to `size` bytes from `start`, which stay in the buffer."""
        return bytes(self.data[start : start + size])

    def skip(self, size: int) -> None:
        """Remove the first `size` bytes."""
        del self.data[:size]

    def clear(self) -> int:
        """Remove everything and return how many bytes that were."""
        count = len(self.data)
        self.data.clear()
        return count
