"""The stream of one device: who wants it, and what is done so that it runs, pauses and ends.

Readers only say that they want scans (`join`) and that they do not any more (`leave`, `linger`). One task, which
the session owns, brings the stream up: so cancelling a reader, or a query, never ends other people's streams.
Where the stream stands is one `State`, and every step is in the table of `states`.

One operation at a time talks to the device and holds the lock: the start of a stream, a query, a reset. Stopping
does not wait for it. `leave` and `stop` end a start in progress at once, and the stop requests are written as
soon as the device listens. `close` ends every operation at once.
"""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Awaitable, Callable
from typing import NamedTuple, TypeVar

import anyio

from lidario.errors import InternalError, LidarError, LocalProtocolError, SessionClosed, StreamFailed, Unsupported
from lidario.families.base import Device, Script
from lidario.model import Scan, ScanMode
from lidario.revolution.assemble import AssemblerStats
from lidario.session.dialogue import Dialogue
from lidario.session.log import Trouble
from lidario.session.modes import Wanted, agree
from lidario.session.running import Running, Totals
from lidario.session.states import Event, State, next_state
from lidario.session.stream import Hub, Mailbox
from lidario.session.twin import twin_of

__all__ = ["LINGER_S", "Scanner"]

T = TypeVar("T")
_log = logging.getLogger("lidario")

LINGER_S = 1.0
"""How long a stream goes on that nobody reads any more, where its reader did not say that it is the last: single
scans in a row must not restart the rotor each time. Users are promised two seconds."""
LEAVE_TIMEOUT_S = 2.0
STOP_ATTEMPTS = 3


class _Stopped(LidarError):
    """Ends a start that nobody wants any more. Never leaves this module."""


class _Joining(NamedTuple):
    """A reader that waits to be let in, and what it asked for."""

    mailbox: Mailbox
    mode: str | int | None
    force: bool


