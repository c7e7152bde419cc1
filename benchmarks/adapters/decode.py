"""Parsers of other drivers, timed on a stream in memory.

Each is opened through its own front door, with the port exchanged for one in memory; what it does before the
stream begins is not timed. A bare loop that reads five bytes at a time is timed too: it is the floor of every
parser that works so, and tells how fast the machine is at the moment.
"""

from __future__ import annotations

import asyncio
import contextlib
import time
from pathlib import Path
from typing import Any

import serial

from benchmarks.adapters.memory_port import EndOfStream, MemorySerial
from benchmarks.adapters.process import respond

serial.Serial = MemorySerial

from benchmarks.adapters.drivers import ASYNC, DRIVERS  # noqa: E402 - they must find the exchanged port

_UNBUFFERED = {"rplidar-roboticia": False, "rplidar": 0, "adafruit-circuitpython-rplidar": 0}


def _timed(name: str, mode: int) -> dict[str, float]:
    scans = samples = 0
    options = {"max_buf_meas": _UNBUFFERED[name]} if name in _UNBUFFERED else {}
    with contextlib.suppress(EndOfStream, RuntimeError):
        for count in DRIVERS[name]("memory", 1_000_000, mode, **options):
            scans += 1
            samples += count
    return {"seconds": time.perf_counter() - MemorySerial.began, "scans": scans, "samples": samples}


async def _count(name: str, result: dict[str, float]) -> None:
    async for count in ASYNC[name]("memory", 1_000_000, 0):
        result["scans"] += 1
        result["samples"] += count


def _timed_async(name: str) -> dict[str, float]:
    result = {"scans": 0.0, "samples": 0.0}
    with contextlib.suppress(EndOfStream, TimeoutError):
        asyncio.run(asyncio.wait_for(_count(name, result), 30))
    return {"seconds": time.perf_counter() - MemorySerial.began, **result}


def _floor() -> dict[str, float]:
    port = MemorySerial()
    port.write(b"\xa5\x20")
    port.read(7)
    samples = 0
    start = time.perf_counter()
    with contextlib.suppress(EndOfStream):
        while port.read(5):
            samples += 1
    return {"seconds": time.perf_counter() - start, "scans": 0, "samples": samples}


def main(task: dict[str, Any]) -> dict[str, Any]:
    MemorySerial.stream = Path(task["stream"]).read_bytes()
    name = task["contestant"]
    if name == "floor":
        return _floor()
    return _timed_async(name) if name in ASYNC else _timed(name, task["mode"])


if __name__ == "__main__":
    respond(main)
