"""The envelope of requests and responses.

A request is ``A5 cmd``, or ``A5 cmd length payload… checksum`` when bit 7 of the command is set in the
dialect that carries payloads; the checksum is the XOR of every byte before it (S-series interface manual,
"Request packets' format"; the fixed ``22`` printed there for EXPRESS_SCAN is that checksum for mode 0 alone).

A response begins with a descriptor of seven bytes: ``A5 5A``, a little-endian word whose low 30 bits are the
length of one packet and whose top 2 bits are the send mode (0 once, 1 for ever), and the response type
("Response descriptors' format"). The manuals of both families describe the same header. A descriptor has no
checksum, and its two magic bytes occur in scan data by chance. So it is believed only if it announces exactly the
response that was requested, as `Expected` describes it.

A response of text consists of lines: the echo of the request, the text of the device, and an empty line. The echo
shows to which request the response belongs. A device may send anything before it, for example the rest of a stream,
so an echo counts only at the beginning of a line.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import reduce
from operator import xor
from typing import TYPE_CHECKING, NamedTuple

from lidario.wire.events import Descriptor

if TYPE_CHECKING:
    from lidario.wire.formats import StreamFormat

REQUEST_MAGIC = 0xA5
DESCRIPTOR_MAGIC = b"\xa5\x5a"
DESCRIPTOR_SIZE = 7
_LENGTH_MASK = 0x3FFF_FFFF
_MODE_SHIFT = 30
_LINE_END = 0x0A


@dataclass(frozen=True, slots=True)
class Expected:
    """The response that a request asks for; anything else on the line is noise."""

    type: int  # response type of the descriptor
    size: int  # smallest plausible length, in bytes
    # Largest plausible length; 0 means exactly `size`. A descriptor that claims more is not believed.
    largest: int = 0
    continuous: bool = False  # True if a stream is expected
    # Bytes the payload must begin with (an echo of the request), so that a late response to an earlier request is
    # not taken for this one.
    prefix: bytes = b""
    # True if the response is lines of text without a descriptor: the echo `prefix`, and all up to the next empty
    # line, `largest` bytes at most. If the text between is `accepted`, a stream follows.
    lines: bool = False
    accepted: bytes = b""  # text between echo and empty line by which a device accepts a request for a stream


@dataclass(frozen=True, slots=True)
class Request:
    """One request: its bytes, the response it asks for, and the timing the device demands.

    A request with a `stream`, but without `expects`, begins a stream that is not announced: the next bytes belong
    to it. If a request that ends a stream has no bytes, only the host stops listening: the device is not told, and
    the host does not wait for a quiet line.
    """

    name: str  # the documents' name, for messages and logs
    data: bytes  # the encoded bytes
    expects: Expected | None = None  # the response, or None if the device gives none
    timeout: float = 1.0  # seconds to wait for the response
    settle: float = 0.0  # seconds the device needs after this request before it accepts the next
    attempts: int = 2  # how often to ask before giving up; more than 1 only if asking twice does no harm
    ends_stream: bool = False  # True if this request ends the device's stream (STOP, RESET)
    boots: bool = False  # True if the device restarts, and responds again only when it has booted (RESET)
    in_stream: bool = False  # True if it may be sent while packets flow, and does not affect them
    stream: StreamFormat | None = None  # format of the packets that follow, a fresh object for each start
    others: tuple[StreamFormat, ...] = ()  # formats that the descriptor may announce instead
    # How many packets of `stream` are the response of a device that streams unasked and announces nothing; 0 if the
    # response is another one, or there is none.
    packets: int = 0
    dtr: bool | None = None  # state of the control line DTR before the bytes are written; None to leave it as it is
    baudrate: int | None = None  # speed of the port before the bytes are written; None to leave it as it is
    acknowledged: bytes = b""  # bytes by which the device acknowledges it, though nobody waits for them

    def admits(self, descriptor: Descriptor) -> bool:
        """Whether `descriptor` announces the response to this request."""
        expects = self.expects
        expected = (
            expects is not None
            and descriptor.type == expects.type
            and expects.size <= descriptor.size <= max(expects.size, expects.largest)
            and descriptor.continuous == expects.continuous
        )
        return expected or (descriptor.continuous and self.announced_by(descriptor) is not None)

    def announced_by(self, descriptor: Descriptor) -> StreamFormat | None:
        """The format among `others` that the descriptor of a stream announces; None if there is none."""
        told = descriptor.type, descriptor.size
        return next((each for each in self.others if (each.response_type, each.shortest) == told), None)


def xor_bytes(data: bytes | bytearray) -> int:
    """XOR of all bytes; 0 for none."""
    return reduce(xor, data, 0)


def encode_request(command: int, payload: bytes | None = None) -> bytes:
    """The bytes of a request, with length and checksum when it has a payload."""
    if payload is None:
        return bytes((REQUEST_MAGIC, command))
    head = bytes((REQUEST_MAGIC, command, len(payload))) + payload
    return head + bytes((xor_bytes(head),))


def encode_descriptor(descriptor: Descriptor) -> bytes:
    """The bytes of a descriptor, as `parse_descriptor` reads them."""
    word = descriptor.size & _LENGTH_MASK | descriptor.continuous << _MODE_SHIFT
    return DESCRIPTOR_MAGIC + word.to_bytes(4, "little") + bytes((descriptor.type,))


def parse_descriptor(data: bytes | bytearray) -> Descriptor | None:
    """The descriptor in the first seven bytes, or None if they are none.

    Send modes 2 and 3 are reserved (S-series interface manual) and are not accepted.
    """
    if len(data) < DESCRIPTOR_SIZE or not data.startswith(DESCRIPTOR_MAGIC):
        return None
    word = int.from_bytes(data[2:6], "little")
    mode = word >> _MODE_SHIFT
    if mode > 1:
        return None
    return Descriptor(type=data[6], size=word & _LENGTH_MASK, continuous=mode == 1)


class Lines(NamedTuple):
    """A response of text, as far as it was found."""

    stray: int  # bytes before the response, which belong to no response
    size: int = 0  # bytes of the response, with echo and empty line
    payload: bytes | None = None  # the text between echo and empty line; None if the response is not complete


def find_lines(data: bytearray, expected: Expected) -> Lines:
    """Find the expected response in `data`. A response longer than `Expected.largest` is not waited for."""
    echo, at = expected.prefix, 0
    while True:
        place = data.find(echo, at)
        if place < 0:
            # The last bytes may be the first part of an echo, with the line end before it.
            return Lines(max(at, len(data) - len(echo)))
        at = place + 1
        if place and data[place - 1] != _LINE_END:
            continue
        begin = place + len(echo)
        end = data.find(b"\n\n", begin - 1)
        if place <= end <= place + expected.largest:
            return Lines(place, end + 2 - place, bytes(data[begin:end]))
        if end == -1 and len(data) - place <= expected.largest:
            return Lines(place)


def find_descriptor(data: bytearray, request: Request) -> tuple[int, Descriptor | None]:
    """How many bytes belong to no response, and the descriptor behind them; None if it has not come whole."""
    at = 0
    while True:
        place = data.find(DESCRIPTOR_MAGIC, at)
        if place < 0:
            # The last byte may be the first of the two.
            return len(data) - data.endswith(DESCRIPTOR_MAGIC[:1]), None
        if len(data) - place < DESCRIPTOR_SIZE:
            return place, None
        descriptor = parse_descriptor(data[place : place + DESCRIPTOR_SIZE])
        if descriptor is not None and request.admits(descriptor):
            return place, descriptor
        at = place + 1
