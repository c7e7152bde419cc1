"""Recordings that mean harm: MCAP made byte by byte from its specification, with claims that no recorder makes.

Nothing here is a random byte: each file is one idea of what a reader may believe, allocate, or wait for. Holes cost
no disk: a file is as large as it says, and has a few blocks.
"""

from __future__ import annotations

import json
import struct
from collections.abc import Callable, Iterable
from pathlib import Path
from zlib import crc32

from lidario.basics.model import DeviceInfo, ScanMode
from lidario.recording.about import About
from lidario.recording.chronicle import Responded, StreamBegan, StreamEvent, ZeroOffsetSet, text_of
from tests.support.cases import CASES

MAGIC = b"\x89MCAP0\r\n"
BEGAN_NS = 10**18
YEARS_NS = 1 << 62
MIB = 1 << 20
_CASE = next(case for case in CASES if "9k" in case.name)
_PIECE = 512

Part = bytes | int
"""Bytes of a file, or so many bytes of a hole."""


def record(opcode: int, content: bytes, length: int | None = None) -> bytes:
    """A record; `length` is what it claims, where that is not the truth."""
    return struct.pack("<BQ", opcode, len(content) if length is None else length) + content


def _text(text: str) -> bytes:
    data = text.encode()
    return struct.pack("<I", len(data)) + data


def metadata(texts: dict[str, str]) -> bytes:
    """A metadata record."""
    pairs = b"".join(_text(key) + _text(value) for key, value in texts.items())
    return record(0x0C, _text("lidario") + struct.pack("<I", len(pairs)) + pairs)


def channel(number: int, topic: str) -> bytes:
    """A channel without a schema."""
    return record(0x04, struct.pack("<HH", number, 0) + _text(topic) + _text("cdr") + struct.pack("<I", 0))


def message(number: int, at_ns: int, data: bytes) -> bytes:
    """A message of a channel."""
    return record(0x05, struct.pack("<HIQQ", number, 0, at_ns, at_ns) + data)


def chunk(records: bytes, crc: int | None = None, compression: str = "", claimed: int | None = None) -> bytes:
    """A chunk; without `crc` with the right one, and 0 says that there is none."""
    crc = crc32(records) if crc is None else crc
    size = len(records) if claimed is None else claimed
    head = struct.pack("<QQQI", 0, 0, size, crc) + _text(compression) + struct.pack("<Q", len(records))
    return record(0x06, head + records)


def _raw(data: bytes) -> bytes:
    return b"\0\1\0\0" + struct.pack("<B3xI", 0, len(data)) + data


def _event(event: StreamEvent | str) -> bytes:
    text = event if isinstance(event, str) else text_of(event)
    return b"\0\1\0\0" + struct.pack("<I", len(text) + 1) + text.encode() + b"\0"


_MODE = ScanMode(1, "Mode", _CASE.sample_us, 30.0, _CASE.response_type, typical=True)
_BEGAN = StreamBegan(
    0, b"\xa5\x60", _MODE, len(_CASE.packets[0]), _CASE.sample_us * 1e3, 1.0, 1_000_000, BEGAN_NS, 0.0
)
_INFO = DeviceInfo(_CASE.truth.family, "Model", 24, "1.02", 18, "AB" * 16)


def _about(*events: StreamEvent, **texts: str) -> bytes:
    about = About(_INFO, baudrate=1_000_000, clock_offset_ns=BEGAN_NS, events=events)
    return metadata({**about.as_texts(), **texts})


