"""Recorded bytes of this family: there is no descriptor, so the stream begins with the first packets in a row."""

from __future__ import annotations

from lidario.families.base import Decoder, RawStream, raw_stream
from lidario.families.ldrobot.decode import PacketDecoder, TriangleDecoder, samples_a_second
from lidario.families.ldrobot.device import HEARD, model_of_rate
from lidario.families.ldrobot.formats import SIZE, PacketFormat, TriangleFormat
from lidario.families.unasked import LINKED
from lidario.wire.formats import StreamFormat

__all__ = ["find_stream", "stream_of"]


def find_stream(data: memoryview, sample_us: float | None) -> RawStream | None:
    """As `Family.find_stream`: at the first packets in a row; they tell the rate, and so the model."""
    wire = PacketFormat()
    for found in wire.header.finditer(data):
        begin = found.start()
        rows = bytearray(data[begin : begin + HEARD * SIZE])
        end = wire.run(rows, 0).end
        if end >= LINKED * SIZE:
            rate = samples_a_second(bytes(rows[:end]))
            if model_of_rate(rate).triangle:
                return raw_stream(begin, TriangleFormat(), TriangleDecoder(), sample_us or 1e6 / (rate or 2300))
            return raw_stream(begin, wire, PacketDecoder(), sample_us or 1e6 / rate)
    return None


def stream_of(response_type: int) -> tuple[StreamFormat, Decoder] | None:
    """As `Family.stream_of`."""
    if response_type == TriangleFormat.response_type:
        return TriangleFormat(), TriangleDecoder()
    return (PacketFormat(), PacketDecoder()) if response_type == PacketFormat.response_type else None
