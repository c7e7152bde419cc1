"""A serial port: opening it exclusively, reading, writing and closing.

pyserial configures the port and pyserial-asyncio, used through its public names alone, writes what the operating
system does not take at once. Three things that pyserial-asyncio does are replaced here:

- It reads a kilobyte at a time; `PolledLine` reads all there is.
- It calls `connection_lost` before the port is closed; here the port is closed first.
- When it closes, it waits on the event loop until the last byte has left the adapter (`tcdrain`), and closing in
  the kernel waits for up to 30 s likewise. `_SerialLine.close` waits asynchronously and for a bounded time, then
  discards what is left.

On Windows no event loop can wait for a serial port. There `PolledLine` and its thread poll it by pyserial's calls,
which return at once, in place of pyserial-asyncio's polling, which a blocked event loop would stop.
"""

import asyncio
import contextlib
import logging
import os
from functools import partial

import serial_asyncio

from lidario.basics.model import LineErrors
from lidario.errors import ConnectFailed
from lidario.port.adapter import FOREIGN, Adapter, count_errors
from lidario.port.background import run_in_thread, start_thread
from lidario.port.diagnose import busy, held, is_pseudo_terminal, why_not_opened
from lidario.port.guard import wait_for_guard
from lidario.port.port import Port
from lidario.port.reading import PolledLine

_log = logging.getLogger("lidario")

DRAIN_S = 0.5
"""Longest time for which closing waits until the adapter has sent what was written."""
_DRAIN_POLL_S = 0.002
_NO_HANDLE = -1
POSIX = os.name == "posix"
"""Whether a serial port has a descriptor for which an event loop can wait."""


async def open_serial(path: str, baudrate: int) -> Port:
    """Open a serial port exclusively: no other program can open it meanwhile.

    It is opened in a thread, since that takes up to tens of milliseconds. Cancelling leaves nothing open: a device
    that opens too late is closed. The guard of a program that was killed just now is waited for.

    Raises:
        ConnectFailed: Missing, forbidden, busy, or no serial port; the text says which.
    """
    device = await run_in_thread(lambda: _open_when_free(path, baudrate), Adapter.close)
    port = Port(path, baudrate)
    port.connection_made(_SerialLine(asyncio.get_running_loop(), port, device))
    return port


def _open_when_free(path: str, baudrate: int) -> Adapter:
    """As `_open`; first the guard of a program that was killed stops the device, and lets go of the port."""
    try:
        return _open(path, baudrate)
    except ConnectFailed as error:
        if error.reason != "busy":
            raise
    wait_for_guard(path)
    # Also where there was none: it may have ended just now.
    return _open(path, baudrate)


def _open(path: str, baudrate: int) -> Adapter:
    """Open and configure; blocks, and fails as `open_serial`."""
    device = Adapter()
    try:
        # A pseudo-terminal is held open by its other end.
        shared = is_pseudo_terminal(path)
        if not shared and held(path):
            raise busy(path)
        device.port, device.baudrate = path, baudrate
        device.open()
        if POSIX and not shared:
            device.refuse_others()
        device.hurry()
        device.reset_input_buffer()
    except FOREIGN as error:
        device.close()
        raise why_not_opened(path, error) from error
    return device


