"""An open line to a device: serial port, TCP connection or simulator, with one face.

pyserial-asyncio lives here and nowhere else, and so do its habits, which end at this door: it reads a kilobyte
at a time, writes only when the loop comes round again, and calls `connection_lost` before it closes the port.
Here a write reaches the operating system before `write` returns, since the STOP of a program that is being
torn down has no other moment; and `close` returns when the port is closed.

While a stream runs, waking up for each of a thousand deliveries a second costs more than all the decoding.
`set_latency` makes the port look only every few milliseconds and take all that is there; and while whoever reads
knows that nothing urgent can come, at whatever latency, less often still. The terminal's buffer holds 4 KiB, 48 ms
of the fastest stream, so nothing is lost by it.

Every exception of the operating system or of pyserial leaves as one of `lidario.errors`.
"""

from __future__ import annotations

import asyncio
import contextlib
import os
import select
from collections.abc import Callable
from typing import Any, Protocol

import serial
import serial_asyncio

from lidario.errors import ConnectFailed, DeviceLost
from lidario.port.diagnose import busy, holders, is_pseudo_terminal, why_not_opened

__all__ = ["Port", "Receiver", "Tap", "open_serial", "open_tcp"]

CONNECT_TIMEOUT_S = 5.0
CLOSE_TIMEOUT_S = 2.0
_READ_SIZE = 65536
_TIMER_S = 0.001
"""How late timers may be: the loop waits in whole milliseconds, rounded up."""

Tap = Callable[[str, bytes, int], None]
"""Sees every chunk: ``"in"`` or ``"out"``, the bytes, the time in nanoseconds."""


Rest = Callable[[float], float]
"""Told how late a look at the port came, says how long to wait before the next; 0 for as usual."""


class Receiver(Protocol):
    """Who is told what the port brings."""

    def data_received(self, data: bytes, now: int) -> None:
        """Bytes arrived at `now`, monotonic nanoseconds."""
        ...

    def connection_lost(self, error: DeviceLost | None) -> None:
        """The port is dead, or closed as asked (None). Called once."""
        ...


