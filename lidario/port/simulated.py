"""A port with a simulated device at its other end.

There are four ways to it. ``via=pty`` (the default on Linux) is the whole path of a real device, through the kernel
and pyserial-asyncio; ``via=tcp`` is the same through a socket, ``via=udp`` (the default of Ethernet models) by
datagrams. ``via=memory`` hands the bytes over inside the event loop, on the loop's own clock, so that a test that
drives the loop's time drives the device with it. While a stream runs it is read as seldom as a line of the system:
bytes that come together show defects that bytes one by one do not.

An exception raised inside a simulated device, by a mistake in a user's world for instance, ends the line. It is the
cause of the `DeviceLost` that the receiver is told.
"""

import asyncio
from collections.abc import Callable
from contextlib import suppress
from math import radians
from typing import Final
from weakref import WeakValueDictionary

from lidario.basics.source import Source, quoted
from lidario.basics.system import cause_of
from lidario.errors import ConnectFailed, DeviceLost
from lidario.families.registry import family_of_simulated
from lidario.port.line import Line, Schedule
from lidario.port.port import Port
from lidario.port.reading import ALONE_SHARE
from lidario.port.serial import open_serial
from lidario.port.simulation import serial_of
from lidario.port.sockets import open_tcp, open_udp
from lidario.sim.device import SimulatedDevice
from lidario.sim.faults import Faults, parse_faults
from lidario.sim.memory import TICK_S, MemoryLine
from lidario.sim.rooms import make_world
from lidario.sim.serve import PtyServer, TcpServer, UdpServer, usual_way

_SERVERS: Final = {"pty": PtyServer, "tcp": TcpServer, "udp": UdpServer}


def make_device(source: Source) -> tuple[SimulatedDevice, Faults | None]:
    """The device that a ``sim://`` source describes, and what happens to its bytes on the way.

    Raises:
        ConnectFailed: With reason ``source``, for an unknown model, world or fault.
    """
    family = family_of_simulated(source.address)
    options = source.options
    try:
        seed = int(options.get("seed", "0"))
        world = None
        if "world" in options or "pose" in options:
            x, y, turned = map(float, options.get("pose", "0,0,0").split(","))
            world = make_world(options.get("world", "room"), seed=seed, pose=(x, y, radians(turned)))
        faults = parse_faults(options["fault"], seed=seed) if "fault" in options else None
        serial = serial_of(options.get("serial"))
        device = family.simulate(source.address, world=world, serial=serial, seed=seed)
    except ValueError as error:
        raise ConnectFailed(f"{quoted(source.text)}: {error}", reason="source") from error
    return device, faults


class Simulation:
    """A simulated device, and what serves it.

    Args:
        source: A ``sim://`` source.
        lasting: Whether it goes on until `end` while ports to it are closed and opened again. Else it ends with its
            only port, or when that cannot be opened.
    """

    def __init__(self, source: Source, *, lasting: bool) -> None:
        self._name = source.text
        self._ended = not lasting
        self._device, self._faults = make_device(source)
        self.server: PtyServer | TcpServer | UdpServer | None = None  # what serves it; None in memory
        self._ports = 0
        way = source.options.get("via") or usual_way(self._device)
        if way != "memory":
            try:
                self.server = _SERVERS[way](self._device, faults=self._faults)
            except OSError as error:
                raise ConnectFailed(
                    f"{quoted(self._name)} cannot be served: {cause_of(error)}. via=memory needs no such thing",
                    reason="missing",
                ) from error

    async def open(self) -> Port:
        """Open a line to it.

        Raises:
            ConnectFailed: The line could not be opened.
            DeviceLost: The simulated device failed already.
        """
        server = self.server
        if server is None:
            return connect_in_memory(self._device, self._faults, name=self._name)
        if server.unplugged:
            # Not tried: its name or address is free, and what stands there now may belong to another program.
            failed = self._why_lost()
            if failed is not None:
                raise failed from failed.__cause__
            raise ConnectFailed(f"{self._name}: the simulated device is unplugged and stays so", reason="missing")
        try:
            if isinstance(server, PtyServer):
                port = await open_serial(server.path, self._device.baudrate)
            elif isinstance(server, UdpServer):
                port = await open_udp(self._name, *server.address)
            else:
                port = await open_tcp(self._name, *server.address, baudrate=self._device.baudrate)
        except BaseException as error:
            failed = self._why_lost()
            if failed is not None and isinstance(error, ConnectFailed):
                raise failed from failed.__cause__
            raise
        port.name = self._name
        port.explain_loss = self._why_lost
        port.on_close = self._closed
        self._ports += 1
        return port

    def end(self) -> None:
        """Stop serving it, as soon as no port to it is open. Harmless when done before.

        Raises:
            RuntimeError: The device failed; the error is the cause.
        """
        self._ended = True
        if not self._ports and self.server is not None:
            self.server.close()

    def _closed(self) -> None:
        self._ports -= 1
        if self._ended:
            self.end()

    def _why_lost(self) -> DeviceLost | None:
        """The error of the device, if there was one. A server that goes on may be plugged in again."""
        server = self.server
        if server is None or not (self._ended or server.unplugged):
            return None
        try:
            server.close()
        except RuntimeError as error:
            return _failed(self._name, error.__cause__ or error)
        return None


