"""Reading the records of an MCAP file that anybody may have written, cut or damaged.

The package ``mcap`` is not used for reading: a file that was cut has no index, which that reader wants, and lengths
in a file are claims. Here no claim is believed beyond the bytes that are there and beyond what a record of its kind
can be, and nothing is decompressed. Recordings of ours are not compressed, so of a chunk that was cut the whole
messages are read too.

Three check sums tell of damage: that of each chunk, that of all bytes in front of the index, and that of the index.
A chunk whose sum is wrong is left out, since no length in it can be believed; what follows is read. The others only
tell that something was changed. A sum of 0 says that there is none.

Records: an opcode, the length of the content in eight bytes, the content. All numbers are little-endian (MCAP
specification, "Serialization" and "Records").
"""

import struct
from collections.abc import Generator, Iterator
from typing import NamedTuple
from zlib import crc32

from lidario.recording.opened import StoredFile

MAGIC = b"\x89MCAP0\r\n"
_HEAD = struct.Struct("<BQ")
_MESSAGE = struct.Struct("<HIQQ")
_CHUNK = struct.Struct("<QQQI")
_LENGTH32 = struct.Struct("<I")
_FOOTER = struct.Struct("<BQQQI")
_NONE, _FOOTER_OP, _CHANNEL, _MESSAGE_OP, _CHUNK_OP, _METADATA, _DATA_END = 0x00, 0x02, 0x04, 0x05, 0x06, 0x0C, 0x0F
_LARGEST = {_CHANNEL: 1 << 16, _MESSAGE_OP: 1 << 24, _CHUNK_OP: 1 << 24, _METADATA: 1 << 20}
"""Longest records that are read. A chunk of ours has some 100 kB, and 12 MiB at most (`lidario.recording.write`);
other programs make chunks of 4 MiB."""
_PASSED_OVER = 1 << 20  # longest record that is read for the check sum alone
_LONGEST_INDEX = 1 << 28  # an index grows by some 200 bytes a second: this is that of two weeks
_BLOCK = 1 << 16
_MOST_PAIRS = 64
_COMPRESSED = ("zstd", "lz4")

CUT = "the file was cut"
CHANGED = "a chunk is damaged, and was left out"
_JOINED = "what stands behind its end was left out"
TOO_LARGE = "a record is too large to be ours, and was left out"


class Channel(NamedTuple):
    """Names what the messages of one number are."""

    number: int
    topic: str


class Message(NamedTuple):
    """One message; `at_ns` is its time in the file."""

    channel: int
    at_ns: int
    data: memoryview


class Metadata(NamedTuple):
    """A named set of texts."""

    name: str
    texts: dict[str, str]


class Damage(NamedTuple):
    """Something cannot be read, or was changed."""

    # What is wrong, in words. There are few of them, whatever the file.
    why: str
    # Whether messages may be missing here. Those that follow it are whole.
    missing: bool = True


class _Index(NamedTuple):
    """What the end of a file says."""

    channels: tuple[Channel, ...] = ()
    crc: int = 0
    is_whole: bool = False


def read_records(file: StoredFile) -> Iterator[Channel | Message | Metadata | Damage]:
    """The records of a file, as far as they can be read. Raises only RecordingError."""
    file.seek(0)
    if file.read(len(MAGIC)) != MAGIC:
        yield Damage("it does not begin as an MCAP file", missing=False)
        return
    index = _read_index(file)
    # A channel is told in one chunk; where that is damaged, the index knows it.
    yield from index.channels
    file.seek(len(MAGIC))
    crc: int | None = crc32(MAGIC)
    while True:
        head = file.read(_HEAD.size)
        if len(head) < _HEAD.size:
            yield Damage(CUT)
            return
        opcode, length = _HEAD.unpack(head)
        behind = file.at + length
        if opcode == _DATA_END:
            file.seek(behind)
            yield from _end(file, index, crc)
            return
        if opcode in (_NONE, _FOOTER_OP):
            yield Damage("what follows makes no sense")
            return
        content = _content(file, opcode, length)
        is_whole = len(content) == length
        crc = crc32(content, crc32(head, crc)) if is_whole and crc is not None else None
        if not (yield from _record(opcode, head, content, is_whole)):
            return
        if behind > file.size:
            yield Damage(CUT)
            return
        if not is_whole and opcode in _LARGEST:
            yield Damage(TOO_LARGE, missing=opcode in (_MESSAGE_OP, _CHUNK_OP))
        file.seek(behind)


def _content(file: StoredFile, opcode: int, length: int) -> bytes:
    """What a record has behind its head, where that is not too long; of a chunk that was cut what is there."""
    largest = _LARGEST.get(opcode, _PASSED_OVER)
    if length <= min(largest, file.left):
        return file.read(length)
    return file.read(largest) if opcode == _CHUNK_OP and length > file.left else b""


def _record(
    opcode: int, head: bytes, content: bytes, is_whole: bool
) -> Generator[Channel | Message | Metadata | Damage, None, bool]:
    """What one record tells; returns whether to go on, as `_chunk`."""
    if opcode == _CHUNK_OP:
        return (yield from _chunk(memoryview(content), is_whole))
    if is_whole and opcode == _METADATA:
        if (found := _metadata(memoryview(content))) is not None:
            yield found
    elif is_whole and opcode in _LARGEST:
        yield from _inside(memoryview(head + content))
    return True


