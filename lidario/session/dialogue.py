"""Requests and responses of one device, with the timing the device demands.

Between `Link`, which knows no time, and `Scanner`, which knows no bytes. It runs the scripts of a family, one
request at a time. A request is written only when the device listens: when the time that the last request needs
has passed, and no response is outstanding. A device discards what comes earlier and does not say so.

Whatever an operation waits for, it waits for one future. So `interrupt`, a dead port and the end of the session
end it at once. Timers, not cancel scopes, bound the waiting: native cancellation and anyio's behave alike.
"""

from __future__ import annotations

import asyncio
import logging
import math
from collections.abc import Callable, Sequence
from contextlib import suppress
from enum import Enum, auto
from typing import TypeVar

import anyio

from lidario.errors import InternalError, LidarError, ResponseTimeout
from lidario.families.base import Device, Script, Timing
from lidario.port.port import Port, Schedule, Tap
from lidario.recording.chronicle import Chronicle
from lidario.revolution.together import join_runs
from lidario.session.stopper import CLOCK_S, PATIENCE_S, Stopper
from lidario.session.twin import twin_of
from lidario.wire.envelope import Request
from lidario.wire.events import Event, Packets, Response
from lidario.wire.link import Link, LinkState, LinkStats

__all__ = ["Dialogue"]

T = TypeVar("T")
_log = logging.getLogger("lidario")

_EARLY_LIMIT = 64
"""Runs of packets kept from the descriptor of a stream until its reader is named, one step of the loop later."""
RESPONSE_S = 0.02
"""Time in which a healthy device has responded."""
_MARGIN_S = 0.005
"""Added to every pause a device demands: an adapter may deliver one request late and the next one on time."""


class _For(Enum):
    """What an operation waits for."""

    TIME = auto()
    RESPONSE = auto()
    CHANGE = auto()


