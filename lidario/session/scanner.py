"""The stream of one device: who wants it, and what is done so that it runs, pauses and ends.

Readers only say that they want scans (`join`) and that they do not any more (`leave`, `linger`). One task, which
the session owns, brings the stream up: so cancelling a reader, or a query, never ends other people's streams.
Where the stream stands is one `State`, and every step is in the table of `states`.

One operation at a time talks to the device and holds the lock: the start of a stream, a query, a reset. Stopping
does not wait for it. `leave` and `stop` end a start in progress at once, and the stop requests are written as
soon as the device listens. `close` ends every operation at once.

Where the session comes back by itself (`lidario.session.reconnect`), a lost line ends neither the readers nor the
session: operations fail, readers wait, and `adopt` has the stream started again on the new line.
"""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Awaitable, Callable
from typing import TypeVar

import anyio

from lidario.errors import (
    DeviceFault,
    DeviceLost,
    InternalError,
    LidarError,
    LocalProtocolError,
    RemoteProtocolError,
    ResponseTimeout,
    StreamFailed,
    Unsupported,
)
from lidario.families.base import Device, Script
from lidario.model import ScanMode
from lidario.revolution.assemble import AssemblerStats
from lidario.scan import Scan
from lidario.session.dialogue import Dialogue
from lidario.session.inquiry import Inquiry
from lidario.session.log import Trouble
from lidario.session.modes import Wanted, agree
from lidario.session.readers import Readers
from lidario.session.running import Failure, Running, Totals
from lidario.session.states import Event, State, next_state
from lidario.session.stream import Hub, Mailbox
from lidario.session.twin import twin_of

__all__ = ["Scanner"]

T = TypeVar("T")
_log = logging.getLogger("lidario")

LEAVE_TIMEOUT_S = 2.0
STOP_ATTEMPTS = 3
_CURABLE = (DeviceLost, StreamFailed, ResponseTimeout, DeviceFault, RemoteProtocolError)
"""What a new line to the same device may cure; not what the user or lidario did wrong."""


class _Stopped(LidarError):
    """Ends a start that nobody wants any more. Never leaves this module."""


