"""The serial number of a device, replaced by a hash wherever it stands: in texts, in responses, in raw bytes.

The same device gets the same hash in every report, so two reports of one device are known as such. Who knows a
serial number can tell whether a report is of that device; nobody can read the number off a report.

A hash looks like what it replaces. It has as many bytes, digits stay digits and letters letters, and the bytes have
the same sum, so that a check value that is a sum still holds and the responses can be read like all others.
"""

import hashlib
import re
from collections.abc import Iterable, Sequence
from typing import Final, NamedTuple

REACH: Final = 256
"""Longer than every serial number: whether a byte belongs to one is told by so many on either side of it."""

LEAST_PART: Final = 6
"""Bytes of a serial number that are replaced where they stand alone, as on a line that loses bytes; half of a
longer one. Fewer would be found by chance in packets, and damage them."""
_ANY: Final = (0, 255)
_ALIKE: Final = ((0x30, 0x39), (0x41, 0x5A), (0x61, 0x7A), (0, 9), (10, 0x1F))
"""ASCII digits, capitals, small letters, and digits that are sent as numbers; other bytes are no secret."""
_NUMBERS: Final = re.compile(r"(?:[0-9]|\[[0-9a-f]{2}\])+")


class Hidden(NamedTuple):
    """A serial number as it is shown and as it is sent, each with what stands in its place, as long."""

    text: str
    hashed: str
    sent: bytes
    instead: bytes

    def in_text(self, text: str) -> str:
        """The text with the hash."""
        return text.replace(self.text, self.hashed) if self.text else text

    def in_bytes(self, data: bytes) -> bytes:
        """The bytes with the hash; also where only a part of the number has come, not shorter than `LEAST_PART`."""
        size = max(LEAST_PART, len(self.sent) // 2)
        found = bytearray(data)
        for begin in range(len(self.sent) - size + 1):
            part, at = self.sent[begin : begin + size], -1
            while (at := data.find(part, at + 1)) >= 0:
                found[at : at + size] = self.instead[begin : begin + size]
        return bytes(found)


class Numbers:
    """Every serial number that a device has told so far; mostly one."""

    def __init__(self) -> None:
        self._all: dict[str, Hidden] = {}

    def add(self, serial: str, responses: Iterable[bytes]) -> None:
        """A number that is to be replaced from now on; the arguments are those of `hide`."""
        if serial not in self._all:
            self._all[serial] = hide(serial, responses)

    def in_text(self, text: str) -> str:
        """The text with the hashes."""
        for each in self._all.values():
            text = each.in_text(text)
        return text

    def in_bytes(self, data: bytes, before: bytes = b"", behind: bytes = b"") -> bytes:
        """The bytes of one read with the hashes, also where reads have divided a number.

        `before` and `behind` are `REACH` bytes as they came in front of it and behind it.
        """
        whole = before + data + behind
        for each in self._all.values():
            whole = each.in_bytes(whole)
        return whole[len(before) : len(before) + len(data)]


def hide(serial: str, responses: Iterable[bytes]) -> Hidden:
    """What is to stand in the place of a serial number, which the device information has.

    How the device sends it is told by its responses: as text, as a number for each digit, or as the bytes whose
    hexadecimal digits are shown.
    """
    came = b"\0\0".join(responses)
    text = serial.encode()
    if len(set(text)) < 2:
        # It was never written into the device, and is the same in all of them.
        return Hidden("", "", b"", b"")
    values = _values(serial)
    if text not in came and values is not None and values in came:
        instead = _hashed(values, [_alike(byte) for byte in values])
        return Hidden(
            serial, "".join(str(each) if each < 10 else f"[{each:02x}]" for each in instead), values, instead
        )
    digits = _digits(serial)
    if text not in came and digits is not None and digits in came:
        instead = _hashed(digits, [_ANY] * len(digits))
        shown = instead.hex()
        return Hidden(serial, shown.upper() if serial == serial.upper() else shown, digits, instead)
    instead = _hashed(text, [_alike(byte) for byte in text])
    return Hidden(serial, instead.decode(errors="replace"), text, instead)


def _values(serial: str) -> bytes | None:
    if _NUMBERS.fullmatch(serial) is None:
        return None
    return bytes(int(part.strip("[]"), 16) for part in re.findall(r"[0-9]|\[[0-9a-f]{2}\]", serial))


def _digits(serial: str) -> bytes | None:
    try:
        return bytes.fromhex(serial)
    except ValueError:
        return None


def _alike(byte: int) -> tuple[int, int]:
    return next((bounds for bounds in _ALIKE if bounds[0] <= byte <= bounds[1]), (byte, byte))


def _hashed(number: bytes, bounds: Sequence[tuple[int, int]]) -> bytes:
    """As many bytes, each within its bounds, with the same sum."""
    random = hashlib.shake_256(b"lidario report" + number).digest(len(number))
    found = [least + byte % (most - least + 1) for byte, (least, most) in zip(random, bounds, strict=True)]
    rest = sum(number) - sum(found)
    while rest:
        share = rest // len(found) or 1 if rest > 0 else -(-rest // len(found) or 1)
        for at, (least, most) in enumerate(bounds):
            moved = min(max(found[at] + (share if rest else 0), least), most)
            rest -= moved - found[at]
            found[at] = moved
    return bytes(found)
