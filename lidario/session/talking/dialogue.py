"""Requests and responses of one device, with the timing the device demands.

Between `Link`, which knows no time, and `Scanner`, which knows no bytes. It runs the scripts of a family, one
request at a time. A request is written only when the device listens: when the time that the last request needs
has passed, and no response is outstanding. A device discards what comes earlier and does not say so.

What an operation waits for, and what ends the waiting, is in `Waiting`; what becomes of received
bytes in `Intake`.
"""

import math
from collections.abc import Callable, Coroutine, Sequence
from typing import Any, TypeVar

import anyio

from lidario.errors import LidarError, ResponseTimeout, SessionClosed, StreamFailed
from lidario.families.base import Device, Script, Timing
from lidario.port.port import Port
from lidario.session.talking.intake import Intake
from lidario.session.talking.play import play
from lidario.session.talking.readiness import CLOCK_S, Readiness
from lidario.session.talking.stopper import PATIENCE_S, Stopper
from lidario.session.talking.trouble import mistake_of_ours, twin_of
from lidario.session.talking.waiting import Awaited, Waiting
from lidario.wire.envelope import Request
from lidario.wire.states import LinkState

T = TypeVar("T")

RESPONSE_S = 0.02
"""Time in which a healthy device has responded."""
_AWAITING = LinkState.AWAIT_RESPONSE


