"""An open line to a device, with one interface for serial ports, TCP connections and simulated devices.

A `Port` belongs to the session. What carries its bytes is a `Line` (`lidario.port.line`). The port shows every
chunk to the taps (`Guarded`), hands received bytes to one `Receiver`, and says what the end of the line means.
Exceptions of the operating system and of pyserial are translated to `lidario.errors` in this folder and nowhere
else.

Three orders matter here:

- A write reaches the operating system before `Port.write` returns, as far as it takes the bytes. The stop requests
  of a program that is being ended have no later moment.
- Bytes are written first and shown to the taps afterwards, so that a tap that fails cannot keep back a STOP.
- `Port.close` writes what is pending, then closes the port, then returns.

A forked child inherits the port and the memory of the event loop, and both still belong to its parent. In the child
every method does nothing: a write would reach the parent's device, and removing a reader would remove it from the
parent's loop, since both share one epoll object.
"""

import asyncio
import logging
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from lidario.basics.model import LineErrors
from lidario.basics.system import cause_of
from lidario.errors import DeviceLost
from lidario.port.forked import let_go_in_children
from lidario.port.guarded import Guarded, Stops
from lidario.port.inbox import Late
from lidario.port.line import Line, Receiver, Schedule
from lidario.port.wall_clock import WallClock

_log = logging.getLogger("lidario")

CLOSE_TIMEOUT_S = 1.0
"""Longest time that closing takes; after it the line is aborted. A serial line is done after half of it."""
_SAME_CLOCK_NS = 1_000_000_000
"""Two readings of one clock are less than this apart."""
LONGEST_WAIT_S = 0.05
"""Longest time that `Port.abandon` waits for the device to listen. The longest silence after a STOP is 10 ms."""
SENT_S = 0.01
"""How long stop requests are under way: they have less than 20 bytes."""