def connect_in_memory(device: SimulatedDevice, faults: Faults | None = None, *, name: str = "memory") -> Port:
    """A port on `device`, without a kernel between them; needs a running event loop.

    Raises:
        ConnectFailed: Another session has it open (reason ``busy``), as with a serial port.
    """
    other = _LINES.get(id(device))
    if other is not None and other.is_open:
        raise ConnectFailed(
            "this simulated device is busy: another session has it open. Make a device for each session, or close "
            "the other one first",
            reason="busy",
        )
    port = Port(name, device.baudrate)
    line = _LINES[id(device)] = MemoryTransport(asyncio.get_running_loop(), port, MemoryLine(device, faults))
    port.connection_made(line)
    follow = getattr(device, "on_cable", None)
    if follow is not None:
        follow(line.see_soon)
    return port


def _failed(name: str, error: BaseException) -> DeviceLost:
    lost = DeviceLost(f"the simulated device {name} failed: {type(error).__name__}: {error}")
    lost.__cause__ = error
    return lost


class MemoryTransport(Line):
    """Carries bytes between a port and a device on the clock of the loop."""

    def __init__(self, loop: asyncio.AbstractEventLoop, port: Port, line: MemoryLine) -> None:
        self._loop = loop
        self._port = port
        self._line = line
        self._timer: asyncio.TimerHandle | None = None
        self._schedule: Schedule | None = None
        # As `open_serial` does. The device remembers the speed of the line before.
        if port.baudrate:
            self.set_baudrate(port.baudrate)
        self.set_dtr(False)

    @property
    def is_open(self) -> bool:
        """Whether a session may still use it; one whose event loop is closed cannot."""
        return not self.is_closing and not self._loop.is_closed()

    def write(self, data: bytes) -> None:
        self._tell(lambda now: self._line.write(data, now))

    def set_baudrate(self, baudrate: int) -> None:
        self._tell(lambda now: self._line.set_baudrate(baudrate, now))

    def set_dtr(self, asserted: bool) -> None:
        self._tell(lambda now: self._line.set_dtr(asserted, now))

    def close(self) -> None:
        self.end(None)

    def write_without_loop(self, data: bytes) -> None:
        self.write(data)

    def close_without_loop(self) -> None:
        self.is_closing: bool = True

    def set_polling(self, schedule: Schedule | None) -> None:
        self._schedule = schedule
        self._tell()

    def poll(self) -> None:
        self._deliver()

    def see_soon(self) -> None:
        """Look at the device in the next turn of the loop; from any thread."""
        with suppress(RuntimeError):  # the loop was closed
            self._loop.call_soon_threadsafe(self._deliver)

    def _tell(self, does: Callable[[int], None] | None = None) -> None:
        """Something reaches the device; it is read when it next has something to send that is needed."""
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None
        if self.is_closing:
            return
        now = self._port.now()
        try:
            if does is not None:
                does(now)
            due_ns = self._line.wakeup(now)
        except Exception as error:
            self.end(_failed(self._port.name, error))
            return
        if due_ns is None or self._loop.is_closed():
            return
        now_s, pause = now * 1e-9, TICK_S
        if (schedule := self._schedule) is not None:
            # As seldom as a line of the system is read.
            until = min(schedule.due - now_s, ALONE_SHARE * schedule.buffer_s)
            pause = max(pause, until if until > 0 else schedule.latency)
        self._timer = self._loop.call_at(max(due_ns * 1e-9, now_s + pause), self._deliver)

    def _deliver(self) -> None:
        """Hand over what the device has sent."""
        if self._port.is_forked or self.is_closing:
            return
        now = self._port.now()
        try:
            data = self._line.read(now)
            if self._line.unplugged(now):
                self.end(OSError("the line was unplugged"))
                return
        except Exception as error:
            self.end(_failed(self._port.name, error))
            return
        try:
            if data:
                self._port.data_received(data, now)
        finally:
            # Only now the schedule knows when what comes next is needed.
            self._tell()

    def end(self, error: Exception | None) -> None:
        """Have the port told that the line is gone; harmless when done before."""
        if self.is_closing:
            return
        self.is_closing = True
        if self._timer is not None:
            self._timer.cancel()
        if not self._loop.is_closed():
            self._loop.call_soon(self._port.connection_lost, error)


_LINES: WeakValueDictionary[int, MemoryTransport] = WeakValueDictionary()
"""The latest line to each device in memory, by the device's id, which stays its own as long as the line lives."""