def _messages(times: Callable[[int], int] = lambda number: BEGAN_NS + number * 10_000_000) -> bytes:
    """A stream of some revolutions; `times` says when each piece came."""
    data = b"".join(_CASE.packets[: len(_CASE.packets) // 3])
    pieces = (data[at : at + _PIECE] for at in range(0, len(data), _PIECE))
    return b"".join(message(1, times(number), _raw(piece)) for number, piece in enumerate(pieces))


_CHANNELS = channel(1, "/lidar/raw") + channel(2, "/lidar/events")


def _honest(*more: Part) -> Iterable[Part]:
    """A recording, and something behind its only chunk."""
    return (MAGIC, record(0x01, bytes(8)), _about(_BEGAN), chunk(_CHANNELS + _messages()), *more)


def _events(*events: StreamEvent | str) -> Iterable[Part]:
    """A recording whose chronicle tells all this before the stream."""
    told = b"".join(message(2, BEGAN_NS, _event(event)) for event in events)
    return (MAGIC, _about(), chunk(_CHANNELS + told + message(2, BEGAN_NS, _event(_BEGAN)) + _messages()))


def _hole(opcode: int, size: int, times: int = 1) -> Iterable[Part]:
    """Records whose contents are a hole, in front of the chunk."""
    holes: list[Part] = [record(opcode, b"", size), size] * times
    return (MAGIC, *holes, _about(_BEGAN), chunk(_CHANNELS + _messages()))


def _long_text(opcode: int, size: int) -> Iterable[Part]:
    """A channel or metadata, whose text is a hole of that size."""
    head = struct.pack("<HH", 1, 0) if opcode == 0x04 else b""
    return (MAGIC, _about(_BEGAN), struct.pack("<BQ", opcode, size) + head + struct.pack("<I", size - 8), size)


def _zeros(size: int) -> Iterable[Part]:
    """A chunk without a check sum, whose records are a hole."""
    head = struct.pack("<QQQII", 0, 0, size, 0, 0) + struct.pack("<Q", size)
    return (MAGIC, _about(_BEGAN), record(0x06, head, len(head) + size), size, chunk(_CHANNELS + _messages()))


def _clock(times: Callable[[int], int], crc: int | None = None) -> Iterable[Part]:
    return (MAGIC, _about(_BEGAN), chunk(_CHANNELS + _messages(times), crc))


def _index(size: int) -> Iterable[Part]:
    """A footer that says that the index begins before a hole."""
    parts = list(_honest(record(0x0F, struct.pack("<I", 1))))
    begin = sum(part if isinstance(part, int) else len(part) for part in parts)
    return (*parts, size, record(0x02, struct.pack("<QQI", begin, 0, 1)), MAGIC)


def _times(number: int) -> int:
    return BEGAN_NS + number * 10_000_000


_WIDE = json.dumps({"event": "ended", "at": 1, "more": [[]] * 300_000})

ATTACKS: dict[str, Callable[[], Iterable[Part]]] = {
    **{
        f"ten records 0x{opcode:02X} of 256 MB": lambda opcode=opcode: _hole(opcode, 256 * MIB, 10)  # type: ignore[misc]
        for opcode in (*range(0x10), 0x80)
    },
    **{
        f"a text of {size} in a record 0x{opcode:02X}": lambda opcode=opcode, size=size: _long_text(opcode, size)  # type: ignore[misc]
        for opcode in (0x04, 0x0C)
        for size in (60_000, MIB, 16 * MIB, 256 * MIB)
    },
    "a chunk of zeros of 16 MB": lambda: _zeros(15 * MIB),
    "a chunk of zeros of 256 MB": lambda: _zeros(255 * MIB),
    "nothing but zeros": lambda: (MAGIC, 1 << 40),
    "zeros behind a chunk": lambda: _honest(1 << 40),
    "an index of zeros": lambda: _index(1 << 40),
    "newlines as events": lambda: (MAGIC, _about(events="\n" * MIB), chunk(_CHANNELS + _messages())),
    "lines as events": lambda: (MAGIC, _about(events="{}\n" * 300_000), chunk(_CHANNELS + _messages())),
    "a million letters in each field": lambda: (
        MAGIC, _about(_BEGAN, **dict.fromkeys(("model", "serial", "source", "baudrate"), "9" * 200_000)),
        chunk(_CHANNELS + _messages()),
    ),
    "an event of brackets": lambda: _events("[" * MIB),
    "an event of lists": lambda: _events(_WIDE),
    "an event with a number of a million digits": lambda: _events('{"event":"ended","at":' + "9" * MIB + "}"),
    "many responses": lambda: _events(*(Responded(struct.pack("<I", at), 4, bytes(9)) for at in range(2_000))),
    "many offsets": lambda: _events(_BEGAN, *(ZeroOffsetSet(at, float(at % 7)) for at in range(1_000))),
    "many empty records": lambda: (
        MAGIC, _about(_BEGAN), chunk(_CHANNELS + record(0x80, b"") * 30_000 + _messages())
    ),
    "many channels": lambda: (MAGIC, *(channel(at, "x" * 200) for at in range(4_000)), *_honest()),
    "a bomb": lambda: (MAGIC, _about(_BEGAN), chunk(bytes(1000), 0, "zstd", 1 << 50)),
    "a chunk that claims 4 EB": lambda: (MAGIC, _about(_BEGAN), record(0x06, bytes(60), 1 << 62)),
    "a message that claims 8 EB": lambda: (MAGIC, _about(_BEGAN), record(0x05, b"\0", 1 << 63)),
    "a name that claims 4 GB": lambda: (MAGIC, record(0x0C, struct.pack("<I", (1 << 32) - 1))),
    "texts that claim 4 GB": lambda: (MAGIC, record(0x0C, _text("lidario") + struct.pack("<I", (1 << 32) - 1))),
    "one time of 146 years": lambda: _clock(lambda number: _times(number) + YEARS_NS * (number == 20)),
    "from then on 146 years": lambda: _clock(lambda number: _times(number) + YEARS_NS * (number >= 20)),
    "a time before all others": lambda: _clock(lambda number: _times(number) * (number != 20)),
    "an hour between two pieces": lambda: _clock(lambda number: _times(number) + 3_600 * 10**9 * (number >= 20)),
    "a wrong check sum": lambda: _clock(_times, 1),
}  # fmt: skip
"""What each file tries, and its parts."""


def forge(path: Path, parts: Iterable[Part]) -> Path:
    """Write a file of bytes and holes."""
    with path.open("wb") as file:
        for part in parts:
            if isinstance(part, bytes):
                file.write(part)
            else:
                file.seek(part, 1)
        file.truncate()
    return path
