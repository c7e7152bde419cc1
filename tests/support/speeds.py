"""A line that garbles what is sent at one speed and read at another, as a serial line does.

In memory and pseudo-terminals carry bytes, not levels, so nothing there tells that a client uses the wrong speed.
Here bytes become the levels of the wire and are sampled by the other side's clock.
"""

import asyncio
import struct
from operator import itemgetter
from typing import Any

import pytest

from lidario.port.diagnose import busy
from lidario.port.port import Port
from lidario.port.simulated import MemoryTransport
from lidario.session.finding.discovery import PortInfo
from lidario.sim.memory import MemoryLine
from lidario.sim.serve import PtyServer

_TCGETS2 = 0x802C542A
_SPEED_AT = 40
_REQUEST = 0xA5


def misread(data: bytes, sent_at: int, read_at: int) -> bytes:
    """What a receiver at `read_at` baud makes of bytes sent back to back at `sent_at` baud, 8N1."""
    if sent_at == read_at:
        return data
    bit_time, at, seen = sent_at / read_at, 0.0, bytearray()
    # Tables and no inner loop: the thread of a device that streams meanwhile must keep up on a busy machine.
    resting = b"\1" * (int(10 * bit_time) + 1)
    levels = b"".join([b"\1", *map(_LEVELS.__getitem__, data), resting])
    samples = itemgetter(*(int((1.5 + bit) * bit_time) for bit in range(8)))
    while (start := levels.find(b"\1\0", int(at)) + 1) > 0:
        seen.append(_BYTES[samples(levels[start : start + len(resting)])])
        at = start + 9.5 * bit_time
    return bytes(seen)


_LEVELS = [bytes((0, *(byte >> bit & 1 for bit in range(8)), 1)) for byte in range(256)]
"""Start bit, eight bits, stop bit."""
_BYTES = {tuple(byte >> bit & 1 for bit in range(8)): byte for byte in range(256)}


class Written(list[tuple[int, bytes]]):
    """All that was written, with the speed at which it was."""

    def __init__(self) -> None:
        self.garbled: set[int] = set()  # places of what was still under way when the line got another speed

    def came_whole(self, data: bytes) -> bool:
        """Whether these bytes were not garbled when they were written last."""
        return max(place for place, (_, each) in enumerate(self) if each == data) not in self.garbled


class _SpeedPort(Port):
    """A port that notes what is garbled by another speed."""

    def __init__(self, path: str, baudrate: int, written: Written) -> None:
        super().__init__(path, baudrate)
        self._written = written
        self.sent_ns = 0

    def set_baudrate(self, baudrate: int) -> None:
        if baudrate not in (0, self.baudrate) and self.now() < self.sent_ns:
            self._written.garbled.add(len(self._written) - 1)
        super().set_baudrate(baudrate)


class _SpeedLine(MemoryLine):
    """A line in memory whose host has a speed of its own."""

    def __init__(self, device: Any, port: _SpeedPort, written: Written) -> None:
        super().__init__(device)
        self._port = port
        self._written = written

    def write(self, data: bytes, now: int) -> None:
        self._written.append((self._port.baudrate, data))
        self._port.sent_ns = now + len(data) * 10 * 10**9 // self._port.baudrate
        super().write(misread(data, self._port.baudrate, self.device.baudrate), now)

    def read(self, now: int) -> bytes:
        return misread(super().read(now), self.device.baudrate, self._port.baudrate)


def serial_in_memory(patch: pytest.MonkeyPatch, **devices: Any) -> Written:
    """Have serial ports of these names lead to these devices, on the clock of the loop; each can be open once.

    Returns everything that is written to them, with the speed at which it is written; it grows.
    """
    written = Written()
    ports: dict[str, _SpeedPort] = {}

    async def open_serial(path: str, baudrate: int) -> Port:
        if path in ports and ports[path].is_open:
            raise busy(path)
        port = ports[path] = _SpeedPort(path, baudrate, written)
        line = _SpeedLine(devices[path], port, written)
        port.connection_made(MemoryTransport(asyncio.get_running_loop(), port, line))
        return port

    patch.setattr("lidario.session.finding.connect.open_serial", open_serial)
    return written


def plugged_in(patch: pytest.MonkeyPatch, adapter: str = "CP2102", **devices: Any) -> Written:
    """The same, and have the system list these ports, with that adapter; "" for one that nobody knows."""
    ports = [PortInfo(path, "", adapter, "") for path in devices]
    patch.setattr("lidario.session.finding.discovery.list_serial_ports", lambda: ports)
    return serial_in_memory(patch, **devices)


class SpeedPtyServer(PtyServer):
    """A simulated device on a pseudo-terminal that minds the speed its client has set.

    On a busy machine it may come to its turn late, when the client has changed the speed since it wrote. When
    the speed has changed and several requests are read together, they are lost, since nobody can tell at which
    speed each was written.
    """

    _speed = 0

    @property
    def client_speed(self) -> int:
        """Bits a second."""
        import fcntl  # not on Windows, where the rest of this module is needed

        state = fcntl.ioctl(self._slave, _TCGETS2, bytes(44))
        return int(struct.unpack_from("<I", state, _SPEED_AT)[0])

    def _receive(self, readable: list[Any]) -> bytes:
        speed_before, self._speed = self._speed, self.client_speed
        data = super()._receive(readable)
        if speed_before not in (0, self._speed) and data.count(_REQUEST) > 1:
            return b""
        return misread(data, self._speed, self.device.baudrate)

    def _send(self, data: bytes) -> int:
        heard = misread(data, self.device.baudrate, self.client_speed)
        taken = super()._send(heard)
        return taken if heard == data else len(data)