class _SerialLine(PolledLine, asyncio.Protocol):
    """One open serial port: pyserial-asyncio's transport, with reading, direct writing and closing of our own.

    The transport reads nothing, and tells it when it has ended.
    """

    def __init__(self, loop: asyncio.AbstractEventLoop, port: Port, device: Adapter) -> None:
        self._device = device
        if POSIX:
            handle = device.fileno()
            super().__init__(loop, port, handle, partial(os.write, handle))
        else:
            super().__init__(loop, port, _NO_HANDLE, device.write_now, device.read_now)
        self._ended = False
        self._drained_by = 0.0
        self._errors = LineErrors()
        # None of a driver that does not count: it is not asked again, which is done once a revolution.
        self._errors_before: LineErrors | None = None
        with contextlib.suppress(*FOREIGN):
            self._errors_before = count_errors(device.fileno())
        self._transport = serial_asyncio.SerialTransport(loop, self, device)
        # The transport has just queued its own start of reading; these two run after it, in the same turn of the
        # loop, so that it reads nothing.
        loop.call_soon(self._transport.pause_reading)
        loop.call_soon(self.start)

    def passed_on(self) -> tuple[int, bool] | None:
        is_open = POSIX and self._device.is_open
        return (self._device.fileno(), self._device.is_hurried) if is_open else None

    def set_baudrate(self, baudrate: int) -> None:
        try:
            self._device.baudrate = baudrate
            self._device.reset_input_buffer()
        except FOREIGN as error:
            text = f"{self._port.name} cannot run at {baudrate} baud: {error}"
            raise ConnectFailed(text, reason="silent") from error

    def set_dtr(self, asserted: bool) -> None:
        # A pseudo-terminal has no such line (ENOTTY), and a dead port is noticed by the next write.
        with contextlib.suppress(*FOREIGN):
            if asserted and POSIX:
                self._device.keep_lines_at_close()
            self._device.dtr = asserted

    @property
    def errors(self) -> LineErrors:
        if self._device.is_open:
            self._count()
        return self._errors

    def _count(self) -> None:
        """What a line that is gone has counted last is what it had counted."""
        if self._errors_before is not None:
            with contextlib.suppress(*FOREIGN):
                self._errors = count_errors(self._device.fileno()) - self._errors_before

    def write(self, data: bytes) -> None:
        if not self._transport.get_write_buffer_size():
            data = self._write_some(data)
        if data:
            self._transport.write(data)

    def write_without_loop(self, data: bytes) -> None:
        # It may run in any thread, and the number of a port that was closed may be another file's by now.
        if self._device.is_open:
            with contextlib.suppress(*FOREIGN):
                self._write_now(data)

    def close(self) -> None:
        if not self._port.is_forked:
            self.stop()
            self._drained_by = self._loop.time() + DRAIN_S
            self._drain()

    def abort(self) -> None:
        # Once only: the transport would fail at a second end.
        if not self._ended and not self._port.is_forked:
            self._ended = True
            self.stop()
            self._discard_output()
            if not self._transport.is_closing():  # it may have ended by itself just now
                self._transport.abort()

    def close_without_loop(self) -> None:
        self.is_closing = True
        self.release()
        if not self._device.is_open:
            return
        self._discard_output()
        with contextlib.suppress(*FOREIGN):
            self._device.close()

    def _drain(self) -> None:
        """Close once everything written has left, or when it has not left in time."""
        if self._ended:
            return
        if self._is_drained():
            self._ended = True
            self._transport.close()
        elif self._loop.time() < self._drained_by:
            self._loop.call_later(_DRAIN_POLL_S, self._drain)
        else:
            _log.warning("%s: closed before all was sent, which took more than %g s", self._port.name, DRAIN_S)
            self.abort()

    def _is_drained(self) -> bool:
        if self._transport.get_write_buffer_size():
            return False
        try:
            return not self._device.out_waiting
        except FOREIGN:
            return True  # unplugged: nothing will be sent any more

    def _discard_output(self) -> None:
        """Throw away what was not sent, or else closing waits for it."""
        with contextlib.suppress(*FOREIGN):
            if not self._device.out_waiting:
                return
            self._device.reset_output_buffer()
            if POSIX and self._device.out_waiting:
                # The driver cannot discard (usb-serial cannot), so the kernel makes the last close wait for up to
                # 30 s. This duplicate is what is closed last, in a thread.
                duplicate = os.dup(self._device.fileno())
                try:
                    start_thread(partial(os.close, duplicate), "lidario: close")
                except RuntimeError:  # the system allows no more threads
                    os.close(duplicate)

    def connection_lost(self, exc: Exception | None) -> None:
        """The transport has ended, perhaps by itself: hand over what was held, close the port, and report it."""
        self._ended = True
        self.stop()
        self.hand_over()
        self._count()
        with contextlib.suppress(*FOREIGN):
            self._device.close()
        self._port.connection_lost(self._error or exc)
