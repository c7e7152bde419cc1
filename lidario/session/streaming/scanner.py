"""The stream of one device, as those see it who read it, ask the device something meanwhile, or stop it.

Readers only say that they want scans (`join`) and that they do not any more (`leave`). A task of the
session brings the stream up (`lidario.session.streaming.starter`). Where the stream stands is one `State`, which
`lidario.session.streaming.control` leads from step to step; what becomes of it when something fails is decided in
`lidario.session.streaming.failures`.

One operation at a time talks to the device and holds the lock: the start of a stream, a query, a reset. Stopping
does not wait for it. `leave` and `stop` end a start in progress at once, and the stop requests are written as
soon as the device listens. `close` ends every operation at once.

Where the session comes back by itself (`Reconnector`), a lost line ends neither the readers nor the
session: operations fail, readers wait, and `adopt` has the stream started again on the new line.
"""

import asyncio
from collections.abc import Awaitable, Callable
from typing import Any, TypeVar

import anyio

from lidario.basics.model import ScanMode
from lidario.errors import DeviceLost, LidarError
from lidario.families.base import Script
from lidario.revolution.whole import sectors_of
from lidario.scans.measured import changed
from lidario.scans.scan import Scan
from lidario.session.finding.connection import At
from lidario.session.streaming.control import StreamControl
from lidario.session.streaming.failures import Failures
from lidario.session.streaming.line_changes import LineWatch
from lidario.session.streaming.readers import Hub
from lidario.session.streaming.running import Failure
from lidario.session.streaming.starter import Starter
from lidario.session.streaming.states import State
from lidario.session.streaming.stream import Mailbox
from lidario.session.talking.handshake import come_back
from lidario.session.talking.play import play

T = TypeVar("T")

WRITE_AGAIN_S = 0.005
"""How often it is tried to write a request in mid-scan, while the device does not listen."""
LEAVE_TIMEOUT_S = 2.0
"""Longest time that `left` waits. The stop requests are mostly written within 0.6 s (`Stopper.written`).
Nothing can cancel the waiting, so it must end."""