class Port(asyncio.Protocol):
    """One open line.

    Attributes:
        name: What was opened, for messages.
        baudrate: Speed in bits a second; 0 where there is none.
        taps: Called with every chunk in either direction, in order; they must be quick and not raise.
    """

    def __init__(self, name: str, baudrate: int = 0) -> None:
        self.name = name
        self.baudrate = baudrate
        self.taps: list[Tap] = []
        self._loop = asyncio.get_running_loop()
        self._receiver: Receiver | None = None
        self._transport: asyncio.Transport | None = None
        self._closed = self._loop.create_future()
        self._on_close: Callable[[], None] | None = None
        self._closing = False

    @property
    def is_open(self) -> bool:
        """Whether bytes can still be written."""
        return self._transport is not None and not self._transport.is_closing()

    @property
    def is_closing(self) -> bool:
        """Whether it is closed, or about to be."""
        return self._closing

    def attach(self, receiver: Receiver | None) -> None:
        """Name who is told what arrives from now on; None for nobody."""
        self._receiver = receiver

    def write(self, data: bytes) -> None:
        """Hand bytes to the operating system, at once as far as it takes them; ignored on a dead port."""
        if self.is_open and self._transport is not None:
            for tap in self.taps:
                tap("out", data, self._now())
            if self._loop.is_closed():
                self._write_without_loop(data)
            else:
                self._transport.write(data)

    def set_baudrate(self, baudrate: int) -> None:
        """Change the speed of the line.

        Raises:
            ConnectFailed: The adapter cannot do that speed.
        """
        device = self._transport.get_extra_info("serial") if self._transport else None
        if device is not None:
            try:
                device.baudrate = baudrate
                device.reset_input_buffer()
            except (OSError, ValueError) as error:
                raise ConnectFailed(
                    f"{self.name} cannot run at {baudrate} baud: {error}", reason="silent"
                ) from error
        self.baudrate = baudrate

    def set_latency(self, seconds: float, rest: Rest | None = None) -> bool:
        """Look for bytes every `seconds` only, and take all there is; 0 to wake for each delivery.

        `rest`, asked before each pause, says when to look instead, as long as it says more than 0: for how many
        seconds nothing can come that matters. It is told how late this look came, in seconds.

        Returns whether it will: only a serial port can be looked at, others bring their bytes when they please.
        """
        if isinstance(self._transport, _SerialTransport) and os.name == "posix":
            self._transport.set_latency(seconds, rest)
            return True
        return False

    def poll(self) -> None:
        """Look for bytes now, whatever the latency."""
        if isinstance(self._transport, _SerialTransport) and self.is_open:
            self._transport.poll()

    def will_close(self) -> None:
        """Announce that somebody has seen to it that `close_soon` will be called: the end is no loss any more."""
        self._closing = True

    def close_soon(self) -> None:
        """Write out what is pending and close the port, without waiting for it."""
        self.will_close()
        if self.is_open and self._transport is not None:
            self._transport.close()

    async def wait_closed(self) -> None:
        """Return when the port is closed. Bounded, after which it is closed the hard way."""
        await asyncio.wait([self._closed], timeout=CLOSE_TIMEOUT_S)
        if not self._closed.done() and self._transport is not None:
            self._transport.abort()

    async def close(self) -> None:
        """Write out what is pending, close the port, and return when it is closed.

        Cancelling it ends the waiting; the port is closed all the same.
        """
        self.close_soon()
        await self.wait_closed()

    def abandon(self, last_words: bytes) -> None:
        """Write `last_words` and close, whether or not there still is a loop: for what nobody holds any more."""
        if self._transport is None or self._closing:
            return
        self._closing = True
        self._write_without_loop(last_words)
        if not self._loop.is_closed():
            self._transport.close()
            return
        device = self._transport.get_extra_info("serial")
        if device is not None:
            device.close()
        self._finish()

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """As `asyncio.Protocol`."""
        assert isinstance(transport, asyncio.Transport)
        self._transport = transport

    def data_received(self, data: bytes) -> None:
        """As `asyncio.Protocol`."""
        now = self._now()
        for tap in self.taps:
            tap("in", data, now)
        if self._receiver is not None:
            self._receiver.data_received(data, now)

    def connection_lost(self, exc: Exception | None) -> None:
        """As `asyncio.Protocol`; the receiver is told what it means."""
        receiver, self._receiver = self._receiver, None
        if receiver is not None:
            error = None
            if not self._closing:
                error = DeviceLost(f"{self.name} is gone: {exc or 'the other end closed it'}. Was it unplugged?")
                error.__cause__ = exc
            receiver.connection_lost(error)
        if not isinstance(self._transport, _SerialTransport):
            self.closed()

    def closed(self) -> None:
        """The file is closed; called by the transport."""
        if not self._closed.done():
            self._closed.set_result(None)
            self._finish()

    def on_close(self, callback: Callable[[], None]) -> None:
        """Have `callback` run once after the port was closed, e.g. to end a simulator."""
        self._on_close = callback

    def _finish(self) -> None:
        callback, self._on_close = self._on_close, None
        if callback is not None:
            callback()

    def _now(self) -> int:
        return round(self._loop.time() * 1e9)

    def _write_without_loop(self, data: bytes) -> None:
        transport = self._transport
        device: Any = None
        if transport is not None:
            device = transport.get_extra_info("serial") or transport.get_extra_info("socket")
        with contextlib.suppress(OSError, ValueError, AttributeError, serial.SerialException):
            os.write(device.fileno(), data)


