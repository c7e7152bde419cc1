"""Recorded bytes of this family: where the measurement stream begins among them.

It begins behind the scan header (4ROS development manual, 3.1), or with the first intact packet where the header
was not recorded. What the samples mean, only the model tells: by the device information, where that was recorded
before the stream. Else it is the 4ROS, or the Tmini where a sample has three bytes. The bytes carry no time.
"""

from __future__ import annotations

import re
from typing import Final

from lidario.families.base import Decoder, RawStream, raw_stream
from lidario.families.ydlidar.clouds import KINDS
from lidario.families.ydlidar.formats import INFO_HEADER, PointCloud
from lidario.families.ydlidar.models import FOUR_ROS, MODELS, Model, model_of
from lidario.wire.formats import StreamFormat

__all__ = ["find_stream", "stream_of"]

_HEADER: Final = re.compile(rb"\xa5\x5a.{3}[\x40-\x7f]\x81", re.DOTALL)
"""The scan header; its length is to be ignored (manual 3.1)."""
_GUESSES: Final = (FOUR_ROS, MODELS["tmini"], MODELS["tmini-plus-sh"])
"""One model for each size of a sample."""
_LEAST_RATE: Final = 4000.0
"""Samples a second where the model has several rates: the slowest of them, so that no revolution is too long."""


def find_stream(data: memoryview, sample_us: float | None) -> RawStream | None:
    """As `Family.find_stream`: behind the header, or at the first intact packet."""
    best: tuple[int, Model] | None = None
    for guess in _GUESSES:
        wire = guess.kind.wire()
        # Only an earlier packet counts: without this bound a long file would be searched to its end.
        place = _first_packet(data if best is None else data[: best[0] + wire.longest], wire)
        if place is not None and (best is None or place < best[0]):
            best = place, guess
    if best is None:
        return None
    begin, model = best
    told = _told(data[:begin])
    if told is not None and told.kind.sample_size == model.kind.sample_size:
        model = told
    header = _HEADER.search(data[:begin])
    return raw_stream(
        begin if header is None else header.end(),
        model.kind.wire(),
        model.kind.decoder(),
        sample_us or model.sample_us or 1e6 / _LEAST_RATE,
    )


def _told(before: memoryview) -> Model | None:
    """The model that the device said it is, if that stands in these bytes."""
    at = bytes(before).rfind(INFO_HEADER)
    return model_of(before[at + len(INFO_HEADER)]) if 0 <= at < len(before) - len(INFO_HEADER) else None


def _first_packet(data: memoryview, wire: PointCloud) -> int | None:
    for found in wire.header.finditer(data):
        packet = bytearray(data[found.start() : found.start() + wire.longest])
        size = wire.measure(packet, 0)
        if 0 < size <= len(packet) and wire.intact(packet, 0, size):
            return found.start()
    return None


def stream_of(response_type: int) -> tuple[StreamFormat, Decoder] | None:
    """As `Family.stream_of`: by the number that lidario gives each kind."""
    kind = next((kind for kind in KINDS.values() if kind.response_type == response_type), None)
    return None if kind is None else (kind.wire(), kind.decoder())