class Scanner:
    """The stream of one device, and all that belongs to it."""

    def __init__(self, at: At, latency: float) -> None:
        self.hub: Hub = Hub(self._deserted)
        self.control: StreamControl = StreamControl(at, latency, self.hub, self._suspect)
        self.rests: bool = True  # whether a device that nobody reads is stopped soon
        self.line: LineWatch = LineWatch()
        self._at = at
        self._lock = asyncio.Lock()
        self._asks = False
        self._loop = asyncio.get_running_loop()
        self.failures: Failures = Failures(self.control, at, self.hub, self.line)
        self.starter: Starter = Starter(self.control, at, self.hub, self.failures, self._lock)

    # ------------------------------------------------------------------------------------------------ readers

    def join(self, mailbox: Mailbox[Any], mode: str | int | None, force: bool) -> None:
        """Hand scans to `mailbox` from now on; start the device in that mode unless it runs in it already."""
        self.hub.add(mailbox, mode, force)
        self.control.want()
        self.starter.work_soon()

    def leave(self, mailbox: Mailbox[Any], *, lingers: bool = False) -> None:
        """Hand `mailbox` no more; the last one to leave stops the device, at once or a little later."""
        self.hub.discard(mailbox)
        if len(self.hub) or not self.control.is_scanning:
            return
        if lingers:
            self.hub.linger()
        else:
            self.hub.cancel_linger()
            self.control.unwant()

    async def left(self) -> None:
        """Return when what `leave` wrote has reached the device."""
        if self._loop.is_closed():
            return  # the coroutine is being collected, and nothing can be waited for
        with anyio.CancelScope(shield=True), anyio.move_on_after(LEAVE_TIMEOUT_S):
            await self._at.dialogue.stopper.written()

    # ------------------------------------------------------------------------------------------------ a replay

    @property
    def scans(self) -> int:
        return self.control.totals.assembled.scans

    @property
    def is_waiting(self) -> bool:
        return self.hub.is_waiting

    def on_taken(self, callback: Callable[[], None]) -> None:
        self.hub.on_taken = callback

    def restart(self, *, failed: bool = False) -> None:
        if self.control.state is State.RUNNING and not self.control.starting:
            self.control.pause()
            if failed:
                self.control.leave_off()
            self._resume()

    def deliver(self, scan: Scan, missed: int) -> None:
        """As `Audience` of another machine's lidar: a scan that came whole, and how many are missing before it."""
        if self.control.state is State.RUNNING:
            counted = self.control.totals.assembled
            counted.missed_scans += missed
            counted.resume(scan.stamp_ns)
            scan = changed(scan, seq=counted.scans + counted.missed_scans)
            counted.scans += 1
            for parts in self.hub.parts:
                for sector in sectors_of(scan, parts):
                    self.hub.publish_sector(parts, sector)
            self.hub.publish(scan)

    def finish(self) -> None:
        if self.control.is_scanning:
            # First: what is left of the recording is read, too.
            self.control.unwant()
            self.hub.end(None)

    # ------------------------------------------------------------------------------------------------ operations

    async def modes(self) -> tuple[ScanMode, ...]:
        """The scan modes of the device, asked for once."""
        if not self.control.modes:
            self.control.keep_modes(await self.ask(self._at.dialogue.device.modes))
        return self.control.modes

    async def ask(self, script: Callable[[], Script[T]]) -> T:
        """Run a script of the family, with the stream interrupted if one runs, and started again after it.

        A script that asks the device nothing, or refuses, does so at once, and does not interrupt the stream.
        Cancelling gives up the response; the stream is started again all the same.
        """
        held = script()
        try:
            first = next(held)
        except StopIteration as stop:
            told: T = stop.value
            return told
        return await self.between(lambda: play(held, self._at.dialogue.ask, first))

    async def between(self, action: Callable[[], Awaitable[T]], *, vital: bool = False) -> T:
        """Await `action` while no stream runs; the stream is started again after it, whatever becomes of it.

        A `vital` action is one without which no stream can be started: when it fails, the streams end with it.
        """
        dialogue = self._at.dialogue
        async with self._lock:
            if self._at.dialogue is not dialogue or (dialogue.fatal is not None and self.control.is_away):
                raise DeviceLost("the line to the lidar was lost before this request was sent: ask again")
            dialogue.begin()
            self._asks = True
            try:
                await self.control.interrupt()
                if dialogue.reset_at is not None:
                    await come_back(dialogue)
                return await action()
            except LidarError as error:
                if vital:
                    self.failures.could_not_start(error)
                raise
            finally:
                self._asks = False
                self._resume()

    async def retune(self) -> None:
        """Have the stream that runs follow the scan frequency that was set; it is not interrupted."""
        async with self._lock:
            request, dialogue = self._at.dialogue.device.retune(), self._at.dialogue
            # Nothing is written behind a STOP: it would set a resting rotor in motion.
            while request is not None and self.control.state is State.RUNNING and not dialogue.keep_alive(request):
                await dialogue.wait(WRITE_AGAIN_S)

    async def stop(self) -> None:
        """Stop laser and motor, end every stream, and return when the line is quiet. The session is open."""
        self.hub.end(None)
        self.control.unwant()
        await self.left()
        async with self._lock:
            try:
                self._at.dialogue.begin()
                if not self.control.is_scanning:
                    await self._at.dialogue.leave_still()
            except DeviceLost:
                if not self.control.is_away:
                    raise
                # It is told to stop as soon as it is back.

    def set_zero_offset(self, degrees: float, *, behind: bool = False) -> None:
        """Have the stream that runs add another zero-angle offset, as `Assembler.set_zero_offset`."""
        if self.control.running is not None:
            self.control.running.set_zero_offset(degrees, behind=behind)

    # ------------------------------------------------------------------------------------------------ the session

    @property
    def is_forked(self) -> bool:
        """Whether this is a forked child: the device belongs to its parent."""
        return self._at.dialogue.port.is_forked

    def abandon(self) -> None:
        """Nobody holds the session any more: let go of every timer. The device is not told."""
        self.hub.abandon()
        self.control.rest()
        self.line.end()

    async def unused(self) -> None:
        """Return when no operation holds the line that was lost. Each has failed by then, so this takes no time."""
        async with self._lock:
            pass

    def adopt(self) -> None:
        """There is a new line to the device: start the stream on it if one is wanted, else stop the device."""
        self.failures.adopt()
        self.control.adopt()
        self.starter.work_soon()

    # ------------------------------------------------------------------------------------------------ inside

    def _suspect(self, failure: Failure) -> None:
        """The stream brings no scans."""
        self.failures.suspect(failure)
        self.starter.work_soon()

    def _resume(self) -> None:
        """The device is free again: have the stream started again where somebody reads, or stop it."""
        if self.hub.readers:
            self.starter.work_soon()
        else:
            # It may have been woken to hear a question, or restarted.
            self.hub.check_deserted()

    def _deserted(self) -> None:
        """Nobody reads: stop the device. During a question or a restart it is left: `between` asks again."""
        may_turn = self.rests and not self._at.dialogue.stopper.still
        if not self._asks and (self.control.is_scanning or may_turn):
            self.control.unwant()
