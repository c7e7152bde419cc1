"""Starting, watching, interrupting and stopping the stream of one device, and handing out its scans.

What *should* run (`wanted`) and what *does* run (`stream`) are kept apart. A query stops the stream, asks, and
leaves; whoever leaves with something wanted and nothing running has it started again, by a task the scanner
owns, so that cancelling a query does not end other people's streams. One operation at a time holds the lock.

Two things are watched while a stream runs: that packets come, and that they make full turns.
"""

from __future__ import annotations

import asyncio
import logging
import time
from collections.abc import Awaitable, Callable
from typing import NamedTuple, TypeVar

import anyio

from lidario.errors import DeviceLost, LidarError, LocalProtocolError, Unsupported
from lidario.families.base import Device, Script, Stream
from lidario.model import Scan, ScanMode
from lidario.revolution.assemble import Assembler, AssemblerStats
from lidario.session.dialogue import Dialogue
from lidario.session.pace import Pace
from lidario.session.stream import Hub, Mailbox
from lidario.wire.events import Packets

__all__ = ["SILENCE_S", "Scanner", "Wanted"]

T = TypeVar("T")
_log = logging.getLogger("lidario")

SILENCE_S = 0.9
"""Longest time without a packet once they flow. The slowest format sends one every 10 ms."""
TURNS_MISSED = 3
"""Turns of the slowest kind that may fail to complete before a stream of packets counts as stuck."""
LEAVE_TIMEOUT_S = 2.0
_WATCH_MARGIN_S = 0.001
STOP_ATTEMPTS = 3


class Wanted(NamedTuple):
    """A stream that ought to run."""

    mode: ScanMode
    force: bool


