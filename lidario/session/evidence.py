"""What came back from a device that gave no answer: the first clue to what is wrong with it."""

from __future__ import annotations

from lidario.families.registry import FAMILIES
from lidario.wire.formats import StreamFormat

__all__ = ["Residue"]

_LIMIT = 4096
_MOSTLY = 0.9


class Residue:
    """A port tap that keeps the first bytes of each kind of silence.

    Attributes:
        total: Bytes that came in.
    """

    def __init__(self) -> None:
        self.total: int = 0
        self._kept = bytearray()

    def see(self, direction: str, data: bytes, now: int) -> None:  # noqa: ARG002
        """As `lidario.port.port.Tap`."""
        if direction == "in":
            self.total += len(data)
            self._kept += data[: _LIMIT - len(self._kept)]

    def verdict(self) -> str:
        """In words: nothing, zeros, packets of some family, or garbage."""
        if not self.total:
            return "nothing came back"
        if self._kept.count(0) >= _MOSTLY * len(self._kept):
            return f"{self.total} bytes came back, nearly all zero, as from a line that floats or a wrong baud rate"
        for family in FAMILIES:
            for kind in family.formats:
                stream_format = kind()
                count = _packets(self._kept, stream_format)
                if count > 1:
                    return (
                        f"{self.total} bytes came back, {family.title} packets among them: "
                        "it streams, but does not obey"
                    )
        return f"{self.total} bytes of garbage came back, as at a wrong baud rate"


def _packets(data: bytearray, stream_format: StreamFormat) -> int:
    at = count = 0
    while True:
        stretch = stream_format.next_stretch(data, at)
        if stretch.end == at:
            return count
        count += sum(block.packets for block in stretch.packets)
        at = stretch.end