class Dialogue:
    """Talks to one device over one port.

    Attributes:
        on_lost: Called once, with the error, when the dialogue is over for good before it was closed.
        fatal: What ended the dialogue for good, or None.
        stopper: What leaves the device still.
        chronicle: What happened so far, for recordings.
    """

    def __init__(self, port: Port, device: Device, timing: Timing) -> None:
        self.on_lost: Callable[[LidarError], None] | None = None
        self.fatal: LidarError | None = None
        self.chronicle: Chronicle = Chronicle()
        self._port = port
        self._link = Link()
        self._device = device
        self._timing = timing
        self._loop = asyncio.get_running_loop()
        self._on_packets: Callable[[Packets], None] | None = None
        self._early: list[Packets] = []
        self._overflow = port.overflow_bytes
        self._patience = math.inf
        # What the operation in progress waits for, and the response it waits for, if it is one.
        self._waiter: asyncio.Future[bytes] | None = None
        self._waits_for = _For.TIME
        self._interruption: LidarError | None = None
        # When the device listens: not before this time, nor while a response is outstanding that may still come.
        self._listens_at = 0.0
        self._response_due = 0.0
        self.stopper: Stopper = Stopper(self, device, timing.quiet_s)
        port.attach(self)

    # ------------------------------------------------------------------------------------------------ what it is

    @property
    def stats(self) -> LinkStats:
        """Counters of everything that was received."""
        return self._link.stats

    @property
    def buffered(self) -> int:
        """Bytes received that belong to nothing complete yet."""
        return self._link.buffered

    @property
    def baudrate(self) -> int:
        """Speed of the line in bits a second; 0 where bytes take no time."""
        return self._port.baudrate

    @property
    def is_open(self) -> bool:
        """Whether requests can still be written."""
        return self._port.is_open

    @property
    def is_streaming(self) -> bool:
        """Whether packets flow, as far as is known."""
        return self._link.state is LinkState.STREAMING

    @property
    def bytes_received(self) -> int:
        """All bytes that came in so far."""
        return self._link.stats.bytes_received

    @property
    def bytes_fed(self) -> int:
        """As `Link.fed`."""
        return self._link.fed

    @property
    def stream_at(self) -> int:
        """As `Link.stream_at`."""
        return self._link.stream_at

    @property
    def is_live(self) -> bool:
        """As `Port.is_live`."""
        return self._port.is_live

    @property
    def wall_offset_ns(self) -> int:
        """As `Port.wall_offset_ns`."""
        return self._port.wall_offset_ns

    def now(self) -> int:
        """As `Port.now`."""
        return self._port.now()

    def deliver_to(self, callback: Callable[[Packets], None] | None) -> None:
        """Call `callback` with each run of packets, those that came since the descriptor first; None for nobody."""
        self._on_packets = callback
        early, self._early = self._early, []
        if callback is not None:
            for packets in early:
                callback(packets)
                self.stats.unread_packets -= packets.count

    def set_polling(self, latency: float, schedule: Schedule | None) -> None:
        """As `Port.set_polling`."""
        self._port.set_polling(latency, schedule)

    def poll(self) -> None:
        """As `Port.poll`."""
        self._port.poll()

    def add_tap(self, tap: Tap) -> None:
        """As `Port.add_tap`."""
        self._port.add_tap(tap)

    def remove_tap(self, tap: Tap) -> None:
        """As `Port.remove_tap`."""
        self._port.remove_tap(tap)

    # ------------------------------------------------------------------------------------------------ receiving

    def data_received(self, data: bytes, now: int, arrivals: Sequence[tuple[int, int]] = ()) -> None:
        """As `Receiver`. A mistake of ours ends the dialogue: it must not leave readers waiting."""
        try:
            overflow = self._port.overflow_bytes
            if overflow != self._overflow:
                # They came before `data`: the port keeps what comes first.
                self._link.discard_data(overflow - self._overflow)
                self._overflow = overflow
            self._link.receive_data(data, now, arrivals)
            for event in join_runs(self._link.events_received()):
                self._handle(event)
        except Exception as error:
            if self.fatal is None:
                _log.exception("lidario failed at what the device sent")
            failure = InternalError(f"lidario failed at what the device sent ({error!r}); please report this")
            failure.__cause__ = error
            self.fail(failure)
            self.stop_device()
        if not self._link.is_awaiting:
            self._wake(_For.CHANGE)
            self.stopper.try_now()

    def connection_lost(self, error: LidarError | None) -> None:
        """As `Receiver`."""
        self.stopper.cancel()
        if error is not None:
            self.fail(error)

    def fail(self, error: LidarError) -> None:
        """End the dialogue for good; the first error wins."""
        if self.fatal is not None:
            return
        self.fatal = error
        self._wake_with(error)
        if self.on_lost is not None:
            self.on_lost(error)

    # ------------------------------------------------------------------------------------------------ operations

    def begin(self) -> None:
        """An operation begins; what interrupted the one before does not concern it."""
        self._interruption = None

    def interrupt(self, error: LidarError) -> None:
        """End the operation in progress with `error`: at once if it waits, else at its next step."""
        self._interruption = error
        self._wake_with(error)

    def hurry(self, patience: float | None) -> None:
        """While probing, ask once and wait at most `patience` seconds; None for as long as is usual."""
        self._patience = math.inf if patience is None else patience

    async def ask(self, request: Request) -> bytes:
        """Send a request when the device listens; return the payload of its response, empty if it has none.

        Cancelling gives up the response; should it still come, it is counted and dropped.

        Raises:
            ResponseTimeout: No response, however often it was asked.
            DeviceLost: The port died.
            SessionClosed: The session was closed meanwhile.
        """
        noise = self.stats.stray_bytes
        timeout = min(request.timeout, self._patience)
        for _ in range(request.attempts if self._patience == math.inf else 1):
            await self._until_it_listens()
            self.write((request,))
            if request.expects is None:
                return b""
            self._response_due = self._loop.time() + timeout
            try:
                payload = await self._wait(timeout, _For.RESPONSE)
                if request.stream is None:
                    self.chronicle.responded(request.data, request.expects.type, payload)
                else:
                    self.chronicle.started(request.data)
                return payload
            except TimeoutError:
                self._link.forget()
            except BaseException:
                # The device is still busy with it: the next request waits until it has responded.
                self._link.abandon()
                raise
        raise ResponseTimeout(request.name, timeout, self.stats.stray_bytes - noise)

    async def run(self, script: Script[T], first: Request | None = None) -> T:
        """Hold the dialogue that `script` writes down, and return its result.

        Args:
            script: A script of a family.
            first: Its first request, where it was advanced to that one already.

        Raises:
            Whatever the script raises, and what `ask` raises unless the script catches it.
        """
        try:
            request = next(script) if first is None else first
            while True:
                try:
                    payload = await self.ask(request)
                except ResponseTimeout as timeout:
                    request = script.throw(timeout)
                else:
                    request = script.send(payload)
        except StopIteration as stop:
            result: T = stop.value
            return result
        finally:
            script.close()

    async def pause(self, seconds: float) -> None:
        """Sleep as an operation does: `interrupt` and a dead port end it."""
        with suppress(TimeoutError):
            await self._wait(seconds, _For.TIME)

    async def quieten(self) -> bool:
        """Send STOP and wait until the line is quiet; False if it did not fall quiet in time."""
        await self._until_it_listens()
        self.write((self._device.stop(),))
        self.deliver_to(None)
        return await self.drain()

    async def drain(self) -> bool:
        """Wait until the line is quiet after a STOP; False if it did not fall quiet in time. Sends nothing."""
        await self._until_it_listens()
        deadline = self._loop.time() + self._timing.drain_s
        while self._link.state is LinkState.DRAINING:
            seen = self.stats.bytes_received
            await self.pause(self._timing.quiet_s)
            if self.stats.bytes_received == seen:
                self._link.drained()
            elif self._loop.time() > deadline:
                return False
        return True

    def keep_alive(self, request: Request) -> None:
        """Send a request in the midst of a stream; its response is part of the stream."""
        if self.fatal is None and not self.stopper.wanted and self._loop.time() >= self._listens_at:
            self.write((request,))

    # ------------------------------------------------------------------------------------------------ stopping

    def stop_device(self) -> None:
        """Write the stop requests as soon as the device listens, now if it does. Never blocks or raises.

        Nothing is delivered any more; packets that still come are drained.
        """
        self.deliver_to(None)
        self.stopper.stop()

    def hang_up(self) -> None:
        """Leave the device still, then close the port; without waiting. Nothing is delivered any more.

        After the event loop was closed no timer can do that, so it blocks as `abandon` does.
        """
        if self._loop.is_closed():
            self.abandon()
            return
        self._port.announce_close()
        self.deliver_to(None)
        self.stopper.hang_up()

    async def close(self) -> None:
        """As `hang_up`, and return when the port is closed.

        The waiting is bounded and shielded from anyio's cancellation. A second native cancellation ends it as soon
        as the stop requests are written; timers go on with closing the port.
        """
        self.hang_up()
        if self._loop.is_closed():
            return
        with anyio.CancelScope(shield=True):
            await self.stopper.surely_written()
            await self._port.wait_closed()

    def abandon(self) -> None:
        """Leave the device still and close the port, even without a loop: for finalizers. Blocks shortly.

        Where timers do so already, on a loop that runs, they go on.
        """
        if self.stopper.ends_by_itself and self._loop.is_running():
            return
        self.stopper.cancel()
        requests = () if self.stopper.still else self.stopper.requests()
        # A response that is outstanding is not received any more. A healthy device has sent it after this time.
        patient_until = self._loop.time() + RESPONSE_S
        self._port.abandon(b"".join(request.data for request in requests), self.free_at(patient_until))

    def free_at(self, patient_until: float) -> float:
        """When the device listens, on the loop's clock; a response is not waited for beyond `patient_until`."""
        if not self._link.is_awaiting:
            return self._listens_at
        return max(self._listens_at, min(self._response_due, patient_until))

    def close_port(self) -> None:
        """Begin to close the port."""
        self._port.close_soon()

    def write(self, requests: Sequence[Request]) -> None:
        """Write requests, now; the pause that they demand counts from now."""
        for request in requests:
            self._link.send_request(request)
            self.stopper.sent(request)
        self._port.write(self._link.data_to_send())
        settle = max((request.settle for request in requests), default=0.0)
        if settle:
            self._listens_at = max(self._listens_at, self._loop.time() + settle + _MARGIN_S)
        self._wake(_For.CHANGE)

    # ------------------------------------------------------------------------------------------------ inside

    def _handle(self, event: Event) -> None:
        if isinstance(event, Packets):
            self.stats.unread_packets += event.count
            if self._on_packets is not None:
                self._on_packets(event)
                self.stats.unread_packets -= event.count
            elif self._link.state is LinkState.STREAMING and len(self._early) < _EARLY_LIMIT:
                self._early.append(event)
        else:
            # Of a stream, the script is told what its descriptor announces.
            self._wake(_For.RESPONSE, event.payload if isinstance(event, Response) else bytes((event.type,)))

    async def _until_it_listens(self) -> None:
        """Wait until the device accepts a request."""
        while True:
            self._check()
            now = self._loop.time()
            if self._link.is_awaiting and self._response_due - now <= CLOCK_S:
                self._link.forget()
            if self.stopper.wanted:
                until = now + PATIENCE_S
            elif self._link.is_awaiting:
                until = self._response_due
            elif self._listens_at - now > CLOCK_S:
                until = self._listens_at
            else:
                return
            with suppress(TimeoutError):
                await self._wait(until - now, _For.CHANGE)

    async def _wait(self, seconds: float, what: _For) -> bytes:
        """Wait for what the operation in progress waits for; TimeoutError after `seconds`."""
        self._check()
        waiter: asyncio.Future[bytes] = self._loop.create_future()
        self._waiter, self._waits_for = waiter, what
        timer = self._loop.call_later(seconds, _time_out, waiter)
        try:
            return await waiter
        finally:
            timer.cancel()
            self._waiter = None

    def _wake(self, what: _For, result: bytes = b"") -> None:
        """The operation in progress need not wait any more, if it waits for this."""
        if self._waiter is not None and self._waits_for is what and not self._waiter.done():
            self._waiter.set_result(result)

    def _wake_with(self, error: LidarError) -> None:
        if self._waiter is not None and not self._waiter.done():
            self._waiter.set_exception(twin_of(error))

    def _check(self) -> None:
        for error in (self.fatal, self._interruption):
            if error is not None:
                raise twin_of(error)


def _time_out(waiter: asyncio.Future[bytes]) -> None:
    if not waiter.done():
        waiter.set_exception(TimeoutError())