class Port(Guarded, WallClock, asyncio.Protocol):
    """One open line; made by `open_serial`, `open_tcp`, `open_udp`, `Simulation` or `connect_in_memory`.

    Attributes:
        name: What was opened, for messages.
        baudrate: Speed in bits a second; 0 where there is none.
        dtr: The state in which the control line DTR was put last; None while it is as it was opened.
        late: What was lost because the event loop was blocked, or this computer busy.
        is_closing: Whether it is closed, or will be: from then on the end of the line is no loss.
        is_real_time: Whether the event loop's clock is that of the system.
        is_live: Whether a device is at the other end, which can fall silent; a recording cannot.
        length_s: As `Lidar.length_s`.
        files: Those of the recording that is played.
        on_close: Called once after the port was closed, e.g. to end a simulated device.
        explain_loss: Asked why the line died; a simulated device knows more about it than the system.
        likely_loss: What an error asks its reader to check, when the cause of the loss is not known.
    """

    likely_loss: str = "Was it unplugged?"

    def __init__(self, name: str, baudrate: int = 0) -> None:
        Guarded.__init__(self, name)
        self.baudrate: int = baudrate
        self.dtr: bool | None = None
        self.late: Late = Late()
        self._loop = asyncio.get_running_loop()
        # uvloop's clock stands still while a callback runs and counts whole milliseconds; it is the monotonic one.
        self._exact = type(self._loop).__module__.split(".")[0] == "uvloop"
        # Threads know the system's clock only: they are of no use to a loop with another one.
        self.is_real_time: bool = abs(self.now() - time.monotonic_ns()) < _SAME_CLOCK_NS
        WallClock.__init__(self, self.now)
        self._receiver: Receiver | None = None
        self._untold: DeviceLost | None = None
        self.is_closing: bool = False
        # Whether its session was let go: timers and tasks that it has left behind write nothing any more.
        self._is_abandoned = False
        self.is_live: bool = True
        self.length_s: float | None = None
        self.files: tuple[Path, ...] = ()
        self._closed = self._loop.create_future()
        self._close_timer: asyncio.TimerHandle | None = None
        self.on_close: Callable[[], None] | None = None
        self.explain_loss: Callable[[], DeviceLost | None] | None = None

    # ---------------------------------------------------------------------------------- what the session calls

    @property
    def is_open(self) -> bool:
        """Whether bytes can still be written."""
        return self._open_line() is not None

    @property
    def reached_s(self) -> float | None:
        """As `Lidar.reached_s`."""
        return None

    def follow(self, audience: Any) -> None:
        """Name the session to which a recording is played; a live device does not care."""

    @property
    def errors(self) -> LineErrors:
        """What the driver of a serial port has counted as wrong since it was opened; zeros where it does not."""
        return LineErrors() if self._line is None else self._line.errors

    def attach(self, receiver: Receiver | None, stops: Stops | None = None) -> None:
        """Set the receiver of what arrives from now on, or None; and what leaves the device still, for a guard.

        If the line was lost while there was no receiver, the new one is told now.
        """
        self._receiver, self._stops = receiver, stops
        if receiver is not None and self._untold is not None:
            error, self._untold = self._untold, None
            self._loop.call_soon(receiver.connection_lost, error)

    def write(self, data: bytes) -> None:
        """Hand bytes to the operating system, at once as far as it takes them.

        Ignored on a dead port, in a forked child, and behind `abandon`; never raises.
        """
        line = self._open_line()
        if line is None or self._is_abandoned:
            return
        if self._guard is not None:
            self.tell_guard()
        if (repeat := line.repeat) is not None and data == repeat.request:
            repeat.note()
        if self._loop.is_closed():
            # These are the stop requests: the thread must not write behind them.
            self.set_repeat(b"")
            line.write_without_loop(data)
        else:
            line.write(data)
            if self.taps:
                line.hand_over()  # so that they see all in the order of time
        if self.taps:
            self.show(("out", data, self.now()))

    def set_baudrate(self, baudrate: int) -> None:
        """Change the speed of the line; bytes received at the old speed and not read yet are discarded.

        Ignored where it is that speed already, and for 0, the speed of what has none.

        Raises:
            ConnectFailed: The adapter cannot do that speed.
        """
        if baudrate not in (0, self.baudrate):
            if (line := self._open_line()) is not None:
                line.set_baudrate(baudrate)
            self.baudrate = baudrate

    def set_dtr(self, asserted: bool) -> None:
        """Put the control line DTR of a serial port in a state, also without a loop. Never raises.

        Ignored where there is no such line: on a pseudo-terminal, a network connection, a dead port, and in a
        forked child. Once it is asserted, it stays so when the port is closed.
        """
        if (line := self._open_line()) is not None:
            self.tell_guard()
            self.dtr = asserted
            line.set_dtr(asserted)

    def set_polling(self, schedule: Schedule | None) -> None:
        """Poll the line instead of being woken for each delivery.

        The line is polled at `schedule.due`, and every `schedule.latency` seconds from then on. What was read
        before is held until then, and handed over by one call of `Receiver.data_received`; on a loop that is free
        at most half a second and 32 KiB are held. With None every delivery is handed over at once.

        While there is a schedule, a thread reads the line too (`lidario.port.thread`). What it cannot keep while
        the loop is blocked is counted in `late`.
        """
        line = self._open_line()
        if line is not None and not self._loop.is_closed():
            line.set_polling(schedule)

    def set_repeat(self, request: bytes, interval: float = 0.0) -> None:
        """Have `request` written when it was not written for `interval` seconds.

        A thread does that, so the device goes on while a program blocks the event loop; one in memory does not.

        Args:
            request: The bytes; none to write nothing any more, and then no write is in progress on return.
            interval: Seconds, longer than the pause that the session keeps between two writes of it.
        """
        repeat = None if self._line is None else self._line.repeat
        if repeat is not None and not self.is_forked:
            repeat.set(request, interval)

    @property
    def repeated(self) -> int:
        """How often the thread has written a request."""
        return 0 if self._line is None or self._line.repeat is None else self._line.repeat.count

    def poll(self) -> None:
        """Read what is there now, and hand over everything that is held."""
        line = self._open_line()
        if line is not None and not self._loop.is_closed():
            line.poll()

    def close_soon(self) -> None:
        """Begin to write out what is pending and to close the port, without waiting for it."""
        self.is_closing = True
        if self._line is not None and self._loop.is_closed() and not self.is_forked:
            self._line.close_without_loop()
            self.closed()
        elif (line := self._open_line()) is not None:
            line.close()
            self._close_timer = self._loop.call_later(CLOSE_TIMEOUT_S, line.abort)

    async def wait_closed(self) -> None:
        """Return when the port is closed, about a second after `close_soon` at the latest.

        Cancelling ends only the waiting.
        """
        if self.is_forked:
            return  # a child has no running loop, even inside of one
        # A little more than the timer of `close_soon`, so that the end it forces is seen here.
        await asyncio.wait([self._closed], timeout=1.1 * CLOSE_TIMEOUT_S)

    async def close(self) -> None:
        """Write out what is pending, close the port, and return when it is closed; bounded, as `wait_closed`."""
        self.close_soon()
        await self.wait_closed()

    def abandon(
        self, stop_requests: bytes, listens_at: float = 0.0, dtr: bool | None = None, again_s: float = 0.0
    ) -> None:
        """Finalizer of a session that was never closed: write `stop_requests` and close, even without a loop.

        Blocks for 80 ms at most. Does nothing on a closed port and in a forked child. Never raises.

        Args:
            stop_requests: What stops laser and motor.
            listens_at: When the device listens again, in seconds of the event loop's clock.
            dtr: State in which DTR is put when they have been heard; None to leave it as it is.
            again_s: Seconds for which the device is deaf behind them; then they are written once more. 0 for once.
        """
        line = self._open_line()
        if line is None:
            return
        self.is_closing = self._is_abandoned = True
        self.set_repeat(b"")  # as in `write`
        wait = min(listens_at - self.now() * 1e-9, LONGEST_WAIT_S)
        if wait > 0:
            time.sleep(wait)
        line.write_without_loop(stop_requests)
        if again_s:
            written = self.now()
            time.sleep(SENT_S + again_s)
            if self.now() - written >= again_s * 1e9:  # a clock that is driven may stand still
                line.write_without_loop(stop_requests)
        if dtr is not None:
            time.sleep(SENT_S)
            line.set_dtr(dtr)
        _log.debug("%s was abandoned without being closed", self.name)
        try:
            # The garbage collector may run this in any thread.
            self._loop.call_soon_threadsafe(self.close_soon)
        except RuntimeError:  # the loop was closed
            self.close_soon()

    # ------------------------------------------------------------------------------------- what the line calls

    def now(self) -> int:
        """The time in nanoseconds of the event loop's clock."""
        return time.monotonic_ns() if self._exact else round(self._loop.time() * 1e9)

    def connection_made(self, transport: asyncio.BaseTransport | Line) -> None:
        """As `asyncio.Protocol`, with the line as the transport."""
        assert isinstance(transport, Line)
        self._line = transport
        let_go_in_children(self)
        _log.debug("%s is open", self.name)

    def forked(self) -> None:
        """As `Inherited`: the port is the parent's."""
        self.is_forked = True
        if self._line is not None:
            self._line.let_go()

    def data_received(self, data: bytes, now: int | None = None, arrivals: Sequence[tuple[int, int]] = ()) -> None:
        """As `asyncio.Protocol`, the one door for bytes: taps see them, each read by itself, then the receiver.

        `now` and `arrivals` are those of `Receiver.data_received`; without them, all was read just now.
        """
        if self.is_forked:
            return
        now = self.now() if now is None else now
        if self.taps:
            ends = [*arrivals, (len(data), now)]
            begins = [0, *(end for end, _ in arrivals)]
            self.show(*(("in", data[begin:end], at) for begin, (end, at) in zip(begins, ends, strict=True)))
        if self._receiver is not None:
            self._receiver.data_received(data, now, arrivals)
            if self._guard is not None and self._guard.awaits_change:
                # It was told that the device may not listen.
                self.tell_guard()

    def connection_lost(self, exc: Exception | None) -> None:
        """As `asyncio.Protocol`: the line is closed, and the receiver is told what it means.

        Args:
            exc: Why; a DeviceLost is passed on as it is, and is told even where the port was closed as asked.
        """
        error = exc if isinstance(exc, DeviceLost) else None
        if error is None and self.explain_loss is not None:
            error = self.explain_loss()
        if error is None and not self.is_closing:
            why = cause_of(exc) if isinstance(exc, OSError) else exc or "the other end closed it"
            error = DeviceLost(f"{self.name} is gone: {why}. {self.likely_loss}")
            error.__cause__ = exc
        if error is not None:
            _log.debug("%s is lost: %s", self.name, error)
        receiver, self._receiver = self._receiver, None
        try:
            if receiver is None:
                self._untold = error
            else:
                receiver.connection_lost(error)
        finally:
            self.closed()

    def closed(self) -> None:
        """The line is closed: dismiss the guard, end the waiting for the close, and run what `on_close` named."""
        self.unguard(self._freed)

    def _freed(self) -> None:
        """Nobody holds the line any more. A failure of what `on_close` named is logged."""
        if self._close_timer is not None:
            self._close_timer.cancel()
            self._close_timer = None
        if not self._closed.done() and not self._loop.is_closed():
            self._closed.set_result(None)
            _log.debug("%s is closed", self.name)
        callback, self.on_close = self.on_close, None
        if callback is None:
            return
        try:
            callback()
        except Exception:
            _log.warning("ending what serves %s failed", self.name, exc_info=True)