class Dialogue(Intake, Waiting):
    """Talks to one device over one port."""

    def __init__(self, port: Port, device: Device, timing: Timing) -> None:
        Intake.__init__(self, port)
        Waiting.__init__(self)
        self.timing: Timing = timing  # how long the device takes for what
        # Called once, with the error, when the dialogue is over for good before it was closed.
        self.on_lost: Callable[[LidarError], None] | None = None
        self.protection_stops: int = 0  # times the device was found to have stopped to protect itself
        # When the device was told to restart, on the loop's clock; None if it has responded since. A device that
        # boots discards what it is sent.
        self.reset_at: float | None = None
        self.device: Device = device  # the device as its family sees it
        self._longest = self._until = math.inf
        # When bytes came last while no response was outstanding.
        self._heard_at = -math.inf
        # What has woken the device for the operation in progress.
        self._wake: Request | None = None
        self._readiness = Readiness(self.link)
        self.stopper: Stopper = Stopper(self, self._readiness, device, timing.quiet_s)  # writes the stop requests
        port.attach(self, self.stopper.unseen)

    # ------------------------------------------------------------------------------------------------ receiving

    def responded(self, payload: bytes) -> None:
        self._readiness.responded()
        if self.stopper.asks:
            self.stopper.answered()
        else:
            self.wake(Awaited.RESPONSE, payload)

    def taken(self) -> None:
        if self.link.state is not _AWAITING:
            self._heard_at = self._loop.time()
            # A response that was given up is among what has come.
            self._readiness.late_until = self._readiness.silent_since = 0.0
            if self._awaited is Awaited.CHANGE:
                self.wake(Awaited.CHANGE)
            if self.stopper.wanted:
                self.stopper.try_now()
            elif (
                self.link.state is not LinkState.STREAMING
                and self._heard_at >= self.stopper.again_at
                and self.stats.stray_bytes + self.stats.drained_bytes > self.stopper.unasked_limit
            ):
                self.stopper.heard_unasked()

    def mistaken(self, error: Exception, when: str = "at what the device sent") -> None:
        """As `Intake.mistaken`. It ends the dialogue: it must not leave readers waiting."""
        if self.fatal is None:
            self.fail(mistake_of_ours(f"lidario failed {when}", error))
        self.stop_device()

    def connection_lost(self, error: LidarError | None) -> None:
        self.stopper.cancel()
        if error is not None:
            # Behind what came before, which is still worth having.
            self._turns.add(map(self.fail, (error,)))

    def fail(self, error: LidarError) -> None:
        """End the dialogue for good; the first error wins."""
        if self.fatal is not None:
            return
        self.end(error)
        self.interrupt(error)
        if self.on_lost is not None:
            self.on_lost(error)

    # ------------------------------------------------------------------------------------------------ operations

    def begin(self) -> None:
        """An operation begins; what interrupted or woke the one before does not concern it. Raises `fatal`."""
        if self.fatal is not None:
            raise twin_of(self.fatal)
        self._ends = self._wake = None

    def hurry(self, longest: float = math.inf, until: float = math.inf) -> None:
        """Ask each question once; without arguments, as often as is usual again.

        Args:
            longest: Seconds for which each response is waited for at most.
            until: How long all of them together are waited for, on the loop's clock. A device that has responded to
                none until then is given the shortest time for each that follows.
        """
        self._longest, self._until = longest, until

    async def ask(self, request: Request) -> bytes:
        """Send a request when the device listens; return the payload of its response, empty if it has none.

        Cancelling gives up the response; should it still come, it is counted and dropped.

        Raises:
            ResponseTimeout: No response, however often it was asked.
            DeviceLost: The port died.
            SessionClosed: The session was closed meanwhile.
        """
        noise, timeout = self.stats.stray_bytes, request.timeout
        if request.dtr is not None:
            self._wake = request
        for _ in range(1 if min(self._longest, self._until) < math.inf else request.attempts):
            await self._until_it_listens()
            if self._wake is not None and self._wake.dtr is not self.port.dtr:
                # Another task has stopped it meanwhile: it is stopped again behind this operation.
                self.write((self._wake,))
                await self._until_it_listens()
            timeout = min(request.timeout, self._longest, max(self._until - self._loop.time(), RESPONSE_S))
            # As the pause in `write`: noted before it is written.
            self._readiness.asks(timeout)
            self.write((request,))
            if request.expects is None:
                return b""
            try:
                payload = await self.wait(timeout, Awaited.RESPONSE)
                if payload is None:
                    self._readiness.give_up()
                    continue
                self.reset_at = None
                if request.stream is None:
                    self.chronicle.responded(request.data, request.expects.type, payload)
                else:
                    self.chronicle.started(request.data)
                return payload
            except BaseException:
                # The device is still busy with it: the next request waits until it has responded.
                self.link.abandon()
                raise
        raise ResponseTimeout(request.name, timeout, self.stats.stray_bytes - noise)

    def run(self, script: Script[T]) -> Coroutine[Any, Any, T]:
        """Run a script of the family and return its result, to be awaited; as `play`, with `ask`."""
        return play(script, self.ask)

    async def quieten(self, *, stop: bool = True) -> bool:
        """Wait until the line is quiet; False if it did not fall quiet in time.

        Args:
            stop: Whether to send STOP before, or only to wait after a STOP that was sent.
        """
        if stop:
            await self._until_it_listens()
            self.write((self.device.stop(),))
        if self.stopper.wanted or self.link.state is not LinkState.DRAINING:
            await self._until_it_listens()
        # What comes during the pause behind STOP was under way already. The waiting for silence begins behind it.
        listens_at = max(self._loop.time(), self._readiness.listens_at)
        while self.link.state is LinkState.DRAINING:
            now, last = self._loop.time(), max(listens_at, self._heard_at)
            if (left := last + self.timing.quiet_s - now) <= CLOCK_S:
                self.link.drained()
            elif now > listens_at + self.timing.drain_s:
                return False
            else:
                await self.wait(left)
        return True

    def keep_alive(self, request: Request) -> bool:
        """Send a request in the midst of a stream, if the device listens; its response is part of the stream."""
        is_pausing = self._loop.time() < self._readiness.listens_at
        listens = self.fatal is None and not self.stopper.wanted and not is_pausing
        if listens:
            self.write((request,))
        return listens

    def go_back_to(self, baudrate: int) -> None:
        """Have the line at a speed again. A device that measures another one hears nothing until it is back."""
        self._readiness.measures_speed = False
        if self.port.baudrate != baudrate:
            self._readiness.goes_back()
            self.port.set_baudrate(baudrate)

    # ------------------------------------------------------------------------------------------------ stopping

    def stop_device(self) -> None:
        """Write the stop requests as soon as the device listens, now if it does. Never blocks or raises.

        Nothing is delivered any more; packets that still come are drained.
        """
        self.deliver_to(None)
        self.stopper.stop()

    async def leave_still(self) -> None:
        """As `stop_device`, and return when the device was seen still; StreamFailed where it was not."""
        self.stop_device()
        await self._until_it_listens()
        if not self.port.is_open:
            await self.wait(PATIENCE_S)  # it is told in a moment that the port died
        if not self.stopper.still:
            raise StreamFailed(self.stopper.why)

    def hang_up(self, *, patient: bool = True) -> None:
        """Leave the device still, then close the port; without waiting. Nothing is delivered any more.

        After the event loop was closed no timer can do that, so it blocks as `abandon` does.
        """
        if self._loop.is_closed():
            self.abandon()
            return
        self.port.is_closing = True
        self.deliver_to(None)
        self.stopper.hang_up(patient=patient)

    async def close(self, *, patient: bool = True) -> None:
        """As `hang_up`, and return when the port is closed.

        The waiting is bounded and shielded from anyio's cancellation. A second native cancellation ends it as soon
        as the device is seen still; timers go on with closing the port.
        """
        self.hang_up(patient=patient)
        if self._loop.is_closed():
            return
        # One scope behind the other: where Ctrl-C comes between two lines of an inner one, the outer one fails.
        await self.stopper.surely_settled()
        with anyio.CancelScope(shield=True):
            await self.port.wait_closed()

    def abandon(self) -> None:
        """Leave the device still and close the port, even without a loop: for finalizers. Blocks shortly.

        Where timers do so already, on a loop that runs, they go on. Tasks that still wait here end.
        """
        self.end(SessionClosed("the session was let go, and is over"))
        if self.stopper.ends_by_itself and self._loop.is_running():
            return
        requests, last = () if self.stopper.still else self.stopper.requests(), self.stopper.last_requests()
        # A response that is outstanding is not received any more. A healthy device has sent it after this time.
        patient_until = self._loop.time() + RESPONSE_S
        for request in requests:
            if request.dtr is not None and request.dtr is not self.port.dtr:
                self.port.set_dtr(request.dtr)
        # The last ones are written first: nothing is heard for a while behind STOP. But DTR makes some models deaf.
        data = b"".join(request.data for request in (*last, *requests))
        dtr = next((request.dtr for request in last if request.dtr is not None), None)
        # As in `Stopper`, nothing may show whether the device has heard them. Then they are written twice.
        again_s = max((request.settle for request in requests if not request.acknowledged), default=0.0)
        self.port.abandon(data, self._readiness.free_at(patient_until), dtr, again_s)

    def settled(self, still: bool) -> None:
        """The stop requests are done with; the device is `still`, or goes on sending."""
        self.link.forget()
        if still:
            self.link.drained()
        self.wake(Awaited.CHANGE)

    def write(self, requests: Sequence[Request]) -> None:
        """Write requests, now; the pause that they demand counts from when they are written."""
        # Noted before anything is written: KeyboardInterrupt may come right behind it, and a finalizer waits then.
        new = [request for request in requests if request.dtr is None or request.dtr is not self.port.dtr]
        if settle := max((request.settle for request in new), default=0.0):
            self._readiness.pause(settle)
        for request in requests:
            self._readiness.measures_speed = request.baudrate is not None
            if request.baudrate is not None:
                self.port.set_baudrate(request.baudrate)
            self.link.send_request(request)
            self.stopper.sent(request)
            if request.stream is not None:
                # What came of another one before anybody could read it is no part of this stream.
                self.deliver_to(None)
            if request.dtr is not None and request.dtr is not self.port.dtr:
                self.port.set_dtr(request.dtr)
            if request.boots:
                # Noted here: whoever wrote it may be cancelled before anybody waits until the device has booted.
                self.reset_at = self._loop.time()
            # One by one: where the line carries datagrams, a device may look for one request in each.
            if request.data:
                self.port.write(request.data)
        if settle:
            # Once more: a busy machine may have let the program stand before the last of them.
            self._readiness.pause(settle)

    # ------------------------------------------------------------------------------------------------ inside

    async def _until_it_listens(self) -> None:
        """Wait until the device accepts a request."""
        while True:
            if self._ends is not None:
                raise twin_of(self._ends)
            now, readiness = self._loop.time(), self._readiness
            if self.link.state is _AWAITING and readiness.due - now <= CLOCK_S:
                readiness.give_up()
            owes = self.link.state is _AWAITING
            until = readiness.due if owes else readiness.listens_at
            # Where the line's speed is being measured, they wait for that.
            stops = self.stopper.wanted and not readiness.measures_speed
            if stops:
                until = now + PATIENCE_S
            elif until - now <= CLOCK_S:
                return
            # What is received does not shorten a pause that the device demands.
            await self.wait(until - now, Awaited.CHANGE if stops or owes else Awaited.TIME)
