"""A peer that behaves until it is told otherwise, then floods.

``python -m benchmarks.floods.attacker WAY KIND SECONDS ROUTER`` prints a source, and floods for so many seconds
when a line comes on its standard input. Only loopback is used.
"""

from __future__ import annotations

import asyncio
import os
import select
import socket
import sys
import time
import tty
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

import lidario
from benchmarks.floods.bytes import blob
from lidario.families.registry import family_of_simulated
from lidario.network.messages import MOST_ENTRIES, MOST_RAW_BYTES, Entry, encode_raw_message, encode_scan
from lidario.recording.chronicle import StreamBegan, text_of
from lidario.ros import Share
from lidario.sim.memory import MemoryLine
from lidario.testing import make_scan

MODEL = "rplidar-s2"
_STEP_S = 0.002
_DATAGRAM = 8192
_SEGMENT = 1400


class Peer:
    """A simulated lidar behind a descriptor; it ends where the flood begins."""

    def __init__(self, read: Callable[[], bytes], write: Callable[[bytes], Any]) -> None:
        self._line = MemoryLine(family_of_simulated(MODEL).simulate(MODEL, spin_up=0))
        self._read, self._write = read, write

    def serve(self) -> None:
        """Behave, until a line comes on standard input."""
        while not select.select([sys.stdin], [], [], _STEP_S)[0]:
            now = time.monotonic_ns()
            if data := self._read():
                self._line.write(data, now)
            if data := self._line.read(time.monotonic_ns()):
                self._write(data)


def flood(write: Callable[[bytes], Any], data: bytes, size: int, seconds: float) -> int:
    """Write pieces of that size as fast as they are taken; returns how many bytes."""
    end, sent, at = time.monotonic() + seconds, 0, 0
    while time.monotonic() < end:
        try:
            sent += write(data[at : at + size]) or 0
        except BlockingIOError:
            time.sleep(0.0002)
        except OSError:
            break  # the victim has hung up
        at = (at + size) % len(data)
    return sent


def by_tcp(kind: str, seconds: float) -> int:
    """A bridge."""
    with socket.create_server(("127.0.0.1", 0)) as server:
        print(f"tcp://127.0.0.1:{server.getsockname()[1]}?family=rplidar", flush=True)
        line, _ = server.accept()
        with line:
            Peer(lambda: _received(line), line.sendall).serve()
            line.setblocking(True)
            line.settimeout(1.0)
            return flood(line.send, blob(kind), 1 << 16, seconds)


def by_udp(kind: str, seconds: float, size: int = _DATAGRAM) -> int:
    """A lidar in the network."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as line:
        line.bind(("127.0.0.1", 0))
        print(f"udp://127.0.0.1:{line.getsockname()[1]}?family=rplidar", flush=True)
        data, host = line.recvfrom(4096)
        line.connect(host)
        first = [data]
        peer = Peer(lambda: first.pop() if first else _received(line), lambda data: _datagrams(line, data))
        peer.serve()
        return flood(line.send, blob(kind), size, seconds)


def by_pty(kind: str, seconds: float) -> int:
    """A terminal that is written at full speed."""
    ours, theirs = os.openpty()
    tty.setraw(theirs)
    os.set_blocking(ours, False)
    print(f"serial://{os.ttyname(theirs)}?family=rplidar&baud=1000000", flush=True)

    def read() -> bytes:
        try:
            return os.read(ours, 4096)
        except BlockingIOError:
            return b""

    Peer(read, lambda data: os.write(ours, data)).serve()
    return flood(lambda data: os.write(ours, data), blob(kind), 4096, seconds)


async def by_zenoh(way: str, kind: str, seconds: float, router: str) -> int:
    """A publisher, under the key that a session or a fleet reads."""
    raw = kind.startswith("raw")
    async with (
        lidario.open_lidar(lidario.simulate(MODEL, spin_up=0)) as lidar,
        Share(lidar, "flood/scan", raw=raw, router=router) as share,
    ):
        publishing = asyncio.create_task(share.run())
        key = "fleet:flood/*" if way == "fleet" else "zenoh:flood/scan"
        print(f"{key}?router={router}", flush=True)
        await asyncio.to_thread(sys.stdin.readline)
        # Its own messages go on: raw bytes are taken while a stream runs.
        sent = await asyncio.to_thread(_publish, share, kind, seconds)
        publishing.cancel()
        await asyncio.wait([publishing])
        return sent


def _publish(share: Any, kind: str, seconds: float) -> int:
    """Flood with the connection of a publisher."""
    outlet, zenoh = share._outlet, share._bus._session  # noqa: SLF001
    end, sent, number = time.monotonic() + seconds, 0, 0
    payload = _events(share) if kind == "raw-events" else _payload(kind)
    while time.monotonic() < end:
        number += 1
        if kind == "tokens":
            token = zenoh.liveliness().declare_token(f"flood/scan/@lidario/alive/raw/{number % 5000}/a/b")
            token.undeclare()
        elif kind == "status":
            share._status.send(payload)  # noqa: SLF001
        else:
            outlet.send(payload)
        sent += len(payload)
    return sent


def _events(share: Any) -> bytes:
    """Streams that begin, as many as a message may hold."""
    began = next(event for event in share._about().events if isinstance(event, StreamBegan))  # noqa: SLF001
    texts = [text_of(replace(began, at=number)).encode() for number in range(MOST_ENTRIES)]
    return encode_raw_message(
        [Entry(True, 0, text) for text in texts[: MOST_RAW_BYTES // (len(texts[-1]) + 16) - 1]]
    )


def _payload(kind: str) -> bytes:
    now = time.monotonic_ns()
    if kind == "scan":
        return encode_scan(make_scan([0.0], [1.0]))
    if kind == "scan-large":
        return encode_scan(make_scan(np.linspace(0, 6.28, 100_000), np.ones(100_000)))
    if kind == "status":
        return b'{"form": "raw", "about": {' + b'"a": "b", ' * 20_000 + b'"c": "d"}}'
    if kind == "raw-entries":
        return encode_raw_message([Entry(False, now, b"")] * MOST_ENTRIES)
    if kind == "raw-nodes":
        data = blob("endless", MOST_ENTRIES * 84)[: MOST_ENTRIES * 21]
        return encode_raw_message([Entry(False, now, data[at : at + 21]) for at in range(0, len(data), 21)])
    if kind.startswith("raw-"):
        data = blob(kind.removeprefix("raw-"), 16384)
        return encode_raw_message([Entry(False, now, data)])
    return b""


def _received(line: socket.socket) -> bytes:
    line.setblocking(False)
    try:
        return line.recv(4096)
    except BlockingIOError:
        return b""
    finally:
        line.setblocking(True)


def _datagrams(line: socket.socket, data: bytes) -> None:
    for at in range(0, len(data), _SEGMENT):
        line.send(data[at : at + _SEGMENT])


def main(arguments: list[str]) -> None:
    """Behave, then flood."""
    way, kind, seconds, router = arguments[0], arguments[1], float(arguments[2]), arguments[3]
    if way == "tcp":
        sent = by_tcp(kind, seconds)
    elif way in ("udp", "udp-tiny"):
        sent = by_udp(kind, seconds, _DATAGRAM if way == "udp" else 16)
    elif way == "pty":
        sent = by_pty(kind, seconds)
    else:
        sent = asyncio.run(by_zenoh(way, kind, seconds, router))
    print(sent, flush=True)


if __name__ == "__main__":
    main(sys.argv[1:])
