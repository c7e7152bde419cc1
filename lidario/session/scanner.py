"""The stream of one device, as those see it who read it, ask the device something meanwhile, or stop it.

Readers only say that they want scans (`join`) and that they do not any more (`leave`, `linger`). A task of the
session brings the stream up (`lidario.session.starter`). Where the stream stands is one `State`, which
`lidario.session.control` leads from step to step; what becomes of it when something fails is decided in
`lidario.session.failures`.

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

from lidario.errors import DeviceLost, LidarError
from lidario.families.base import Device, Script
from lidario.measured import changed
from lidario.model import Health, ScanMode
from lidario.scan import Scan
from lidario.session.control import StreamControl
from lidario.session.dialogue import Dialogue
from lidario.session.failures import Failures
from lidario.session.handshake import come_back
from lidario.session.inquiry import Inquiry
from lidario.session.line_changes import LineWatch
from lidario.session.log import Trouble
from lidario.session.readers import Readers
from lidario.session.running import Failure, Totals
from lidario.session.sectors import sectors_of
from lidario.session.starter import Starter
from lidario.session.states import State
from lidario.session.stream import Hub, Mailbox
from lidario.session.twin import twin_of

__all__ = ["Scanner"]

T = TypeVar("T")
_log = logging.getLogger("lidario")

WRITE_AGAIN_S = 0.005
"""How often it is tried to write a request in mid-scan, while the device does not listen."""
LEAVE_TIMEOUT_S = 2.0
"""Longest time that `left` waits. The stop requests are written within 0.6 s (`Stopper.written`)."""


class Scanner:
    """The stream of one device.

    Attributes:
        totals: Counters since the session was opened.
        hub: Everybody who reads it.
        latest: The last scan, or None.
        line: Tells what becomes of the line.
        usual_mode: Scan mode for readers that ask for none; None for the device's typical one.
    """

    def __init__(self, dialogue: Dialogue, device: Device, latency: float) -> None:
        trouble = Trouble(_log)
        self._readers = Readers(self._deserted)
        self.hub: Hub = self._readers.hub
        self._control = StreamControl(
            dialogue, device, latency, trouble, self._publish, self._suspect, self.hub.publish_sector
        )
        self.hub.on_parts = self._control.divide
        self.totals: Totals = self._control.totals
        self.latest: Scan | None = None
        self.usual_mode: str | int | None = None
        self.line: LineWatch = LineWatch()
        self._inquiry = Inquiry(dialogue, device, self.totals, trouble)
        self._dialogue = dialogue
        self._device = device
        self._lock = asyncio.Lock()
        self._loop = asyncio.get_running_loop()
        self._failures = Failures(self._control, dialogue, self._readers, self._inquiry, trouble, self.line)
        self._starter = Starter(
            self._control, dialogue, device, self._readers, self._inquiry, self._failures, self._lock
        )
        self._watchers: tuple[Callable[[Scan], None], ...] = ()

    @property
    def state(self) -> State:
        """What becomes of the stream at the moment."""
        return self._control.state

    @property
    def is_scanning(self) -> bool:
        """Whether a stream runs, or is about to."""
        return self._control.is_scanning

    @property
    def dropped(self) -> int:
        """Scans that slow readers missed, summed over all of them."""
        return self.hub.dropped

    @property
    def health(self) -> Health:
        """What the device last said of its state."""
        return self._inquiry.health

    def take_note(self, health: Health) -> None:
        """As `Inquiry.take_note`."""
        self._inquiry.take_note(health)

    @property
    def over(self) -> LidarError | None:
        """What `end` ended the session with, if it did."""
        return self._failures.over

    @property
    def is_away(self) -> bool:
        """Whether there is no line to the device, and the session is about to come back."""
        return self._control.is_away

    @property
    def mode(self) -> ScanMode | None:
        """The scan mode that runs or is about to, if it is known."""
        return self._control.mode

    # ------------------------------------------------------------------------------------------------ readers

    def join(self, mailbox: Mailbox, mode: str | int | None, force: bool) -> None:
        """As `ScanSource`."""
        usual = self.usual_mode if not self.is_scanning else None
        self._readers.add(mailbox, usual if mode is None else mode, force)
        self._control.want()
        self._starter.work_soon()

    def leave(self, mailbox: Mailbox) -> None:
        """As `ScanSource`."""
        self._readers.discard(mailbox)
        if not len(self._readers) and self.is_scanning:
            self._readers.cancel_linger()
            self._control.unwant()

    def linger(self, mailbox: Mailbox) -> None:
        """As `ScanSource`."""
        self._readers.discard(mailbox)
        if not len(self._readers) and self.is_scanning:
            self._readers.linger()

    async def left(self) -> None:
        """As `ScanSource`."""
        if self._loop.is_closed():
            return  # the coroutine is being collected, and nothing can be waited for
        with anyio.CancelScope(shield=True), anyio.move_on_after(LEAVE_TIMEOUT_S):
            await self._dialogue.stopped()

    def watch(self, watcher: Callable[[Scan], None]) -> None:
        """Call `watcher` with each scan, before its readers get it."""
        self._watchers = (*self._watchers, watcher)

    def unwatch(self, watcher: Callable[[Scan], None]) -> None:
        """Call it no more; ignored where it is not there."""
        self._watchers = tuple(each for each in self._watchers if each != watcher)

    # ------------------------------------------------------------------------------------------------ a replay

    @property
    def scans(self) -> int:
        """As `Audience`."""
        return self.totals.assembled.scans

    @property
    def is_waiting(self) -> bool:
        """As `Audience`."""
        return self.hub.is_waiting

    def on_taken(self, callback: Callable[[], None]) -> None:
        """As `Audience`."""
        self.hub.on_taken(callback)

    def restart(self, *, failed: bool = False) -> None:
        """As `Audience`."""
        if self.state is State.RUNNING and not self._control.starting:
            if failed:
                self._control.leave_off()
            self._control.pause()
            self._resume()

    def deliver(self, scan: Scan, missed: int) -> None:
        """As `Audience` of another machine's lidar: a scan that came whole, and how many are missing before it."""
        if self.state is State.RUNNING:
            counted = self.totals.assembled
            counted.missed_scans += missed
            if counted.left_off is not None:
                counted.resume(scan.stamp_ns)
            scan = changed(scan, seq=counted.scans + counted.missed_scans)
            counted.scans += 1
            for parts in self.hub.parts:
                for sector in sectors_of(scan, parts):
                    self.hub.publish_sector(parts, sector)
            self._publish(scan)

    def finish(self) -> None:
        """As `Audience`."""
        if self.is_scanning:
            self._readers.end(None)
            self._control.unwant()

    # ------------------------------------------------------------------------------------------------ operations

    async def modes(self) -> tuple[ScanMode, ...]:
        """The scan modes of the device, asked for once."""
        if not self._control.modes:
            self._control.modes = await self.ask(self._device.modes)
        return self._control.modes

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
            before = self._dialogue.dtr
            try:
                await self._control.interrupt()
                await come_back(self._dialogue, self._device)
                return await action()
            except LidarError as error:
                if vital:
                    self._failures.could_not_start(error)
                raise
            finally:
                if self._dialogue.dtr is not before and not self.is_scanning:
                    # It had to be woken to hear this.
                    self._dialogue.stop_device()
                self._resume()

    async def retune(self) -> None:
        """Have the stream that runs follow the scan frequency that was set; it is not interrupted."""
        async with self._lock:
            request = self._device.retune()
            # Nothing is written behind a STOP: it would set a resting rotor in motion.
            while request is not None and self.state is State.RUNNING and not self._dialogue.keep_alive(request):
                await self._dialogue.pause(WRITE_AGAIN_S)

    async def stop(self) -> None:
        """Stop laser and motor, end every stream, and return when the line is quiet."""
        self._check_open()
        self._readers.end(None)
        self._control.unwant()
        await self.left()
        async with self._lock:
            self._check_open()
            self._dialogue.begin()
            try:
                if not self.is_scanning and not self.is_away:
                    await self._control.silence()
            except DeviceLost:
                if not self.is_away:
                    raise
                # It is told to stop as soon as it is back.

    def set_zero_offset(self, degrees: float, *, behind: bool = False) -> None:
        """Have the stream that runs add another zero-angle offset, as `Assembler.set_zero_offset`."""
        self._control.set_zero_offset(degrees, behind=behind)

    # ------------------------------------------------------------------------------------------------ the session

    def come_back_with(self, come_back: Callable[[LidarError, int], None]) -> None:
        """As `Failures.come_back`; then `adopt` is expected after a call of it, or `end`."""
        self._failures.come_back = come_back

    def end(self, error: LidarError) -> None:
        """The session is over: end every reader and operation with `error`. The device is not told."""
        self._failures.end(error)

    def abandon(self) -> None:
        """Nobody holds the session any more: let go of every timer. The device is not told."""
        self._readers.cancel_linger()
        self._control.rest()
        self.line.end()

    async def unused(self) -> None:
        """Return when no operation holds the line that was lost. Each has failed by then, so this takes no time."""
        async with self._lock:
            pass

    def adopt(self, dialogue: Dialogue, device: Device) -> None:
        """There is a new line to the device: start the stream on it if one is wanted, else stop the device."""
        self._dialogue, self._device = dialogue, device
        self._failures.adopt(dialogue, device)
        self._starter.adopt(dialogue, device)
        self._control.adopt(dialogue, device)
        self.line.tell("back")
        self._starter.work_soon()

    async def ended(self) -> None:
        """Return when the task that starts streams has ended, after `end`."""
        await self._starter.ended()

    # ------------------------------------------------------------------------------------------------ inside

    def _publish(self, scan: Scan) -> None:
        self.latest = self._control.continued = scan
        for watcher in self._watchers:
            watcher(scan)
        self.hub.publish(scan)

    def _suspect(self, failure: Failure) -> None:
        """The stream brings no scans."""
        if self._failures.suspect(failure):
            self._starter.work_soon()

    def _resume(self) -> None:
        """The device is free again: have the stream started again, if it has readers."""
        if len(self.hub):
            self._control.resume()
        self._starter.work_soon()

    def _deserted(self) -> None:
        """The last reader has been gone for a second."""
        if self.is_scanning:
            self._control.unwant()

    def _check_open(self) -> None:
        if self.over is not None:
            raise twin_of(self.over)
