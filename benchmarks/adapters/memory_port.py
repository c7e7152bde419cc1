"""A serial port whose bytes are in memory: what the other drivers open, so that their parsers can be timed."""

from __future__ import annotations

import io
import time
from typing import Any

_HEALTH = bytes.fromhex("a55a0300000006000000")
_HEALTH_COMMANDS = (b"\xa5\x52", b"\xa5\x91")
_SCAN_COMMANDS = (b"\xa5\x20", b"\xa5\x82", b"\xa5\x60")


class EndOfStream(Exception):
    """Every byte was read."""


class MemorySerial:
    """Answers health requests, and a scan request with a stream.

    Class attributes, since the drivers make the object themselves:
        stream: What follows a scan request, from the descriptor on.
        began: When the first byte of it was asked for, by `time.perf_counter`.
    """

    stream = b""
    began = 0.0
    baudrate = 0

    def __init__(self, *_arguments: Any, **_options: Any) -> None:
        self._source = io.BytesIO()
        self._size = 0
        self.is_open = True
        self.dtr = self.rts = False
        self.port = "memory"

    def write(self, data: bytes) -> int:
        if data.startswith(_HEALTH_COMMANDS):
            self._source, self._size = io.BytesIO(_HEALTH), len(_HEALTH)
        elif data.startswith(_SCAN_COMMANDS):
            self._source, self._size = io.BytesIO(self.stream), len(self.stream)
            MemorySerial.began = 0.0
        return len(data)

    def read(self, size: int = 1) -> bytes:
        if not self.began:
            MemorySerial.began = time.perf_counter()
        data = self._source.read(size)
        if len(data) < size and not data:
            raise EndOfStream
        return data

    @property
    def in_waiting(self) -> int:
        left = self._size - self._source.tell()
        if not left:
            raise EndOfStream
        return left

    def inWaiting(self) -> int:  # noqa: N802 - pyserial's old name
        return self.in_waiting if self._size > len(_HEALTH) else self._size - self._source.tell()

    def setDTR(self, value: bool) -> None:  # noqa: N802 - pyserial's old name
        self.dtr = value

    def reset_input_buffer(self) -> None:
        """Nothing to forget: what follows a request comes after it."""

    def flush(self) -> None:
        """Nothing to write out."""

    flushInput = reset_input_buffer  # noqa: N815 - pyserial's old name
    close = flush
