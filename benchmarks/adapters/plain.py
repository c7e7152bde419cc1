"""The reader one writes in an afternoon: pyserial-asyncio, a buffer, a loop over whole packets.

It is the baseline for asyncio: everything here is as simple as it can be and still deliver every point, so what
it costs is the waking up for each delivery and not a clever parser.
"""

from __future__ import annotations

import asyncio
import struct
from collections.abc import AsyncIterator
from typing import Any

import serial_asyncio

_START = {"dense": bytes.fromhex("a582050100000000") + b"\x23", "nodes": b"\xa5\x20", "points": b"\xa5\x60"}


class _Reader(asyncio.Protocol):
    def __init__(self, form: str) -> None:
        self.scans: asyncio.Queue[int] = asyncio.Queue()
        self._cut = {"dense": self._dense, "nodes": self._nodes, "points": self._points}[form]
        self._buffer = bytearray()
        self._scan: list[tuple[float, float]] = []
        self._last = 0.0
        self._skip = 7

    def data_received(self, data: bytes) -> None:
        self._buffer += data
        if self._skip and len(self._buffer) >= self._skip:
            del self._buffer[: self._skip]
            self._skip = 0
        if not self._skip:
            self._cut()

    def _turn(self, begins: bool) -> None:
        if begins and self._scan:
            self.scans.put_nowait(len(self._scan))
            self._scan = []

    def _dense(self) -> None:
        buffer = self._buffer
        while len(buffer) >= 84:
            start, *distances = struct.unpack_from("<41H", buffer, 2)
            angle = (start & 0x7FFF) / 64
            self._turn(angle < self._last)
            self._last = angle
            self._scan += [(angle + index * 0.1125, mm / 1000) for index, mm in enumerate(distances)]
            del buffer[:84]

    def _nodes(self) -> None:
        buffer = self._buffer
        whole = len(buffer) // 5 * 5
        for first, angle, distance in struct.iter_unpack("<BHH", buffer[:whole]):
            self._turn(bool(first & 1))
            self._scan.append((angle / 128, distance / 4000))
        del buffer[:whole]

    def _points(self) -> None:
        buffer = self._buffer
        while len(buffer) >= 10 and len(buffer) >= 10 + 2 * buffer[3]:
            count = buffer[3]
            first, last = (word / 128 for word in struct.unpack_from("<HH", buffer, 4))
            step = (last - first) % 360 / max(count - 1, 1)
            self._turn(bool(buffer[2] & 1))
            distances = struct.unpack_from(f"<{count}H", buffer, 10)
            self._scan += [(first + index * step, mm / 1000) for index, mm in enumerate(distances)]
            del buffer[: 10 + 2 * count]


async def plain(port: str, baudrate: int, form: str) -> AsyncIterator[int]:
    """Points of each revolution."""
    loop = asyncio.get_running_loop()
    made: Any = await serial_asyncio.create_serial_connection(loop, lambda: _Reader(form), port, baudrate=baudrate)
    transport, reader = made
    transport.write(_START[form])
    while True:
        yield await reader.scans.get()
