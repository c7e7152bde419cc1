"""Requests as lines of text, and the lines of responses.

A request is a word, its parameters in decimal digits, and a line feed. The response repeats it; then come a status
of two characters with a check character, lines of data, and an empty line. The check character is the sum of the
characters before it, its low six bits plus 30 hexadecimal (SCIP 2.0 specification). Lines of ``VV``, ``PP`` and
``II`` end in ``;``, which some devices count and others do not (urg_library 1.2.7); both are accepted.
"""

from typing import Final, NamedTuple

from lidario.basics.arguments import printable
from lidario.errors import RemoteProtocolError
from lidario.families.base import Script
from lidario.wire.envelope import Expected, Request
from lidario.wire.formats import StreamFormat

SETTLE_S: Final = 0.08
"""No document demands a pause. In this time the response to ``QT`` has come, behind a block that was under way."""
LONGEST: Final = 4096  # bytes of the longest response that is believed; ten lines of text in fact
_MOST_LINES: Final = 40
_LONGEST_LINE: Final = 80
_ATTEMPTS: Final = 3
OBEYED: Final = "00"
ACCEPTED: Final = b"00P"
SCIP_1: Final = b"E"
"""The response of a device that still speaks SCIP 1.1 to what it does not know (more_families_2.md 6.1)."""
TIME_MODE: Final = "0E"
"""The response to all but ``TM2`` while the clock is being adjusted, and to a word that is not known."""
_MEANINGS: Final = {
    TIME_MODE: "it does not know this request, or its clock is being adjusted",
    "0M": "its speed is not stable",
    "02": "it is in that state already",
}


def respond(request: bytes, payload: bytes) -> bytes:
    """The bytes of a response: the request again, the payload, and an empty line."""
    return request + payload + b"\n\n"


FILL: Final = Request("FILL", b"\n")
# Echo, status and an empty line come back.
STOP: Final = Request("QT", b"QT\n", settle=SETTLE_S, ends_stream=True, acknowledged=respond(b"QT\n", ACCEPTED))
RESET: Final = Request("RS", b"RS\n", settle=SETTLE_S, ends_stream=True, boots=True)


class Told(NamedTuple):
    """What a response tells."""

    status: str  # its two characters
    lines: dict[str, str]  # the text behind each name


def check_of(line: bytes | bytearray) -> int:
    """The check character of a line."""
    return (sum(line) & 0x3F) + 0x30


def read_lines(payload: bytes, *, came_twice: bool = False) -> Told | None:
    """What stands between the echo and the empty line; None where a check character is wrong.

    What `came_twice` is not damaged: that is how the device says it. Of an URG-04LX it is known that the check
    character of its serial number is wrong, and that a line without a name stands before it (ros-drivers/urg_c #4).
    """
    status, *rest = payload.split(b"\n")[:_MOST_LINES]
    if len(status) != 3 or check_of(status[:2]) != status[2]:
        return None
    lines: dict[str, str] = {}
    for line in rest:
        text = line[:-1]
        if not text or line[-1] not in (check_of(text), check_of(text.removesuffix(b";"))):
            if not came_twice:
                return None
            if b":" not in text:
                continue
        name, _, value = text[:_LONGEST_LINE].decode("latin-1").removesuffix(";").partition(":")
        lines[name.strip()] = printable(value.strip())
    return Told(status[:2].decode("latin-1"), lines)


def ask(word: str) -> Script[dict[str, str]]:
    """Ask for lines of text.

    Raises:
        RemoteProtocolError: The device refuses, or each response came damaged.
    """
    # An empty line first: it ends what another program, or another question, has left half written.
    request, payload = _request(word, b"\n" + word.encode() + b"\n"), b""
    for _ in range(_ATTEMPTS):
        before, payload = payload, (yield request)
        told = read_lines(payload, came_twice=payload == before)
        if told is not None and told.status == OBEYED:
            return told.lines
        if payload == SCIP_1:
            yield _request("SCIP2.0")
        elif told is not None and told.status == TIME_MODE:
            yield _request("TM2")
        elif told is not None:
            raise refusal(word, told.status)
    raise RemoteProtocolError(
        f"no response to {word} could be read: it was refused, or the line damages what it carries"
    )


def measure(word: str, first: int, last: int, wire: StreamFormat) -> Request:
    """Measure all steps from `first` to `last` for ever: no step is joined with another, no scan left out."""
    line = f"{word}{first:04}{last:04}01000"
    expected = Expected(
        wire.response_type, 0, 64, continuous=True, prefix=line.encode() + b"\n", lines=True, accepted=ACCEPTED
    )
    return Request(word, line.encode() + b"\n", expected, stream=wire)


def refusal(word: str, status: str) -> RemoteProtocolError:
    """The error that tells of a request which the device refuses."""
    meaning = _MEANINGS.get(status, "the manual of the device tells what that means")
    return RemoteProtocolError(f"the device refuses {word} with status {printable(status)!r}: {meaning}")


def _request(word: str, data: bytes = b"") -> Request:
    line = word.encode() + b"\n"
    return Request(word, data or line, Expected(line[1], 0, LONGEST, prefix=line, lines=True))


QUESTIONS: Final = (_request("VV", b"\nVV\n"),)