class Scanner:
    """The stream of one device.

    Attributes:
        hub: Everybody who reads it.
        totals: Counters since the session was opened.
        latest: The last scan, or None.
    """

    def __init__(self, dialogue: Dialogue, device: Device, latency: float) -> None:
        self.hub: Hub = Hub()
        self.totals: Totals = Totals(AssemblerStats())
        self.latest: Scan | None = None
        self._dialogue = dialogue
        self._device = device
        self._latency = latency
        self._loop = asyncio.get_running_loop()
        self._lock = asyncio.Lock()
        self._state = State.IDLE
        self._wanted: Wanted | None = None
        self._running: Running | None = None
        self._joining: list[_Joining] = []
        self._ran = False
        self._worker: asyncio.Task[None] | None = None
        self._worker_has_lock = False
        self._linger: asyncio.TimerHandle | None = None
        self._modes: tuple[ScanMode, ...] = ()
        self._over: SessionClosed | None = None
        self._trouble = Trouble(_log)
        self._watchers: tuple[Callable[[Scan], None], ...] = ()
        dialogue.on_lost = self._lost
        dialogue.stopper.on_still = self._still

    @property
    def state(self) -> State:
        """What becomes of the stream at the moment."""
        return self._state

    @property
    def is_scanning(self) -> bool:
        """Whether a stream runs, or is about to."""
        return self._state in (State.STARTING, State.RUNNING, State.INTERRUPTED)

    @property
    def mode(self) -> ScanMode | None:
        """The scan mode that runs or is about to, if it is known."""
        return self._wanted.mode if self._wanted is not None and self.is_scanning else None

    # ------------------------------------------------------------------------------------------------ readers

    def join(self, mailbox: Mailbox, mode: str | int | None, force: bool) -> None:
        """As `ScanSource`."""
        self._cancel_linger()
        if mode is None and len(self.hub) and not self._joining:
            self.hub.add(mailbox)
        else:
            self._joining.append(_Joining(mailbox, mode, force))
        if self._state in (State.IDLE, State.STOPPING):
            self._ran = False
            self._go(Event.WANT)
        self._work_soon()

    def leave(self, mailbox: Mailbox) -> None:
        """As `ScanSource`."""
        self._forget(mailbox)
        if not self._readers() and self.is_scanning:
            self._unwant()

    def linger(self, mailbox: Mailbox) -> None:
        """As `ScanSource`."""
        self._forget(mailbox)
        if not self._readers() and self.is_scanning and self._linger is None:
            self._linger = self._loop.call_later(LINGER_S, self._linger_over)

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

    def finish(self) -> None:
        """As `Audience`."""
        if self.is_scanning:
            self._end_readers(None)
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
        async with self._lock:
            self._check_open()
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
        self._end_readers(None)
        self._unwant()
        await self.left()
        async with self._lock:
            self._check_open()
            self._dialogue.begin()
            if not self.is_scanning:
                await self._silence()

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

    def end(self, error: SessionClosed) -> None:
        """The session is over: end every reader and operation with `error`. The device is not told."""
        if self._over is None:
            self._over = error
            self._end_readers(error)
            self._cancel_linger()
            self._rest()
            self._go(Event.CLOSE)
            self._dialogue.interrupt(error)

    def abandon(self) -> None:
        """Nobody holds the session any more: let go of every timer. The device is not told."""
        self._cancel_linger()
        self._rest()

    async def ended(self) -> None:
        """Return when the task that starts streams has ended, after `end`."""
        if self._worker is not None:
            await asyncio.wait([self._worker])

    # ------------------------------------------------------------------------------------------------ the worker

    def _work_soon(self) -> None:
        """Have the worker do what is to be done, if there is anything."""
        if self._worker is None and (self._joining or self._state is State.STARTING):
            self._worker = self._loop.create_task(self._work(), name="lidario: start the stream")

    async def _work(self) -> None:
        """Let the readers in who wait for it, and start the stream they want; until nothing is left to do."""
        try:
            while self._joining or self._state is State.STARTING:
                async with self._lock:
                    self._dialogue.begin()
                    self._worker_has_lock = True
                    try:
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

    async def _let_in(self) -> None:
        """Let in the readers who wait, as far as the modes they ask for go together."""
        while self._joining:
            if not self._modes:
                await self._interrupt()
                self._modes = await self._dialogue.run(self._device.modes())
                continue
            mailbox, mode, force = self._joining.pop(0)
            try:
                wanted = agree(self._modes, mode, force, self._wanted, alone=not len(self.hub))
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
        stream = await self._dialogue.run(self._device.start(wanted.mode, force=wanted.force))
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
            failed=self._fail,
        )
        self._running.begin()

    def _could_not_start(self, error: LidarError) -> None:
        """Tell everybody who waits for the stream."""
        if self._ran:
            failure = StreamFailed(f"the stream could not be started again: {error}")
            failure.__cause__ = error
            error = failure
        self._end_readers(error)
        if self.is_scanning:
            self._unwant()

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
        self._wanted = None
        self._cancel_linger()
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
        self.latest = scan
        for watcher in self._watchers:
            watcher(scan)
        self.hub.publish(scan)

    def _fail(self, error: StreamFailed) -> None:
        """End the stream for everybody; the session goes on."""
        self._trouble.tell("the stream ended: %s", error)
        self._end_readers(error)
        self._unwant()

    def _lost(self, error: LidarError) -> None:
        """The port died, or we failed: the session is over."""
        self._trouble.tell("the session ended: %s", error)
        self._end_readers(error)
        self._cancel_linger()
        self._rest()
        self._go(Event.CLOSE)

    # ------------------------------------------------------------------------------------------------ small things

    def _readers(self) -> int:
        return len(self.hub) + len(self._joining)

    def _forget(self, mailbox: Mailbox) -> None:
        self.hub.discard(mailbox)
        self._joining = [each for each in self._joining if each.mailbox is not mailbox]

    def _end_readers(self, error: LidarError | None) -> None:
        joining, self._joining = self._joining, []
        for each in joining:
            self.hub.add(each.mailbox)
        self.hub.end(error)

    def _linger_over(self) -> None:
        self._linger = None
        if not self._readers() and self.is_scanning:
            self._unwant()

    def _cancel_linger(self) -> None:
        if self._linger is not None:
            self._linger.cancel()
            self._linger = None

    def _check_open(self) -> None:
        if self._over is not None:
            raise twin_of(self._over)