def _end(file: StoredFile, index: _Index, crc: int | None) -> Iterator[Damage]:
    """What is wrong with the file as a whole, at the end of its data."""
    if not index.is_whole:
        # The index is looked for at the end of the file, where that of another one stands if two were joined.
        yield Damage(_JOINED if _goes_on(file) else "its index is cut or damaged", missing=False)
    elif index.crc and crc is not None and crc != index.crc:
        yield Damage("bytes outside of its chunks were changed", missing=False)


def _goes_on(file: StoredFile) -> bool:
    """Whether more follows behind the end of the index that begins here."""
    block, most = b"", file.at + _LONGEST_INDEX
    while file.left and file.at < most:
        block = block[1 - len(MAGIC) :] + file.read(_BLOCK)
        if (at := block.find(MAGIC)) >= 0:
            return at + len(MAGIC) < len(block) or file.left > 0
    return False


def _read_index(file: StoredFile) -> _Index:
    """The channels in the index, and the check sum of the data, which stands in front of it."""
    tail = _FOOTER.size + len(MAGIC)
    file.seek(max(len(MAGIC), file.size - tail))
    data = file.read(tail)
    if len(data) < tail or not data.endswith(MAGIC):
        return _Index()
    opcode, length, begin, _, told = _FOOTER.unpack_from(data)
    end = file.size - tail
    data_end = (begin or end) - _HEAD.size - _LENGTH32.size
    is_there = opcode == _FOOTER_OP and length == 20 and data_end >= len(MAGIC)
    if not is_there or not 0 <= end - (begin or end) <= _LONGEST_INDEX:
        return _Index()
    file.seek(data_end)
    ending = file.read(_HEAD.size + _LENGTH32.size)
    if _HEAD.unpack_from(ending) != (_DATA_END, _LENGTH32.size):
        return _Index()
    channels: tuple[Channel, ...] = ()
    crc = 0
    while file.at < end:
        block = file.read(min(_BLOCK, end - file.at))
        if file.at - len(block) == begin:
            channels = tuple(record for record in _inside(memoryview(block)) if isinstance(record, Channel))
        crc = crc32(block, crc)
    if told and crc32(data[: _FOOTER.size - _LENGTH32.size], crc) != told:
        return _Index()
    return _Index(channels, _LENGTH32.unpack_from(ending, _HEAD.size)[0], is_whole=True)


def _chunk(content: memoryview, is_whole: bool) -> Generator[Channel | Message | Damage, None, bool]:
    """The records in a chunk; of one that was cut those that are there, unchecked.

    Returns whether to go on: where one is compressed, which only another program can read, all are.
    """
    name = _text(content, _CHUNK.size) if len(content) >= _CHUNK.size else None
    if name is None or len(content) < name[1] + 8:
        if is_whole:
            yield Damage(CHANGED)
        return True
    _, _, size, crc = _CHUNK.unpack_from(content)
    if name[0] in _COMPRESSED:
        yield Damage(f"it is compressed ({name[0]!r}): `mcap decompress` makes a copy that is not")
        return False
    told = int.from_bytes(content[name[1] : name[1] + 8], "little")
    records = content[name[1] + 8 :]
    if not is_whole:
        yield from _inside(records)
    elif name[0] or not size == told == len(records) or (crc and crc32(records) != crc):
        yield Damage(CHANGED)
    elif (yield from _inside(records)) != len(records):
        # Without a check sum, or made to harm.
        yield Damage("a chunk makes no sense, and the rest of it was left out")
    return True


def _inside(records: memoryview) -> Generator[Channel | Message, None, int]:
    """The channels and messages in these bytes; returns where the last whole record ends."""
    at = 0
    while len(records) - at >= _HEAD.size:
        opcode, length = _HEAD.unpack_from(records, at)
        begin = at + _HEAD.size
        if opcode == _NONE or length > len(records) - begin:
            break
        if opcode == _MESSAGE_OP:
            if length >= _MESSAGE.size:
                channel, _, at_ns, _ = _MESSAGE.unpack_from(records, begin)
                yield Message(channel, at_ns, records[begin + _MESSAGE.size : begin + length])
        elif opcode == _CHANNEL:
            topic = _text(records[begin : begin + length], 4)
            if topic is not None:
                yield Channel(int.from_bytes(records[begin : begin + 2], "little"), topic[0])
        at = begin + length
    return at


def _metadata(content: memoryview) -> Metadata | None:
    name = _text(content, 0)
    if name is None or len(content) - name[1] < _LENGTH32.size:
        return None
    at = name[1] + _LENGTH32.size
    texts: dict[str, str] = {}
    while at < len(content) and len(texts) < _MOST_PAIRS:
        key = _text(content, at)
        value = None if key is None else _text(content, key[1])
        if key is None or value is None:
            return None
        texts[key[0]] = value[0]
        at = value[1]
    return Metadata(name[0], texts)


def _text(content: memoryview, at: int) -> tuple[str, int] | None:
    """The text at this place and where it ends; None when there is none."""
    if len(content) - at < _LENGTH32.size:
        return None
    (length,) = _LENGTH32.unpack_from(content, at)
    begin = at + _LENGTH32.size
    if length > len(content) - begin:
        return None
    return str(content[begin : begin + length], "utf-8", "replace"), begin + length
