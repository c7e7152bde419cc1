"""Requests and responses of one device, with the timing the device demands.

Between `Link`, which knows no time, and `Scanner`, which knows no bytes. It runs the scripts of a family, one
request at a time. A request is written only when the device listens: when the time that the last request needs
has passed, and no response is outstanding. A device discards what comes earlier and does not say so.

What an operation waits for, and what ends the waiting, is in `lidario.session.waiting`.
"""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Callable, Sequence
from contextlib import suppress
from typing import TypeVar

import anyio

from lidario.errors import InternalError, LidarError, ResponseTimeout
from lidario.families.base import Device, Script, Timing
from lidario.port.port import Port
from lidario.session.intake import Intake
from lidario.session.patience import RESPONSE_S, Patience
from lidario.session.readiness import Readiness
from lidario.session.script import play
from lidario.session.stopper import PATIENCE_S, Stopper
from lidario.session.waiting import Awaited, Waiting
from lidario.wire.envelope import Request
from lidario.wire.states import LinkState

__all__ = ["Dialogue"]

T = TypeVar("T")
_log = logging.getLogger("lidario")


class Dialogue(Intake):
    """Talks to one device over one port.

    Attributes:
        on_lost: Called once, with the error, when the dialogue is over for good before it was closed.
        protection_stops: Times the device was found to have stopped to protect itself.
        reset_at: When the device was told to restart, on the loop's clock; None if it has responded since. A device
            that boots discards what it is sent.
        dtr: The state in which the control line DTR was put last; None while it is as it was opened.
    """

    def __init__(self, port: Port, device: Device, timing: Timing) -> None:
        super().__init__(port)
        self.on_lost: Callable[[LidarError], None] | None = None
        self._device = device
        self._timing = timing
        self._loop = asyncio.get_running_loop()
        self._patience = Patience()
        self.protection_stops: int = 0
        self.reset_at: float | None = None
        self._waiting = Waiting()
        self.dtr: bool | None = None
        self._readiness = Readiness(self._link)
        self._on_still: Callable[[], None] | None = None
        self._stopper = Stopper(self, self._readiness, device, timing.quiet_s)
        port.attach(self, self._stopper.unseen)

    # ------------------------------------------------------------------------------------------------ what it is

    @property
    def fatal(self) -> LidarError | None:
        """What ended the dialogue for good, or None."""
        return self._waiting.fatal

    @property
    def timing(self) -> Timing:
        """How long the device takes for what."""
        return self._timing

    @property
    def is_still(self) -> bool:
        """As `Stopper.still`."""
        return self._stopper.still

    def set_baudrate(self, baudrate: int) -> None:
        """Change the speed of the line, at this end. Raises ConnectFailed where the adapter cannot do it."""
        if baudrate != self._port.baudrate:
            self._port.set_baudrate(baudrate)

    def may_move(self) -> None:
        """The device may be in motion, although nothing was sent that sets it in motion."""
        self._stopper.still = False

    def keep_spinning(self, on: bool) -> None:
        """As `Stopper.keep_spinning`."""
        self._stopper.keep_spinning = on

    def when_still(self, callback: Callable[[], None] | None) -> None:
        """Have `callback` called each time the device is seen still."""
        self._on_still = callback

    # ------------------------------------------------------------------------------------------------ receiving

    def responded(self, payload: bytes) -> None:
        """As `Intake.responded`."""
        self._readiness.responded()
        self._waiting.wake(Awaited.RESPONSE, payload)

    def taken(self) -> None:
        """As `Intake.taken`."""
        self._readiness.received()
        if not self._link.is_awaiting:
            self._waiting.wake(Awaited.CHANGE)
            self._stopper.try_now()

    def mistaken(self, error: Exception) -> None:
        """As `Intake.mistaken`. It ends the dialogue: it must not leave readers waiting."""
        if self.fatal is None:
            _log.error("lidario failed at what the device sent", exc_info=error)
        failure = InternalError(f"lidario failed at what the device sent ({error!r}); please report this")
        failure.__cause__ = error
        self.fail(failure)
        self.stop_device()

    def connection_lost(self, error: LidarError | None) -> None:
        """As `Receiver`."""
        self._stopper.cancel()
        if error is not None:
            # What came before is still worth having.
            self._turns.then(lambda: self.fail(error))

    def fail(self, error: LidarError) -> None:
        """End the dialogue for good; the first error wins."""
        if self.fatal is not None:
            return
        self._waiting.fail(error)
        if self.on_lost is not None:
            self.on_lost(error)

    # ------------------------------------------------------------------------------------------------ operations

    def begin(self) -> None:
        """An operation begins; what interrupted the one before does not concern it."""
        self._waiting.begin()

    def interrupt(self, error: LidarError) -> None:
        """End the operation in progress with `error`: at once if it waits, else at its next step."""
        self._waiting.interrupt(error)

    def hurry(self, patience: float | None) -> None:
        """While probing, ask once and wait at most `patience` seconds; None for as long as is usual."""
        self._patience.hurry(patience)

    def hurry_until(self, deadline: float | None) -> None:
        """Ask each question once, and wait until `deadline` for all of them together; None for as long as is usual.

        A device that has responded to none until then is given the shortest time for each that follows.
        """
        self._patience.hurry_until(deadline)

    async def ask(self, request: Request) -> bytes:
        """Send a request when the device listens; return the payload of its response, empty if it has none.

        Cancelling gives up the response; should it still come, it is counted and dropped.

        Raises:
            ResponseTimeout: No response, however often it was asked.
            DeviceLost: The port died.
            SessionClosed: The session was closed meanwhile.
        """
        noise, timeout = self.stats.stray_bytes, request.timeout
        for _ in range(self._patience.attempts(request)):
            await self._until_it_listens()
            now = self._loop.time()
            timeout = self._patience.timeout(request, now)
            # As the pause in `write`: noted before it is written.
            self._readiness.asked(now, timeout)
            self.write((request,))
            if request.expects is None:
                return b""
            try:
                payload = await self._waiting.wait(timeout, Awaited.RESPONSE)
                self.reset_at = None
                if request.stream is None:
                    self.chronicle.responded(request.data, request.expects.type, payload)
                else:
                    self.chronicle.started(request.data)
                return payload
            except TimeoutError:
                self._readiness.give_up()
            except BaseException:
                # The device is still busy with it: the next request waits until it has responded.
                self._link.abandon()
                raise
        raise ResponseTimeout(request.name, timeout, self.stats.stray_bytes - noise)

    async def run(self, script: Script[T], first: Request | None = None) -> T:
        """Run a script of the family and return its result; as `play`, with `ask`."""
        return await play(script, self.ask, first)

    async def pause(self, seconds: float) -> None:
        """Sleep as an operation does: `interrupt` and a dead port end it."""
        with suppress(TimeoutError):
            await self._waiting.wait(seconds, Awaited.TIME)

    async def quieten(self) -> bool:
        """Send STOP and wait until the line is quiet; False if it did not fall quiet in time."""
        await self._until_it_listens()
        self.write((self._device.stop(),))
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

    def keep_alive(self, request: Request) -> bool:
        """Send a request in the midst of a stream, if the device listens; its response is part of the stream."""
        listens = self.fatal is None and not self._stopper.wanted and not self._readiness.is_pausing
        if listens:
            self.write((request,))
        return listens

    # ------------------------------------------------------------------------------------------------ stopping

    def stop_device(self) -> None:
        """Write the stop requests as soon as the device listens, now if it does. Never blocks or raises.

        Nothing is delivered any more; packets that still come are drained.
        """
        self.deliver_to(None)
        self._stopper.stop()

    async def stopped(self) -> None:
        """As `Stopper.written`."""
        await self._stopper.written()

    async def settled_down(self) -> None:
        """As `Stopper.surely_settled`, shielded from anyio's cancellation."""
        with anyio.CancelScope(shield=True):
            await self._stopper.surely_settled()

    def hang_up(self, *, patient: bool = True) -> None:
        """Leave the device still, then close the port; without waiting. Nothing is delivered any more.

        After the event loop was closed no timer can do that, so it blocks as `abandon` does.

        Args:
            patient: As for `Stopper.hang_up`.
        """
        if self._loop.is_closed():
            self.abandon()
            return
        self._port.announce_close()
        self.deliver_to(None)
        self._stopper.hang_up(patient=patient)

    async def close(self, *, patient: bool = True) -> None:
        """As `hang_up`, and return when the port is closed.

        The waiting is bounded and shielded from anyio's cancellation. A second native cancellation ends it as soon
        as the device is seen still; timers go on with closing the port.
        """
        self.hang_up(patient=patient)
        if self._loop.is_closed():
            return
        await self.settled_down()
        with anyio.CancelScope(shield=True):
            await self._port.wait_closed()

    def abandon(self) -> None:
        """Leave the device still and close the port, even without a loop: for finalizers. Blocks shortly.

        Where timers do so already, on a loop that runs, they go on.
        """
        if self._stopper.ends_by_itself and self._loop.is_running():
            return
        self._stopper.cancel()
        requests = () if self._stopper.still else self._stopper.requests()
        # A response that is outstanding is not received any more. A healthy device has sent it after this time.
        patient_until = self._loop.time() + RESPONSE_S
        for request in requests:
            if request.dtr is not None:
                self._port.set_dtr(request.dtr)
        self._port.abandon(b"".join(request.data for request in requests), self._readiness.free_at(patient_until))

    def settled(self, still: bool) -> None:
        """As `Writer`."""
        self._link.forget()
        if still:
            self._link.drained()
            if self._on_still is not None:
                self._on_still()
        self._waiting.wake(Awaited.CHANGE)

    def close_port(self) -> None:
        """Begin to close the port."""
        self._port.close_soon()

    def write(self, requests: Sequence[Request]) -> None:
        """Write requests, now; the pause that they demand counts from now."""
        # What KeyboardInterrupt kept from being written is not written before something else.
        self._link.data_to_send()
        # Noted before anything is written: KeyboardInterrupt may come right behind it, and a finalizer waits then.
        new = [request for request in requests if request.dtr is None or request.dtr is not self.dtr]
        self._readiness.pause(max((request.settle for request in new), default=0.0))
        for request in requests:
            if request.baudrate is not None:
                self.set_baudrate(request.baudrate)
            self._link.send_request(request)
            self._stopper.sent(request)
            if request.ends_stream:
                # Also what came before anybody could read it: it is no part of the next stream.
                self.deliver_to(None)
            if request.dtr is not None:
                self.dtr = request.dtr
                self._port.set_dtr(request.dtr)
            if self._stopper.is_reset(request):
                # Noted here: whoever wrote it may be cancelled before anybody waits until the device has booted.
                self.reset_at = self._loop.time()
            # One by one: where the line carries datagrams, a device may look for one request in each.
            if data := self._link.data_to_send():
                self._port.write(data)
        self._waiting.wake(Awaited.CHANGE)

    # ------------------------------------------------------------------------------------------------ inside

    async def _until_it_listens(self) -> None:
        """Wait until the device accepts a request."""
        while True:
            self._waiting.check()
            now, until = self._loop.time(), self._readiness.next_question_at()
            if self._stopper.wanted:
                until = now + PATIENCE_S
            elif not until:
                return
            with suppress(TimeoutError):
                await self._waiting.wait(until - now, Awaited.CHANGE)
