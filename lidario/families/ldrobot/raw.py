"""Recorded bytes of this family: there is no descriptor, so the stream begins with the first packets in a row."""

from __future__ import annotations

from lidario.families.base import Decoder, Known, RawStream, raw_stream
from lidario.families.ldrobot.decode import samples_a_second
from lidario.families.ldrobot.device import HEARD, KINDS, MODELS, model_of_rate
from lidario.families.ldrobot.formats import SIZE, PacketFormat
from lidario.families.unasked import LINKED
from lidario.wire.formats import StreamFormat

__all__ = ["find_stream", "stream_of"]


def find_stream(data: memoryview, known: Known) -> RawStream | None:
    """As `Family.find_stream`: at the first packets in a row; they tell the rate, and so the model."""
    wire = PacketFormat()
    for found in wire.header.finditer(data):
        begin = found.start()
        rows = bytearray(data[begin : begin + HEARD * SIZE])
        end = wire.run(rows, 0).end
        if end >= LINKED * SIZE:
            rate = samples_a_second(bytes(rows[:end]))
            model = MODELS[known.model] if known.model else model_of_rate(rate)
            sample_us = known.sample_us or 1e6 / (rate or model.rate)
            title = f"LDROBOT {model.title}"
            return raw_stream(begin, model.kind.wire(), model.kind.decoder(), sample_us, title, model.note)
    return None


def stream_of(response_type: int) -> tuple[StreamFormat, Decoder] | None:
    """Format and decoder by the number that lidario gives each kind; None for another number."""
    made = ((kind.wire(), kind.decoder) for kind in KINDS)
    return next(((wire, decoder()) for wire, decoder in made if wire.response_type == response_type), None)