class _SerialTransport(serial_asyncio.SerialTransport):  # type: ignore[misc]
    """pyserial-asyncio's transport: reads all there is, writes at once, and can look by the clock."""

    def __init__(self, loop: asyncio.AbstractEventLoop, protocol: Port, device: serial.Serial) -> None:
        super().__init__(loop, protocol, device)
        self._port = protocol
        self._max_read_size = _READ_SIZE
        self._latency = 0.0
        self._rest: Rest | None = None
        self._timer: asyncio.TimerHandle | None = None

    def set_latency(self, seconds: float, rest: Rest | None) -> None:
        self._latency = seconds
        self._rest = rest
        self._stop_timer()
        self._wait()

    def poll(self) -> None:
        if os.name == "posix":
            self._take(readable=False)

    def write(self, data: bytes) -> None:
        if self._closing:
            return
        if os.name == "posix" and not self.get_write_buffer_size():
            try:
                data = data[os.write(self._serial.fileno(), data) :]
            except BlockingIOError:
                pass
            except OSError as error:
                self._close(error)
                return
        if data:
            super().write(data)

    def _look(self) -> None:
        late = self._loop.time() - self._timer.when() if self._timer else 0.0
        self._timer = None
        try:
            self._take(readable=False)
        finally:
            self._wait(late)

    def _wait(self, late: float = 0.0) -> None:
        """Wait for the next bytes: by the clock, or, where none of them may wait, for the very next delivery."""
        if self._closing or self._timer is not None:
            return
        pause = 0.0 if self._rest is None else self._rest(late)
        if pause <= 0:
            pause = max(self._latency - _TIMER_S, self._latency / 2)
        if pause > 0:
            self._remove_reader()
            self._timer = self._loop.call_later(pause, self._look)
        else:
            self._ensure_reader()

    def _read_ready(self) -> None:
        if os.name != "posix":
            super()._read_ready()
            return
        self._take(readable=True)
        if self._rest is not None:
            self._wait()

    def _take(self, *, readable: bool) -> None:
        """Read all there is. A terminal that is readable and yet has nothing to read was hung up."""
        handle = self._serial.fileno()
        try:
            data = os.read(handle, _READ_SIZE)
            if not data and not readable and select.select([handle], [], [], 0)[0]:
                data, readable = os.read(handle, _READ_SIZE), True
        except BlockingIOError:
            return
        except OSError as error:
            self._close(error)
            return
        if data:
            self._protocol.data_received(data)
        elif readable:
            self._close(OSError("the line was hung up"))

    def _stop_timer(self) -> None:
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None

    def _close(self, exc: Exception | None = None) -> None:
        self._stop_timer()
        super()._close(exc)

    def _abort(self, exc: Exception | None) -> None:
        self._stop_timer()
        super()._abort(exc)

    def _call_connection_lost(self, exc: Exception | None) -> None:
        if self._loop is None:
            return
        try:
            super()._call_connection_lost(exc)
        finally:
            self._port.closed()


async def open_serial(path: str, baudrate: int) -> Port:
    """Open a serial port, for nobody else to open beside.

    Raises:
        ConnectFailed: Missing, forbidden, busy, or no serial port; the text says which.
    """
    shared_by_nature = is_pseudo_terminal(path)
    if not shared_by_nature and next(holders(path), None):
        raise busy(path)
    device = serial.serial_for_url(path, do_not_open=True, baudrate=baudrate, exclusive=os.name == "posix" or None)
    # Models without a motor command run while DTR is low; pyserial would raise it and stop them.
    device.dtr = False
    try:
        device.open()
        if os.name == "posix" and not shared_by_nature:
            _refuse_others(device.fileno())
        device.reset_input_buffer()
    except (OSError, ValueError, serial.SerialException) as error:
        device.close()
        raise why_not_opened(path, error) from error
    port = Port(path, baudrate)
    transport = _SerialTransport(asyncio.get_running_loop(), port, device)
    port.connection_made(transport)
    return port


async def open_tcp(name: str, host: str, number: int, baudrate: int = 0) -> Port:
    """Connect to a serial line that somebody serves over TCP.

    Raises:
        ConnectFailed: Unknown host, refused, or no answer within five seconds.
    """
    loop = asyncio.get_running_loop()
    port = Port(name, baudrate)
    try:
        async with asyncio.timeout(CONNECT_TIMEOUT_S):
            await loop.create_connection(lambda: port, host, number)
    except TimeoutError as error:
        raise ConnectFailed(f"{name}: no answer within {CONNECT_TIMEOUT_S:g} s", reason="refused") from error
    except OSError as error:
        why = os.strerror(error.errno) if error.errno and error.errno > 0 else error.strerror or str(error)
        raise ConnectFailed(f"{name}: {why}", reason="refused") from error
    return port


def _refuse_others(handle: int) -> None:
    import fcntl
    import termios

    arguments: Any = (handle, termios.TIOCEXCL)
    fcntl.ioctl(*arguments)