class Scanner:
    """The stream of one device.

    Attributes:
        totals: Counters since the session was opened.
        latest: The last scan, or None.
        inquiry: Asks the device when a stream fails.
        come_back: Called with the reason, and the number of scans so far, when the line to the device is no good
            any more; then `adopt` is expected, or `end`. None where such an error ends the streams or the session.
    """

    def __init__(self, dialogue: Dialogue, device: Device, latency: float) -> None:
        self._readers = Readers(self._deserted)
        self.totals: Totals = Totals(AssemblerStats())
        self.latest: Scan | None = None
        self.come_back: Callable[[LidarError, int], None] | None = None
        self._continued: Scan | None = None
        self._dialogue = dialogue
        self._device = device
        self._latency = latency
        self._loop = asyncio.get_running_loop()
        self._lock = asyncio.Lock()
        self._state = State.IDLE
        self._wanted: Wanted | None = None
        self._running: Running | None = None
        self._ran = False
        self._worker: asyncio.Task[None] | None = None
        self._worker_has_lock = False
        self._modes: tuple[ScanMode, ...] = ()
        self._over: LidarError | None = None
        self._trouble = Trouble(_log)
        self._failure: Failure | None = None
        self.inquiry: Inquiry = Inquiry(dialogue, device, self.totals, self._trouble)
        self._watchers: tuple[Callable[[Scan], None], ...] = ()
        self._attach()

    @property
    def hub(self) -> Hub:
        """Everybody who reads it."""
        return self._readers.hub

    @property
    def state(self) -> State:
        """What becomes of the stream at the moment."""
        return self._state

    @property
    def is_scanning(self) -> bool:
        """Whether a stream runs, or is about to."""
        return self._state in (State.STARTING, State.RUNNING, State.INTERRUPTED, State.AWAITED)

    @property
    def over(self) -> LidarError | None:
        """What `end` ended the session with, if it did."""
        return self._over

    @property
    def is_away(self) -> bool:
        """Whether there is no line to the device, and the session is about to come back."""
        return self._state in (State.AWAY, State.AWAITED)

    @property
    def mode(self) -> ScanMode | None:
        """The scan mode that runs or is about to, if it is known."""
        return self._wanted.mode if self._wanted is not None and self.is_scanning else None

    # ------------------------------------------------------------------------------------------------ readers

    def join(self, mailbox: Mailbox, mode: str | int | None, force: bool) -> None:
        """As `ScanSource`."""
        self._readers.add(mailbox, mode, force)
        if self._state in (State.IDLE, State.STOPPING, State.AWAY):
            self._ran = False
            self._go(Event.WANT)
        self._work_soon()

    def leave(self, mailbox: Mailbox) -> None:
        """As `ScanSource`."""
        self._readers.discard(mailbox)
        if not len(self._readers) and self.is_scanning:
            self._unwant()

    def linger(self, mailbox: Mailbox) -> None:
        """As `ScanSource`."""
        self._readers.discard(mailbox)
        if not len(self._readers) and self.is_scanning:
            self._readers.linger()

    async def left(self) -> None:
        """As `ScanSource`."""
        with anyio.CancelScope(shield=True), anyio.move_on_after(LEAVE_TIMEOUT_S):
            await self._dialogue.stopper.written()

    # ------------------------------------------------------------------------------------------------ a replay

    @property
    def is_waiting(self) -> bool:
        """As `Audience`."""
        return self.hub.is_waiting

    def on_taken(self, callback: Callable[[], None]) -> None:
        """As `Audience`."""
        self.hub.on_taken(callback)

    def restart(self) -> None:
        """As `Audience`."""
        if self._state is State.RUNNING and not self._worker_has_lock:
            self.totals.interruptions += 1
            self._go(Event.INTERRUPT)
            self._rest()
            if len(self.hub):
                self._go(Event.RESUME)
            self._work_soon()

    def deliver(self, scan: Scan) -> None:
        """As `Audience` of another machine's lidar: a scan that came whole."""
        if self._state is State.RUNNING:
            self.totals.assembled.scans += 1
            self._publish(scan)

    def finish(self) -> None:
        """As `Audience`."""
        if self.is_scanning:
            self._readers.end(None)
            self._unwant()

    # ------------------------------------------------------------------------------------------------ operations

    async def modes(self) -> tuple[ScanMode, ...]:
        """The scan modes of the device, asked for once."""
        if not self._modes:
            self._modes = await self.ask(self._device.modes)
        return self._modes

    async def ask(self, script: Callable[[], Script[T]]) -> T:
        """Run a script of the family, with the stream interrupted if one runs, and started again after it.

        A script that asks the device nothing, or refuses, does not interrupt the stream. Cancelling gives up the
        response; the stream is started again all the same.
        """
        held = script()
        try:
            first = next(held)
        except StopIteration as stop:
            result: T = stop.value
            return result
        try:
            return await self.between(lambda: self._dialogue.run(held, first))
        finally:
            held.close()

    async def between(self, action: Callable[[], Awaitable[T]], *, vital: bool = False) -> T:
        """Await `action` while no stream runs; the stream is started again after it, whatever becomes of it.

        A `vital` action is one without which no stream can be started: when it fails, the streams end with it.
        """
        asked = self._dialogue
        async with self._lock:
            self._check_open()
            if self.is_away or self._dialogue is not asked:
                raise DeviceLost("the line to the lidar was lost before this request was sent: ask again")
            self._dialogue.begin()
            try:
                await self._interrupt()
                return await action()
            except LidarError as error:
                if vital:
                    self._could_not_start(error)
                raise
            finally:
                self._resume()

    async def stop(self) -> None:
        """Stop laser and motor, end every stream, and return when the line is quiet."""
        self._check_open()
        self._readers.end(None)
        self._unwant()
        await self.left()
        async with self._lock:
            self._check_open()
            self._dialogue.begin()
            try:
                if not self.is_scanning and not self.is_away:
                    await self._silence()
            except DeviceLost:
                if not self.is_away:
                    raise
                # It is told to stop as soon as it is back.

    def watch(self, watcher: Callable[[Scan], None]) -> None:
        """Call `watcher` with each scan, before its readers get it."""
        self._watchers = (*self._watchers, watcher)

    def unwatch(self, watcher: Callable[[Scan], None]) -> None:
        """Call it no more; ignored where it is not there."""
        self._watchers = tuple(each for each in self._watchers if each != watcher)

    def set_zero_offset(self, degrees: float) -> None:
        """Have the stream that runs add another zero-angle offset, clockwise degrees."""
        if self._running is not None:
            self._running.set_zero_offset(degrees)

    def end(self, error: LidarError) -> None:
        """The session is over: end every reader and operation with `error`. The device is not told."""
        if self._over is None:
            self._over = error
            self._readers.end(error)
            self._readers.cancel_linger()
            self._rest()
            self._go(Event.CLOSE)
            self._dialogue.interrupt(error)

    def abandon(self) -> None:
        """Nobody holds the session any more: let go of every timer. The device is not told."""
        self._readers.cancel_linger()
        self._rest()

    async def unused(self) -> None:
        """Return when no operation holds the line that was lost. Each has failed by then, so this takes no time."""
        async with self._lock:
            pass

    def adopt(self, dialogue: Dialogue, device: Device) -> None:
        """There is a new line to the device: start the stream on it if one is wanted, else stop the device."""
        self._dialogue, self._device = dialogue, device
        self.inquiry.adopt(dialogue, device)
        self._attach()
        self._go(Event.RETURN)
        if self.is_scanning:
            self._work_soon()
        else:
            dialogue.stop_device()

    async def ended(self) -> None:
        """Return when the task that starts streams has ended, after `end`."""
        if self._worker is not None:
            await asyncio.wait([self._worker])

    # ------------------------------------------------------------------------------------------------ the worker

    @property
    def _has_work(self) -> bool:
        """Whether readers wait to be let in, a stream is to be started, or one has failed."""
        return bool(self._readers.joining) or self._state is State.STARTING or self._failure is not None

    def _work_soon(self) -> None:
        """Have the worker do what is to be done, if there is anything."""
        if self._worker is None and self._has_work and not self.is_away:
            self._worker = self._loop.create_task(self._work(), name="lidario: start the stream")

    async def _work(self) -> None:
        """Let the readers in who wait for it, and start the stream they want; until nothing is left to do."""
        try:
            while self._has_work:
                async with self._lock:
                    if self.is_away:
                        return
                    self._dialogue.begin()
                    self._worker_has_lock = True
                    try:
                        await self._judge()
                        await self._let_in()
                        if self._state is State.STARTING and self._wanted is not None:
                            await self._start(self._wanted)
                    except _Stopped:
                        continue
                    except LidarError as error:
                        self._could_not_start(error)
                    finally:
                        self._worker_has_lock = False
        except Exception as error:
            _log.exception("lidario failed when it started a stream")
            failure = InternalError(f"lidario failed when it started a stream ({error!r}); please report this")
            failure.__cause__ = error
            self._dialogue.fail(failure)
            self._dialogue.stop_device()
        finally:
            self._worker = None

    async def _judge(self) -> None:
        """If a stream has failed, ask the device; then have the stream started again, or end it with the reason."""
        failure = self._failure
        if failure is None:
            return
        try:
            await self._interrupt()
            if failure.error is not None:
                # It may have begun all the same, and a device that scans hears no question.
                await self._dialogue.quieten()
            await self.inquiry.about(failure)
        except (StreamFailed, DeviceFault) as error:
            if failure.error is not None and isinstance(error, StreamFailed):
                self._could_not_start(failure.error)
            else:
                self._fail(error)
        else:
            if self._continued is not None:
                # What passed meanwhile is missing, as it is where the line was lost.
                self.totals.assembled.leave_off(self._continued)
            if self._state is State.INTERRUPTED:
                self._go(Event.RESUME)
        finally:
            self._failure = None

    async def _let_in(self) -> None:
        """Let in the readers who wait, as far as the modes they ask for go together."""
        while self._readers.joining:
            if not self._modes:
                await self._interrupt()
                self._modes = await self._dialogue.run(self._device.modes())
                continue
            mailbox, mode, force = self._readers.joining.pop(0)
            try:
                modes = (*self._modes, *self._device.unlisted_modes())
                wanted = agree(modes, mode, force, self._wanted, alone=not len(self.hub))
            except (LocalProtocolError, Unsupported) as error:
                mailbox.end(error)
                continue
            self.hub.add(mailbox)
            if wanted != self._wanted:
                self._wanted = wanted
                await self._interrupt()
        if not len(self.hub) and self.is_scanning:
            self._unwant()
        elif self._state is State.INTERRUPTED:
            self._go(Event.RESUME)

    async def _start(self, wanted: Wanted) -> None:
        await self._silence()
        if self.inquiry.doubtful:
            await self.inquiry.beforehand()
        try:
            stream = await self._dialogue.run(self._device.start(wanted.mode, force=wanted.force))
        except ResponseTimeout as error:
            # A device that has stopped to protect itself starts no stream, and does not say so by itself.
            self._failure = Failure(f"no stream begins ({error})", "does it know this scan mode?", error=error)
            return
        if self._state is not State.STARTING or wanted != self._wanted:
            # Nobody wants it any more, and the stop requests are written already.
            return
        self._go(Event.STARTED)
        self._ran = True
        self._running = Running(
            stream,
            self._dialogue,
            latency=self._latency,
            totals=self.totals,
            trouble=self._trouble,
            publish=self._publish,
            failed=self._suspect,
        )
        self._running.begin()

    def _could_not_start(self, error: LidarError) -> None:
        """Tell everybody who waits for the stream, unless the session comes back."""
        if self._depart(error):
            return
        if self._ran:
            failure = StreamFailed(f"the stream could not be started again: {error}")
            failure.__cause__ = error
            error = failure
        self._readers.end(error)
        if self.is_scanning:
            self._unwant()

    # ------------------------------------------------------------------------------------------------ the line

    def _attach(self) -> None:
        self._dialogue.on_lost = self._lost
        self._dialogue.stopper.on_still = self._still

    def _depart(self, error: LidarError) -> bool:
        """Let go of the line, if the session can come back from `error`; readers go on waiting.

        False where it cannot: then `error` ends the streams, or the session.
        """
        if self.is_away:
            return True
        if self.come_back is None or self._over is not None or not isinstance(error, _CURABLE):
            return False
        if not self.is_scanning and not isinstance(error, DeviceLost):
            return False
        if self._continued is not None:
            self.totals.assembled.leave_off(self._continued)
        self._go(Event.LOSE)
        self._failure = None
        self._rest()
        self._dialogue.on_lost = self._dialogue.stopper.on_still = None
        # Where the line still works, those who wait for a response must not wait for a device that is being left.
        lost = error if isinstance(error, DeviceLost) else DeviceLost(f"the line to the lidar is given up: {error}")
        if lost is not error:
            lost.__cause__ = error
        self._dialogue.fail(lost)
        self.come_back(error, self.totals.assembled.scans)
        return True

    # ------------------------------------------------------------------------------------------------ steps

    def _go(self, event: Event) -> None:
        before, self._state = self._state, next_state(self._state, event)
        if before is not self._state:
            _log.debug("%s: %s -> %s", event.value, before.value, self._state.value)

    async def _interrupt(self) -> None:
        """Stop the stream, not the motor, and wait until the line is quiet."""
        if self._state is State.RUNNING:
            self.totals.interruptions += 1
            self._go(Event.INTERRUPT)
            self._rest()
            await self._silence()

    def _resume(self) -> None:
        """The device is free again: have the stream started again, if it has readers."""
        if self._state is State.INTERRUPTED and len(self.hub):
            self._go(Event.RESUME)
        self._work_soon()

    async def _silence(self) -> None:
        """Have the line quiet, by as many STOP requests as that takes."""
        if self._dialogue.is_streaming or not await self._dialogue.drain():
            for _ in range(STOP_ATTEMPTS):
                if await self._dialogue.quieten():
                    return
            raise StreamFailed(f"the device goes on sending after {STOP_ATTEMPTS} STOP requests: is it listening?")

    def _unwant(self) -> None:
        """Nobody wants the stream: stop the device as soon as it listens. Never blocks or raises."""
        if self._state is State.CLOSED:
            return
        self._go(Event.UNWANT)
        self._wanted = self._failure = self._continued = self.totals.assembled.left_off = None
        self._readers.cancel_linger()
        self._rest()
        if self._worker_has_lock:
            self._dialogue.interrupt(_Stopped("the stream is not wanted any more"))
        self._dialogue.stop_device()
        if self._dialogue.stopper.still:
            self._still()

    def _rest(self) -> None:
        """The stream runs no more."""
        running, self._running = self._running, None
        if running is not None:
            running.end()

    def _still(self) -> None:
        if self._state is State.STOPPING:
            self._go(Event.STILL)

    def _publish(self, scan: Scan) -> None:
        self.latest = self._continued = scan
        for watcher in self._watchers:
            watcher(scan)
        self.hub.publish(scan)

    def _suspect(self, failure: Failure) -> None:
        """The stream brings no scans. Where noise arrives, no response would be understood; else ask the device."""
        if failure.noise:
            self._fail(StreamFailed(f"{failure.what}; only noise arrives: is the baud rate right?"))
        else:
            self._failure = failure
            self.inquiry.doubtful = True
            self._work_soon()

    def _fail(self, error: StreamFailed | DeviceFault) -> None:
        """End the stream for everybody, unless the session comes back; the session goes on."""
        if self._depart(error):
            return
        self._trouble.tell("the stream ended: %s", error)
        self._readers.end(error)
        self._unwant()

    def _lost(self, error: LidarError) -> None:
        """The port died, or we failed: the session is over, unless it comes back."""
        if self._depart(error):
            return
        self._trouble.tell("the session ended: %s", error)
        self._readers.end(error)
        self._readers.cancel_linger()
        self._rest()
        self._go(Event.CLOSE)

    # ------------------------------------------------------------------------------------------------ small things

    def _deserted(self) -> None:
        """The last reader has been gone for a second."""
        if self.is_scanning:
            self._unwant()

    def _check_open(self) -> None:
        if self._over is not None:
            raise twin_of(self._over)
