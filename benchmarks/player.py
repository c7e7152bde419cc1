"""Plays devices on pseudo-terminals at true pace, in a process of its own: ``python -m benchmarks.player``.

The dialogue before a stream is held by the simulated device, which is as strict as a real one; the stream is
replayed from a recording, so that playing costs next to nothing beside the reading that is measured. Bytes are
delivered as a USB adapter does, 64 at a time, each delivery when its last byte has left the device; or, for many
devices at once, all there is every few milliseconds; or, to see how fast a reader is, faster than true. What the
terminal cannot take is lost, and counted. A pseudo-terminal takes 20 KiB; with ``--holds`` it takes no more than
the kernel does behind a real adapter. With ``--tcp`` a thread of it is the bridge that serves the terminal.

It is told what to do by its arguments, prints one line of JSON when all devices stand ready, and responds to each
line on its standard input with a report: when the last byte of each turn was written, on the clock that all
processes share, and what was lost. A report starts everything afresh. It ends with its standard input.
"""

from __future__ import annotations

import argparse
import contextlib
import fcntl
import json
import os
import select
import socket
import struct
import sys
import termios
import threading
import time
import tty
from typing import Any

from benchmarks.streams import RATES, Rate, Recording, recording

_IDLE_S = 0.05
_READ = 4096
_DELIVERY = 64
"""Bytes written at once."""


class Played:
    """One device on one pseudo-terminal."""

    def __init__(self, rate: Rate, every_ns: int, speed: int, holds: int) -> None:
        self._rate = rate
        self._flat_out = not speed
        self._holds = holds
        self._every_ns = every_ns
        self._recording: Recording = recording(rate.kind)
        self._bytes_per_s = len(self._recording.loop) * speed
        self.master, self.slave = os.openpty()
        tty.setraw(self.slave)
        os.set_blocking(self.master, False)
        self.path = os.ttyname(self.slave)
        self.renew()

    def renew(self) -> None:
        """Begin again with a device that knows nothing."""
        termios.tcflush(self.slave, termios.TCIOFLUSH)
        self._device: Any = self._rate.kind.device()
        self._said = b""
        self._source = b""
        self._place = 0
        self.written = 0
        self._began_ns = 0
        self._ends: tuple[int, ...] = ()
        self._next_end = 0
        self.playing = False
        self.lost = 0
        self.late_ns = self.active_ns = 0
        self.turns: list[int] = []

    def receive(self) -> None:
        """The host's bytes: while a stream is played, they go to a device that has just ended its own."""
        now = time.monotonic_ns()
        try:
            data = os.read(self.master, _READ)
        except BlockingIOError:
            return
        if self.playing:
            device = self._rate.kind.device()
            device.receive(data, now)
            if device.scanning:
                return  # a keepalive, or somebody very hasty: it goes on
            self.playing = False
            self._device, self._said = device, b""
        else:
            self._device.receive(data, now)

    def due(self, now: int) -> int | None:
        """When `send` has something to do; None while nothing is under way."""
        if not self.playing:
            at: int | None = self._device.wakeup(now)
            return at
        if self._flat_out:
            return None
        if self._every_ns:
            return self._began_ns + (now - self._began_ns) // self._every_ns * self._every_ns + self._every_ns
        return self._began_ns + (self.written + _DELIVERY) * 1_000_000_000 // self._bytes_per_s

    def send(self, now: int) -> None:
        """Write what has left the device by `now`."""
        if self.playing:
            if not self._flat_out:
                self._play(now)
            return
        data = self._device.transmit(now)
        if not data:
            return
        if self._device.scanning:
            # The descriptor may leave in two pieces; what stands behind it is not the simulated device's any more.
            descriptor = self._recording.descriptor
            said = self._said + data
            at = said.find(descriptor)
            if at >= 0:
                data = data[: at + len(descriptor) - len(self._said)]
                self._begin(now)
            self._said = said[1 - len(descriptor) :]
        self.write(data)

    def _begin(self, now: int) -> None:
        self.playing = True
        self._began_ns, self.written, self._place = now, 0, 0
        self._source, self._ends, self._next_end = self._recording.head, self._recording.head_ends, 0

    def _play(self, now: int) -> None:
        """Catch up with `now`: whole deliveries, or in one piece whatever is there."""
        ready = (now - self._began_ns) * self._bytes_per_s // 1_000_000_000 - self.written
        step = ready if self._every_ns else _DELIVERY
        self.active_ns = now - self._began_ns
        behind = ready * 1_000_000_000 // self._bytes_per_s - self._every_ns
        self.late_ns = max(self.late_ns, behind if self.written else 0)
        while ready >= step > 0:
            piece = self._piece(step)
            ready -= len(piece)
            self.written += len(piece)
            self.write(piece)

    @property
    def hungry(self) -> bool:
        """Whether it plays as fast as the reader reads."""
        return self.playing and self._flat_out

    def feed(self) -> None:
        """Write as much as the terminal takes."""
        source, place = self._source, self._place
        with contextlib.suppress(BlockingIOError):
            self._place += os.write(self.master, memoryview(source)[place : place + _READ])
        if self._place > place:
            self.written += self._place - place
            self.active_ns = time.monotonic_ns() - self._began_ns
        if self._place == len(source):
            self._source, self._place = self._recording.loop, 0

    def _piece(self, size: int) -> bytes:
        piece = self._source[self._place : self._place + size]
        self._place += len(piece)
        while self._next_end < len(self._ends) and self._ends[self._next_end] <= self._place:
            self.turns.append(time.monotonic_ns())
            self._next_end += 1
        if self._place == len(self._source):
            self._source, self._ends = self._recording.loop, self._recording.loop_ends
            self._place = self._next_end = 0
            if len(piece) < size:
                piece += self._piece(size - len(piece))
        return piece

    def write(self, data: bytes) -> None:
        """Send it, as far as the line holds it; the rest is lost."""
        if self._holds:
            # What stands in the terminal's own buffer, of which the kernel keeps one byte free; what is still on
            # its way there takes microseconds.
            (unread,) = struct.unpack("i", fcntl.ioctl(self.slave, termios.FIONREAD, bytes(4)))
            room = max(0, self._holds - 1 - unread)
            self.lost += len(data) - len(data[:room])
            data = data[:room]
        try:
            self.lost += len(data) - os.write(self.master, data)
        except BlockingIOError:
            self.lost += len(data)