class Scanner:
    """The stream of one device.

    Attributes:
        hub: Everybody who reads it.
        stats: What was assembled.
        wanted: What ought to run, or None.
        stream: What does run, or None.
        latest: The last scan, or None.
        interruptions: Times the stream was stopped for something else and started again.
        keepalives: Keepalive requests sent.
    """

    def __init__(self, dialogue: Dialogue, device: Device, latency: float, keep_spinning: bool) -> None:
        self.hub = Hub()
        self.stats = AssemblerStats()
        self.wanted: Wanted | None = None
        self.stream: Stream | None = None
        self.latest: Scan | None = None
        self.interruptions = 0
        self.keepalives = 0
        self._dialogue = dialogue
        self._device = device
        self._latency = latency
        self._keep_spinning = keep_spinning
        self._loop = asyncio.get_running_loop()
        self._lock = asyncio.Lock()
        self._modes: tuple[ScanMode, ...] = ()
        self._assembler: Assembler | None = None
        self._watchdog: asyncio.TimerHandle | None = None
        self._keepalive: asyncio.TimerHandle | None = None
        self._restoring: asyncio.Task[None] | None = None
        self._pace: Pace | None = None
        self._began = self._last_packet = self._last_scan = 0.0
        dialogue.on_lost = self._lost

    async def modes(self) -> tuple[ScanMode, ...]:
        """The scan modes of the device, asked for once."""
        if not self._modes:
            self._modes = await self.ask(self._device.modes)
        return self._modes

    async def join(self, mailbox: Mailbox, mode: str | int | None, force: bool) -> None:
        """As `ScanSource`."""
        modes = await self.modes()
        async with self._lock:
            wanted = self.wanted
            if wanted is None or mode is not None:
                wanted = Wanted(choose_mode(modes, mode), force)
            if self.wanted is not None and wanted != self.wanted:
                if len(self.hub):
                    raise LocalProtocolError(
                        f"scan mode {self.wanted.mode.name!r} is running for another stream: "
                        f"leave that one before asking for {wanted.mode.name!r}"
                    )
                await self._interrupt()
            self.hub.add(mailbox)
            self.wanted = wanted
            if self.stream is None:
                try:
                    await self._start(wanted)
                except BaseException:
                    self.hub.discard(mailbox)
                    self.halt()
                    if len(self.hub):
                        # Others wait for the same stream: what failed here must not leave them waiting.
                        self.wanted = wanted
                        self._restore_soon()
                    raise

    def leave(self, mailbox: Mailbox) -> None:
        """As `ScanSource`."""
        self.hub.discard(mailbox)
        if not len(self.hub) and self.wanted is not None:
            self.halt()

    async def left(self) -> None:
        """As `ScanSource`."""
        with anyio.CancelScope(shield=True), anyio.move_on_after(LEAVE_TIMEOUT_S):
            await self._dialogue.halted()

    async def ask(self, script: Callable[[], Script[T]]) -> T:
        """Run a script of the family, with the stream interrupted if one runs, and taken up again after it.

        Cancelling gives up the answer; the stream is taken up all the same.
        """
        return await self.between(lambda: self._dialogue.run(script()))

    async def between(self, action: Callable[[], Awaitable[T]]) -> T:
        """Await `action` while no stream runs; the stream is taken up again after it, whatever becomes of it."""
        async with self._lock:
            try:
                await self._interrupt()
                return await action()
            finally:
                self._restore_soon()

    async def stop(self) -> None:
        """Stop laser and motor, end every stream, and return when the line is quiet."""
        self.halt()
        self.hub.end()
        async with self._lock:
            await self._dialogue.halted()
            await self._silence()

    def halt(self) -> None:
        """Write what stops laser and motor, at once. Never blocks or raises; streams are not ended."""
        self.wanted = None
        self._at_rest()
        if self._restoring is not None:
            self._restoring.cancel()
            self._restoring = None
        requests = (self._device.stop(),) if self._keep_spinning else self._device.halt()
        self._dialogue.halt(requests)

    async def _start(self, wanted: Wanted) -> None:
        stream = await self._dialogue.run(self._device.start(wanted.mode, force=wanted.force))
        wall_offset = time.time_ns() - round(self._loop.time() * 1e9)
        self._assembler = Assembler(stream, self._dialogue.port.baudrate, wall_offset, self.stats)
        self.stream = stream
        self._began = self._last_packet = self._last_scan = self._loop.time()
        self._dialogue.on_packets = self._take
        received = self._dialogue.link.stats.bytes_received
        self._pace = Pace(stream, self._dialogue.port.baudrate, self._latency, received)
        self._dialogue.port.set_polling(self._latency, self._pace)
        self._watch()
        if stream.keepalive is not None:
            self._keepalive = self._loop.call_later(stream.keepalive.interval_s, self._keep_alive)
        _log.debug("scanning in mode %s", wanted.mode.name)

    async def _interrupt(self) -> None:
        """Stop the stream, not the motor, and wait until the line is quiet."""
        if self.stream is not None:
            self.interruptions += 1
            self._at_rest()
            await self._silence()

    async def _silence(self) -> None:
        for _ in range(STOP_ATTEMPTS):
            if await self._dialogue.quieten():
                return
        raise DeviceLost(f"the device goes on sending after {STOP_ATTEMPTS} STOP requests: is it still listening?")

    def _restore_soon(self) -> None:
        if self.wanted is not None and self.stream is None and self._restoring is None and not self._dialogue.fatal:
            self._restoring = self._loop.create_task(self._restore(), name="lidario: take up the stream again")

    async def _restore(self) -> None:
        try:
            async with self._lock:
                if self.wanted is not None and self.stream is None:
                    await self._start(self.wanted)
        except LidarError as error:
            self._restoring = None
            self._fail(DeviceLost(f"the stream could not be taken up again: {error}"), error)
        finally:
            self._restoring = None

    def _at_rest(self) -> None:
        self.stream = None
        self._assembler = self._pace = None
        for timer in (self._watchdog, self._keepalive):
            if timer is not None:
                timer.cancel()
        self._watchdog = self._keepalive = None
        if not self._loop.is_closed():
            self._dialogue.port.set_polling(0, None)

    def _take(self, packets: Packets) -> None:
        if self._assembler is None or self._pace is None:
            return
        self._last_packet = self._loop.time()
        for scan in self._assembler.add(packets):
            self._last_scan = self._last_packet
            link = self._dialogue.link
            self._pace.turned(scan, link.stats.bytes_received, self._last_packet)
            self.latest = scan
            self.hub.publish(scan)

    def _watch(self) -> None:
        stream = self.stream
        if stream is None:
            return
        patience = stream.spin_up_s if self._last_packet == self._began else SILENCE_S
        idle = self._loop.time() - self._last_packet
        if idle >= patience:
            # The program may have blocked the loop: look at the line itself before judging it.
            self._dialogue.port.poll()
            idle = self._loop.time() - self._last_packet
        turning = self._loop.time() - self._last_scan
        if idle >= patience:
            came = self._dialogue.link.buffered or self._dialogue.link.stats.skipped_bytes
            why = "only noise arrives: is the baud rate right?" if came else "is it powered, and is the cable in?"
            self._fail(DeviceLost(f"no scan data for {idle:.1f} s; {why}"))
        elif turning >= stream.spin_up_s + TURNS_MISSED * stream.slowest_turn_s:
            self._fail(
                DeviceLost(f"scan data arrives, but no full turn for {turning:.1f} s: is the rotor blocked?")
            )
        else:
            wait = min(patience - idle, SILENCE_S) + _WATCH_MARGIN_S
            self._watchdog = self._loop.call_later(wait, self._watch)

    def _keep_alive(self) -> None:
        stream = self.stream
        if stream is not None and stream.keepalive is not None:
            self._dialogue.send(stream.keepalive.request)
            self.keepalives += 1
            self._keepalive = self._loop.call_later(stream.keepalive.interval_s, self._keep_alive)

    def _fail(self, error: DeviceLost, cause: BaseException | None = None) -> None:
        """End the stream for everybody; the session goes on."""
        error.__cause__ = cause
        self.halt()
        self.hub.end(error)

    def _lost(self, error: DeviceLost) -> None:
        self.wanted = None
        self._at_rest()
        self.hub.end(error)


def choose_mode(modes: tuple[ScanMode, ...], wanted: str | int | None) -> ScanMode:
    """The mode of that name or id; the device's typical one for None.

    Raises:
        Unsupported: There is none; the text lists those there are.
    """
    for mode in modes:
        if wanted is None and mode.typical:
            return mode
        if isinstance(wanted, str) and mode.name.casefold() == wanted.casefold():
            return mode
        if isinstance(wanted, int) and mode.id == wanted:
            return mode
    if wanted is None:
        return modes[0]
    known = ", ".join(f"{mode.name} ({mode.id})" for mode in modes)
    raise Unsupported(f"this device has no scan mode {wanted!r}; it has {known}")
