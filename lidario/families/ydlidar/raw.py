"""Recorded bytes of this family: where the measurement stream begins among them.

It begins behind the scan header (4ROS development manual, 3.1), or with the first intact packet where the header
was not recorded: there is one format only. The bytes carry no time; a sample takes 50 us (data sheet).
"""

from __future__ import annotations

import re
from typing import Final

from lidario.families.base import Decoder, RawStream, raw_stream
from lidario.families.ydlidar.decode import PointCloudDecoder
from lidario.families.ydlidar.formats import PointCloud
from lidario.wire.formats import StreamFormat

__all__ = ["find_stream", "stream_of"]

_USUAL_US: Final = 50.0
_HEADER: Final = re.compile(rb"\xa5\x5a.{3}[\x40-\x7f]\x81", re.DOTALL)
"""The scan header; its length is to be ignored (manual 3.1)."""


def find_stream(data: memoryview, sample_us: float | None) -> RawStream | None:
    """As `Family.find_stream`: behind the header, or at the first intact packet."""
    wire = PointCloud()
    begin = _first_packet(data, wire)
    if begin is None:
        return None
    header = _HEADER.search(data[:begin])
    return raw_stream(begin if header is None else header.end(), wire, PointCloudDecoder(), sample_us or _USUAL_US)


def _first_packet(data: memoryview, wire: PointCloud) -> int | None:
    for found in wire.header.finditer(data):
        packet = bytearray(data[found.start() : found.start() + wire.longest])
        size = wire.measure(packet, 0)
        if 0 < size <= len(packet) and wire.intact(packet, 0, size):
            return found.start()
    return None


def stream_of(response_type: int) -> tuple[StreamFormat, Decoder] | None:
    """As `Family.stream_of`; there is one format."""
    return (PointCloud(), PointCloudDecoder()) if response_type == PointCloud.response_type else None