class Bridge:
    """Serves a terminal over TCP, to one client after the other, as a serial-to-network bridge does."""

    def __init__(self, terminal: int) -> None:
        self._server = socket.create_server(("127.0.0.1", 0))
        self._terminal = terminal
        os.set_blocking(terminal, False)
        threading.Thread(target=self._serve, daemon=True).start()

    @property
    def source(self) -> str:
        """What opens it."""
        return f"tcp://127.0.0.1:{self._server.getsockname()[1]}"

    def _serve(self) -> None:
        while True:
            client, _ = self._server.accept()
            # Else each small piece waits until the one before is acknowledged, up to 40 ms (Nagle's algorithm).
            client.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            with client, contextlib.suppress(OSError):
                while self._carry(client):
                    pass

    def _carry(self, client: socket.socket) -> bool:
        """What came, both ways; False where the client has gone."""
        ready, _, _ = select.select([client.fileno(), self._terminal], [], [])
        if self._terminal in ready:
            client.sendall(os.read(self._terminal, _READ))
        if client.fileno() in ready:
            data = client.recv(_READ)
            os.write(self._terminal, data)
            return bool(data)
        return True


def _report(played: list[Played], cpu: float) -> dict[str, Any]:
    return {
        "turns": [each.turns for each in played],
        "lost_bytes": [each.lost for each in played],
        "written_bytes": [each.written for each in played],
        "active_s": [each.active_ns * 1e-9 for each in played],
        "late_ms": max(each.late_ns for each in played) / 1e6,
        "cpu_s": time.process_time() - cpu,
    }


def main(arguments: list[str] | None = None) -> None:
    """Play until standard input ends."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.player")
    parser.add_argument("rate", choices=sorted(RATES))
    parser.add_argument("--count", type=int, default=1)
    parser.add_argument("--every", type=float, default=0.0, help="seconds: write all there is that often instead")
    parser.add_argument("--speed", type=int, default=1, help="times the true pace; 0: as fast as it is read")
    parser.add_argument(
        "--holds", type=int, default=0, help="most bytes that lie unread; 0: what the terminal takes"
    )
    parser.add_argument("--tcp", action="store_true", help="behind a bridge to the network")
    options = parser.parse_args(arguments)
    every_ns = round(options.every * 1e9)
    rate = RATES[options.rate]
    played = [Played(rate, every_ns, options.speed, options.holds) for _ in range(options.count)]
    places = [Bridge(each.slave).source if options.tcp else each.path for each in played]
    print(json.dumps(places), flush=True)
    by_handle = {each.master: each for each in played}
    handles = [0, *by_handle]
    cpu = time.process_time()
    with contextlib.suppress(KeyboardInterrupt):
        while True:
            now = time.monotonic_ns()
            dues = [at for each in played if (at := each.due(now)) is not None]
            wait = min(max(0.0, (min(dues) - now) * 1e-9), _IDLE_S) if dues else _IDLE_S
            hungry = [each.master for each in played if each.hungry]
            readable, writable, _ = select.select(handles, hungry, [], wait)
            for handle in writable:
                by_handle[handle].feed()
            for handle in readable:
                if handle:
                    by_handle[handle].receive()
                elif not sys.stdin.readline():
                    return
                else:
                    print(json.dumps(_report(played, cpu)), flush=True)
                    cpu = time.process_time()
                    for each in played:
                        each.renew()
            now = time.monotonic_ns()
            for each in played:
                each.send(now)


if __name__ == "__main__":
    main()
