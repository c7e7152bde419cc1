"""What a decoder holds, as a check value: two that hold the same go on in the same way.

So a file can be decoded in spans by several processes (`lidario.recording.divided`). Nobody has to say what
matters: every field of every object is looked at. One that is added later can make two decoders differ that are
alike, and never the other way round. Only totals are left out, and what counts from them is taken relative to them.
"""

from __future__ import annotations

import os
import re
from collections import deque
from collections.abc import Iterator
from enum import Enum
from hashlib import blake2b
from types import FunctionType
from typing import Any, Final

import numpy as np

from lidario.families.pace import Pace
from lidario.revolution.clock import Beginning
from lidario.revolution.pipeline import Pipeline
from lidario.revolution.stats import AssemblerStats
from lidario.wire.arrived import ArrivedBytes
from lidario.wire.link import Link
from lidario.wire.stats import LinkStats

_STATES: Final = frozenset({"unfinished_packets", "waiting_packets", "left_off"})
_TOTALS: Final[dict[type, frozenset[str]]] = {
    Link: frozenset({"fed", "stream_at"}),
    LinkStats: frozenset(LinkStats.__slots__),
    AssemblerStats: frozenset(AssemblerStats.__slots__) - _STATES,
}


def held(pipeline: Pipeline, *others: object) -> bytes:
    """The check value of all that it holds, and of what its user remembers beside."""
    stats = pipeline.stats
    totals = {"number": stats.scans + stats.missed_scans, "packets_before": stats.all_packets}
    walk = _Walk(totals, pipeline.link.fed)
    found = blake2b(digest_size=16)
    for part in walk.over((pipeline, others)):
        found.update(part)
        found.update(b"\0")
    return found.digest()


class _Walk:
    """Goes through objects and what they hold.

    The fields of a `Beginning` count from `totals`, and places of bytes from `fed`.
    """

    def __init__(self, totals: dict[str, int], fed: int) -> None:
        self._totals, self._fed = totals, fed
        self._seen: dict[int, int] = {}

    def over(self, value: Any) -> Iterator[bytes]:
        """Every part of it."""
        if isinstance(value, bytes | bytearray):
            yield bytes(value)
        elif isinstance(value, Enum | re.Pattern | np.dtype | str | int | float | None):
            yield repr(value).encode()
        elif isinstance(value, np.ndarray | np.generic):
            yield f"{value.dtype}{value.shape}".encode()
            yield value.tobytes()
        elif isinstance(value, FunctionType | type):
            yield value.__qualname__.encode()
        elif isinstance(value, ArrivedBytes):
            yield repr([(size - self._fed, at_ns) for size, at_ns in value]).encode()
        elif isinstance(value, Pace):
            yield repr(value.back_from_now()).encode()
        elif isinstance(value, tuple | list | deque | dict):
            yield f"{type(value).__name__}{len(value)}".encode()
            for each in value.items() if isinstance(value, dict) else value:
                yield from self.over(each)
        elif id(value) in self._seen:
            yield f"as {self._seen[id(value)]}".encode()
        else:
            self._seen[id(value)] = len(self._seen)
            yield from self._fields(value)

    def _fields(self, value: Any) -> Iterator[bytes]:
        kind = type(value)
        # What is not ours is not known to the last bit: no two are alike, and none is like itself.
        yield kind.__qualname__.encode() if kind.__module__.startswith("lidario.") else os.urandom(16)
        slots = [name for each in kind.__mro__ for name in getattr(each, "__slots__", ()) if hasattr(value, name)]
        for name in (*slots, *getattr(value, "__dict__", ())):
            if name not in _TOTALS.get(kind, ()):
                here = getattr(value, name)
                yield name.encode()
                yield from self.over(
                    here - self._totals[name] if kind is Beginning and name in self._totals else here
                )
