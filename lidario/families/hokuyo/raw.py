"""Recorded bytes of this family: a stream begins with its first block.

Where the bytes hold the response to ``PP``, it tells the field. Else the first and the last step do: each kind of
model has its own.
"""

from __future__ import annotations

import re
from typing import Final

from lidario.families.base import Decoder, Known, RawStream, raw_stream
from lidario.families.hokuyo.commands import read_lines
from lidario.families.hokuyo.decode import BlockDecoder
from lidario.families.hokuyo.device import FORMATS
from lidario.families.hokuyo.formats import range_of
from lidario.families.hokuyo.geometry import Geometry, geometry_of
from lidario.model import ScanMode
from lidario.wire.formats import StreamFormat

_USUAL: Final = {
    (44, 725): ("URG-04LX", Geometry(44, 725, 384, 1024, 20, 5600, 600)),
    (0, 1080): ("UST-10LX, UST-20LX or UTM-30LX", Geometry(0, 1080, 540, 1440, 20, 60_000, 2400)),
}
_BLOCK: Final = re.compile(rb"(M[DE])\d{8}01\d{3}\n99b\n")
_FIELD: Final = re.compile(rb"PP\n(00P\n(?:[^\n]{1,80}\n){1,40})\n")


def find_stream(data: memoryview, known: Known) -> RawStream | None:
    """The stream that begins with the first block; None without a block whose field is known."""
    found = _BLOCK.search(data)
    if found is None:
        return None
    begin, told = found.start(), _FIELD.search(data)
    lines = None if told is None else read_lines(told[1].rstrip(b"\n"))
    title, geometry = "", None if lines is None else geometry_of(lines.lines)
    if geometry is None:
        title, geometry = _USUAL.get(range_of(data, begin), ("", None))
    if geometry is None:
        return None
    kind = next(each for each in FORMATS if each.word == found[1])
    guess = "" if not title else f"taken for a {title}, by its first and last step: nothing else tells its field"
    return raw_stream(
        begin,
        kind(geometry),
        BlockDecoder(kind, geometry),
        known.sample_us or geometry.sample_us,
        title and f"Hokuyo {title}",
        guess,
        details=geometry.text,
    )


def stream_in(mode: ScanMode) -> tuple[StreamFormat, Decoder] | None:
    """As `Family.stream_in`: the mode tells the field, too."""
    kind = next((each for each in FORMATS if each.response_type == mode.response_type), None)
    told = (part.partition(":") for part in mode.details.split(";"))
    geometry = geometry_of({name: value for name, _, value in told})
    return None if kind is None or geometry is None else (kind(geometry), BlockDecoder(kind, geometry))
