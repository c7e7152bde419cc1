"""What a decoder holds, as a check value: two that hold the same go on in the same way.

So a file can be decoded in spans by several processes (`lidario.recording.divided`). Nobody has to say what
matters: it is all that `pickle` writes of the decoder. What is added later can make two decoders differ that are
alike, and never the other way round. Only totals are left out, and what counts from them is taken relative to them.
"""

from __future__ import annotations

import io
import os
import pickle
from dataclasses import replace
from hashlib import blake2b
from typing import Any

from lidario.families.pace import Pace
from lidario.revolution.clock import Beginning
from lidario.revolution.pipeline import Pipeline
from lidario.revolution.stats import AssemblerStats
from lidario.wire.arrived import ArrivedBytes
from lidario.wire.link import Link


def held(pipeline: Pipeline, *others: object) -> bytes:
    """The check value of all that it holds, and of what its user remembers beside."""
    written = io.BytesIO()
    try:
        _Writer(written, pipeline).dump((pipeline, others))
    except (pickle.PicklingError, TypeError, AttributeError, ValueError, RecursionError):
        # What is not known to the last bit is like nothing else; so are objects that hold each other.
        return os.urandom(16)
    return blake2b(written.getvalue(), digest_size=16).digest()


class _Writer(pickle.Pickler):
    """Writes what a pipeline holds; what counts from its totals is written relative to them."""

    def __init__(self, file: io.BytesIO, pipeline: Pipeline) -> None:
        super().__init__(file, pickle.HIGHEST_PROTOCOL)
        # Every object is written wherever it is held, whether or not it is held elsewhere too.
        self.fast = True
        self._stats, self._fed = pipeline.stats, pipeline.link.fed

    def persistent_id(self, value: Any) -> Any:
        """What is written in place of an object; None for the object itself."""
        match value:
            case Link():
                return {**vars(value), "fed": 0, "stream_at": 0, "stats": None}
            case AssemblerStats():
                return value.unfinished_packets, value.waiting_packets, value.left_off
            case Beginning():
                number = value.number - self._stats.scans - self._stats.missed_scans
                return replace(value, number=number, packets_before=value.packets_before - self._stats.all_packets)
            case ArrivedBytes():
                return [(size - self._fed, at_ns) for size, at_ns in value]
            case Pace():
                return value.back_from_now()
        return None
