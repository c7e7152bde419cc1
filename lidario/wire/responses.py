"""Where in the bytes of a device a response begins: one of bytes by its descriptor, one of text by its echo.

Text is lines: the echo of the request, what the device says, and an empty line. The echo tells whose response it
is, and a device may say anything before it, as the rest of a stream, so an echo counts at the beginning of a line
alone.
"""

from __future__ import annotations

from typing import NamedTuple

from lidario.wire.envelope import DESCRIPTOR_MAGIC, DESCRIPTOR_SIZE, Expected, Request, parse_descriptor
from lidario.wire.events import Descriptor

_LINE_END = 0x0A


class Lines(NamedTuple):
    """A response of text, as far as it was found.

    Attributes:
        stray: Bytes before the response, which belong to none.
        size: Bytes of the response behind them, with echo and empty line.
        payload: What stands between these two; None where the response is not complete.
    """

    stray: int
    size: int = 0
    payload: bytes | None = None


def find_lines(data: bytearray, expected: Expected) -> Lines:
    """The response that is expected, if `data` has it. No more than `Expected.largest` bytes are waited for."""
    echo, at = expected.prefix, 0
    while True:
        place = data.find(echo, at)
        if place < 0:
            # What is left may be the first part of an echo, with the end of the line before it.
            return Lines(max(0, len(data) - len(echo)))
        at = place + 1
        if place and data[place - 1] != _LINE_END:
            continue
        begin = place + len(echo)
        end = data.find(b"\n\n", begin - 1)
        if place <= end <= place + expected.largest:
            return Lines(place, end + 2 - place, bytes(data[begin:end]))
        if end < 0 and len(data) - place <= expected.largest:
            return Lines(place)


def find_descriptor(data: bytearray, request: Request) -> tuple[int, Descriptor | None]:
    """How many bytes belong to no response, and the descriptor behind them; None where it has not come whole."""
    at = 0
    while True:
        place = data.find(DESCRIPTOR_MAGIC, at)
        if place < 0:
            # The last byte may be the first of the two.
            return len(data) - data.endswith(DESCRIPTOR_MAGIC[:1]), None
        if len(data) - place < DESCRIPTOR_SIZE:
            return place, None
        descriptor = parse_descriptor(bytes(data[place : place + DESCRIPTOR_SIZE]))
        if descriptor is not None and request.admits(descriptor):
            return place, descriptor
        at = place + 1
