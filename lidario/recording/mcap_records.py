"""Reading the records of an MCAP file that anybody may have written, cut or damaged.

The package ``mcap`` is not used for reading: a file that was cut has no index, which that reader wants, and lengths
in a file are claims. Here no claim is believed beyond the bytes that are there, nothing is decompressed, and a
record that makes no sense ends the reading as the end of the file does. Recordings of ours are not compressed, so
of a chunk that was cut the whole messages are read too.

Records: an opcode, the length of the content in eight bytes, the content. All numbers are little-endian (MCAP
specification, "Serialization" and "Records").
"""

from __future__ import annotations

import struct
from collections.abc import Iterator
from typing import BinaryIO, NamedTuple

__all__ = ["MAGIC", "Channel", "Damage", "Message", "Metadata", "read_records"]

MAGIC = b"\x89MCAP0\r\n"
_HEAD = struct.Struct("<BQ")
_MESSAGE = struct.Struct("<HIQQ")
_CHUNK = struct.Struct("<QQQI")
_LENGTH32 = struct.Struct("<I")
_CHANNEL, _MESSAGE_OP, _CHUNK_OP, _METADATA, _DATA_END = 0x04, 0x05, 0x06, 0x0C, 0x0F
_LARGEST = 1 << 28
"""Longest record that is read, and never more than the file has left; a chunk of ours has some 100 kB."""
_MOST_PAIRS = 64


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
    """What follows cannot be read; `why` says it in words. It is the last record."""

    why: str


def read_records(file: BinaryIO) -> Iterator[Channel | Message | Metadata | Damage]:
    """The records of a file that begins with `MAGIC`, as far as they can be read. Raises only OSError.

    Args:
        file: Open for reading at its beginning; it can be sought in.
    """
    size = file.seek(0, 2)
    at = file.seek(len(MAGIC))
    while True:
        head = file.read(_HEAD.size)
        if len(head) < _HEAD.size:
            yield Damage("the file was cut")
            return
        opcode, length = _HEAD.unpack(head)
        at += _HEAD.size
        left = size - at
        if opcode == _DATA_END:
            return
        if opcode in (_CHANNEL, _MESSAGE_OP, _CHUNK_OP, _METADATA):
            content = memoryview(file.read(min(length, left, _LARGEST)))
            if opcode == _CHUNK_OP:
                inner, why = _chunk(content)
                yield from _inside(inner)
                if why:
                    yield Damage(why)
                    return
            elif len(content) == length:
                record = _record(opcode, content)
                if record is not None:
                    yield record
        if length > left:
            yield Damage("the file was cut")
            return
        if length > _LARGEST and opcode == _CHUNK_OP:
            yield Damage("it has a chunk too large to be ours")
            return
        at = file.seek(at + length)


def _chunk(content: memoryview) -> tuple[memoryview, str]:
    """The records in a chunk, and why they cannot be read where they are compressed."""
    if len(content) < _CHUNK.size + 4:
        return memoryview(b""), ""
    name = _text(content, _CHUNK.size)
    if name is None:
        return memoryview(b""), ""
    compression, at = name
    if compression:
        return memoryview(
            b""
        ), f"it is compressed ({compression[:16]!r}): `mcap decompress` makes a copy that is not"
    return content[at + 8 :], ""


def _inside(records: memoryview) -> Iterator[Channel | Message | Metadata]:
    at = 0
    while len(records) - at >= _HEAD.size:
        opcode, length = _HEAD.unpack_from(records, at)
        at += _HEAD.size
        if length > len(records) - at:
            return
        if opcode in (_MESSAGE_OP, _CHANNEL):
            record = _record(opcode, records[at : at + length])
            if record is not None:
                yield record
        at += length


def _record(opcode: int, content: memoryview) -> Channel | Message | Metadata | None:
    if opcode == _MESSAGE_OP:
        if len(content) < _MESSAGE.size:
            return None
        channel, _, at_ns, _ = _MESSAGE.unpack_from(content)
        return Message(channel, at_ns, content[_MESSAGE.size :])
    if opcode == _CHANNEL:
        topic = _text(content, 4)
        return None if topic is None else Channel(int.from_bytes(content[:2], "little"), topic[0])
    return _metadata(content)


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
