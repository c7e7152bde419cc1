"""The session with one device: what a user holds.

Every method that talks to the device may be called in any state, and by several tasks at once. While streams run,
it interrupts them, asks, and has them started again: the readers see a longer step between two time stamps, and
`Stats.interruptions` counts it. A question that needs no request, or is refused, interrupts nothing.

With `reconnect`, the line to the device may change in the life of a session: `_adopt` takes a new one over.

However a session ends, the stop requests are written: before anything is awaited, or, where the device does not
listen at that moment, by a timer some milliseconds later.
"""

from __future__ import annotations

import asyncio
import os
import weakref
from collections.abc import Callable
from pathlib import Path
from types import TracebackType
from typing import NoReturn, Self

from lidario.errors import InvalidValue, LocalProtocolError, RemoteProtocolError, SessionClosed
from lidario.families.base import Device, Script
from lidario.model import DeviceInfo, Health, SampleRate, ScanMode, Stats
from lidario.port.line import Tap
from lidario.recording.record import Recording
from lidario.scan import Scan
from lidario.session.connect import Connection
from lidario.session.dialogue import Dialogue
from lidario.session.handshake import healthy, restart
from lidario.session.reconnect import Reconnector
from lidario.session.recorded import RecordedSession
from lidario.session.scanner import Scanner
from lidario.session.stream import ScanStream
from lidario.session.twin import twin_of
from lidario.wire.stats import LinkStats

__all__ = ["Lidar"]

SPEED_TOLERANCE = 0.05
SPEED_TIMEOUT_S = 10.0


class Lidar:
    """One open device; made by `open_lidar`, and best used as its context manager.

    Its methods belong to the event loop in which it was opened; in another one they raise `LocalProtocolError`.
    Every question (`get_...`) and every setting (`set_...`) raises `ResponseTimeout` when the device does not
    respond, `RemoteProtocolError` when its response cannot be right, `DeviceLost` when the port dies, and
    `SessionClosed` after `close`. Cancelling one gives up the response: the device may have obeyed all the same. A
    stream that was interrupted is started again in any case.

    Attributes:
        source: The source it was opened from.
        info: What the device says it is.
    """

    def __init__(
        self,
        connection: Connection,
        health: Health,
        source: str,
        latency: float,
        keep_spinning: bool,
        reconnector: Reconnector | None = None,
    ) -> None:
        self.source = source
        self.info: DeviceInfo = connection.info
        self._device = connection.device
        self._dialogue = connection.dialogue
        self._timing = connection.family.timing
        self._keep_spinning = keep_spinning
        self._dialogue.stopper.keep_spinning = keep_spinning
        self._scanner = Scanner(connection.dialogue, connection.device, latency)
        self._scanner.inquiry.health = health
        self._reconnector = reconnector
        # What was counted on the lines that were lost.
        self._former = LinkStats()
        self._former_keepalives = 0
        self._former_protection_stops = 0
        if reconnector is not None:
            reconnector.serve(_if_alive(self._adopt), self._scanner.end, self._scanner.unused)
            self._scanner.come_back = reconnector.begin
        connection.port.follow(self._scanner)
        self._recorded = RecordedSession(
            connection.dialogue, self._scanner, source, lambda: (self.info, self.health)
        )
        self._closed = False
        self._loop = asyncio.get_running_loop()
        self._abandoned = weakref.finalize(self, _abandon, connection.dialogue, self._scanner, reconnector)

    def __repr__(self) -> str:
        state = "scanning" if self.is_scanning else "idle"
        state = "closed" if self._closed else state if self.is_connected else "away"
        return f"<Lidar {self.info.model} {self.info.serial} on {self.source}: {state}>"

    @property
    def is_scanning(self) -> bool:
        """Whether a stream runs or is about to; also for the second after its last reader has gone."""
        return self._scanner.is_scanning

    @property
    def is_connected(self) -> bool:
        """Whether there is a line to the device; False after its loss, also while the session comes back."""
        return not self._closed and not self._scanner.is_away and self._dialogue.fatal is None

    @property
    def mode(self) -> ScanMode | None:
        """The scan mode that runs, if one does."""
        return self._scanner.mode

    @property
    def baudrate(self) -> int:
        """Speed of the line in bits a second; 0 where it has none, or where it is unknown."""
        return self._dialogue.baudrate

    @property
    def measured_scan_frequency(self) -> float | None:
        """Measured revolutions a second, from the latest scan; None before the first."""
        return None if self._scanner.latest is None else self._scanner.latest.rpm / 60

    @property
    def health(self) -> Health:
        """What the device last said of its state, whether it was asked by the program or by the session."""
        return self._scanner.inquiry.health

    @property
    def stats(self) -> Stats:
        """Counters since the session was opened, summed over all lines to the device."""
        link, totals = self._former + self._dialogue.stats, self._scanner.totals
        assembled = totals.assembled
        return Stats(
            bytes_received=link.bytes_received,
            packets=link.packets,
            packet_bytes=link.packet_bytes,
            lost_packets=assembled.lost_packets,
            scan_packets=assembled.scan_packets,
            discarded_packets=assembled.discarded_packets + link.unread_packets,
            unfinished_packets=assembled.unfinished_packets,
            records=link.records,
            record_bytes=link.record_bytes,
            skipped_bytes=link.skipped_bytes,
            skipped_stretches=link.skipped_stretches,
            response_bytes=link.response_bytes,
            stray_bytes=link.stray_bytes,
            drained_bytes=link.drained_bytes,
            discarded_bytes=link.discarded_bytes,
            buffered=self._dialogue.buffered,
            late_responses=link.late_responses,
            scans=assembled.scans,
            broken_scans=assembled.broken_scans,
            missed_scans=assembled.missed_scans,
            dropped_scans=self._scanner.hub.dropped,
            interruptions=totals.interruptions,
            keepalives=totals.keepalives + self._former_keepalives + self._dialogue.repeated,
            restarts=totals.restarts,
            protection_stops=self._former_protection_stops + self._dialogue.protection_stops,
            reconnects=0 if self._reconnector is None else self._reconnector.count,
        )

    def scans(self, mode: str | int | None = None, *, depth: int = 1, force: bool = False) -> ScanStream:
        """A stream of full revolutions, for ``async for``; several may run side by side.

        Args:
            mode: Name or id of a scan mode; None for the one that runs, or else the device's typical one.
            depth: Scans kept for a reader that falls behind; the oldest beyond that are dropped and counted.
            force: Ask the device to measure even when the motor is not up to speed.

        Raises:
            InvalidValue: `depth` is no number of scans.
        """
        return ScanStream(self._scanner, mode, depth, force, self._check_open)

    async def scan(self, mode: str | int | None = None) -> Scan:
        """One full revolution. Laser and motor stop a second later, unless another stream was begun by then.

        Cancelling ends the waiting; laser and motor stop as after a scan.

        Args:
            mode: As for `scans`.

        Raises:
            StreamFailed: No scan came; the session goes on.
            DeviceFault: The device has stopped to protect itself, and a reset did not help; the session goes on.
            LocalProtocolError: Another task called `stop` before the scan was complete.
        """
        stream = self.scans(mode)
        try:
            return await anext(stream)
        except StopAsyncIteration:
            raise LocalProtocolError("another task stopped the lidar before the scan was complete") from None
        finally:
            stream.release()

    async def stop(self) -> None:
        """Stop laser and motor and end every stream; returns when the line is quiet. The session stays open.

        Every reader ends at once, also one whose stream is just being started. The stop requests are written
        before anything is awaited, or, where the device does not listen at that moment, by a timer. Cancelling
        ends only the waiting.
        """
        self._check_open()
        await self._scanner.stop()

    async def get_info(self) -> DeviceInfo:
        """Ask the device what it is; `info` has the result, too."""
        self.info = await self._scanner.ask(self._open_device().identify)
        return self.info

    async def get_health(self) -> Health:
        """Ask the device how it is."""
        self._scanner.inquiry.health = health = await self._scanner.ask(self._open_device().health)
        # Not later: the stream that this question interrupted is started by another task, in the next step.
        self._scanner.inquiry.doubtful |= not health.ok
        return health

    async def get_modes(self) -> tuple[ScanMode, ...]:
        """The scan modes of the device, in its order; never empty. The device is asked once in a session."""
        self._check_open()
        return await self._scanner.modes()

    async def get_sample_rate(self) -> SampleRate:
        """Ask how long a sample takes, in microseconds. Raises Unsupported where the device does not tell."""
        return await self._scanner.ask(self._open_device().sample_rate)

    async def get_scan_frequency(self) -> float:
        """Ask which scan frequency is set, in revolutions a second; `measured_scan_frequency` is the real one.

        Raises Unsupported where it cannot be set.
        """
        return await self._scanner.ask(self._open_device().scan_frequency)

    async def get_scan_frequency_range(self) -> tuple[float, float]:
        """Ask for the slowest and the fastest scan frequency, in Hz. Raises Unsupported where it cannot be set."""
        return await self._scanner.ask(self._open_device().scan_frequency_range)

    async def set_scan_frequency(self, hertz: float, *, verify: bool = True) -> float:
        """Set the scan frequency in revolutions a second; returns what the device made of it.

        While a stream runs and `verify` is set, it returns when the measured frequency is within 5 % of that.
        While none runs, the rotor stays at rest and takes that speed when one is started. Cancelling ends the
        waiting; the frequency may be set or not.

        Raises:
            InvalidValue: No number, or outside what the device can do; the stream is not interrupted.
            Unsupported: It cannot be set on this device.
            RemoteProtocolError: The device turns at another speed even after ten seconds.
        """
        device = self._open_device()
        value = await self._scanner.ask(lambda: device.set_scan_frequency(hertz))
        self._remember("scan frequency", lambda device: device.set_scan_frequency(hertz))
        if verify and self.is_scanning:
            await self._turns_at(value)
        return value

    async def set_motor_speed(self, rpm: float, *, verify: bool = True) -> float:
        """As `set_scan_frequency`, in revolutions a minute."""
        try:
            hertz = rpm / 60
        except TypeError:
            raise InvalidValue(f"{rpm!r} is no number of revolutions a minute") from None
        return 60 * await self.set_scan_frequency(hertz, verify=verify)

    async def get_zero_offset(self) -> float:
        """Ask for the zero-angle offset the device was calibrated with, in degrees clockwise.

        It is not applied unless `set_zero_offset` says so. Raises Unsupported where there is none.
        """
        return await self._scanner.ask(self._open_device().zero_offset)

    async def set_zero_offset(self, on: bool) -> None:
        """Choose whether the zero-angle offset is added to every angle; off at first.

        Streams that run add it, or do not, from the next revolution on. Raises Unsupported where there is none.
        """
        device = self._open_device()
        self._scanner.set_zero_offset(await self._scanner.ask(lambda: device.apply_zero_offset(on)))
        self._remember("zero offset", lambda device: device.apply_zero_offset(on))

    async def set_power_down_protection(self, on: bool) -> bool:
        """Switch power-down protection and return the state the device confirms.

        With it on, the device stops by itself when its host falls silent for three seconds; the session repeats
        what keeps it going, from another thread too while the program blocks its event loop. The manual recommends
        it where lidar and host have separate power supplies. It lasts longer than the session: the next program
        finds it as this one left it. Raises Unsupported where there is none.
        """
        device = self._open_device()
        state = await self._scanner.ask(lambda: device.power_down_protection(on))
        self._remember("protection", lambda device: device.power_down_protection(on))
        return state

    async def reset(self) -> Health:
        """Restart the device and wait until it responds again; streams are started again afterwards.

        What this session has set (speed, protection) is set again by the next start. Cancelling ends the waiting;
        a device that was told to restart does so all the same.

        Raises:
            ResponseTimeout: It does not come back.
            DeviceFault: It came back and reports an error.
        """
        self._open_device()
        self._scanner.inquiry.health = health = await self._scanner.between(self._reset, vital=True)
        return health

    def tap(self, tap: Tap) -> None:
        """Have `tap` called with every chunk of raw bytes, in and out. One that raises is removed, and logged."""
        self._check_open()
        self._dialogue.add_tap(tap)

    def untap(self, tap: Tap) -> None:
        """Stop calling `tap`. Ignored where it is not there."""
        self._dialogue.remove_tap(tap)

    def record(self, path: str | os.PathLike[str], *, scans: bool = False, overwrite: bool = False) -> Recording:
        """Record every byte in both directions to an MCAP file, for use in ``async with``.

        Recording slows the session down by nothing that can be measured: a thread writes. It ends with the block,
        or with the session, or by itself where the disk is full or too slow; then the log and `Recording.error` say
        so, and the session goes on. ``open_lidar("run.mcap")`` plays it.

        Args:
            path: The file to make.
            scans: Whether to write each scan too, as ``sensor_msgs/msg/LaserScan`` on the topic ``/scan``.
            overwrite: Whether a file that is there already may be replaced.

        Raises:
            CannotRecord: When the block is entered: the file cannot be made, or ``mcap`` is not installed.
        """
        self._check_open()
        return Recording(Path(path), self._recorded, scans=scans, overwrite=overwrite)

    async def close(self) -> None:
        """Stop laser and motor and close the port; returns when it is closed. Harmless when done before.

        Everything else ends with SessionClosed at once: readers, questions, a stream that is being started. The
        stop requests are written before anything is awaited, or, where the device does not listen at that moment,
        by a timer. Cancelling it ends only the waiting for the port to close; it does not end earlier than the stop
        requests are written, which takes a tenth of a second at most.

        Raises:
            LocalProtocolError: It was called in another event loop, such as one of another thread. The session goes
                on: close it in its own loop.
        """
        self._check_loop()
        self._closed = True
        self._scanner.end(SessionClosed(f"the session on {self.source} was closed"))
        if self._reconnector is not None:
            self._reconnector.cancel()
        await self._dialogue.close()
        if self._reconnector is not None:
            await self._reconnector.ended()
        # Not earlier: a KeyboardInterrupt may come anywhere above, and then the finalizer stops the device.
        self._abandoned.detach()
        await self._scanner.ended()
        await self._recorded.close()

    async def __aenter__(self) -> Self:
        self._check_open()
        return self

    def __aiter__(self) -> NoReturn:
        raise LocalProtocolError("a lidar may have several streams: write `async for scan in lidar.scans():`")

    def __enter__(self) -> NoReturn:
        raise LocalProtocolError("a lidar is left asynchronously: write `async with`")

    def __exit__(self, *_: object) -> None:
        """Never reached; `with` looks for it before `__enter__` can say what to write."""

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        await self.close()

    async def _reset(self) -> Health:
        await restart(self._dialogue, self._device, self._timing)
        return await healthy(self._dialogue, self._device, self._timing)

    async def _turns_at(self, hertz: float) -> None:
        measured = float("nan")
        try:
            async with asyncio.timeout(SPEED_TIMEOUT_S):
                async for scan in self.scans():
                    measured = scan.rpm / 60
                    if abs(measured - hertz) <= SPEED_TOLERANCE * hertz:
                        return
        except TimeoutError:
            raise RemoteProtocolError(
                f"{hertz:.2f} Hz is set, but the rotor turns at {measured:.2f} Hz after {SPEED_TIMEOUT_S:g} s"
            ) from None

    def _adopt(self, connection: Connection, health: Health) -> None:
        """There is a new line to the device: from now on it is the one of this session."""
        old, new = self._dialogue, connection.dialogue
        new.stopper.keep_spinning = self._keep_spinning
        for tap in old.taps:
            new.add_tap(tap)
        # The new finalizer first: a KeyboardInterrupt may come between the two.
        former, self._abandoned = (
            self._abandoned,
            weakref.finalize(self, _abandon, new, self._scanner, self._reconnector),
        )
        former.detach()
        self._former += old.stats
        self._former_keepalives += old.repeated
        self._former_protection_stops += old.protection_stops
        # What was incomplete when the line was lost will never be complete.
        self._former.skipped_bytes += old.buffered
        self.info, self._scanner.inquiry.health = connection.info, health
        self._dialogue, self._device, self._timing = new, connection.device, connection.family.timing
        self._recorded.adopt(new)
        self._scanner.adopt(new, connection.device)
        if self._reconnector is not None and not self.is_scanning:
            self._reconnector.proven()

    def _remember(self, name: str, script: Callable[[Device], Script[object]]) -> None:
        """A device that comes back shall be set to this again."""
        if self._reconnector is not None:
            self._reconnector.settings[name] = script

    def _open_device(self) -> Device:
        self._check_open()
        if self._scanner.is_away and self._reconnector is not None:
            raise self._reconnector.away_error()
        return self._device

    def _check_open(self) -> None:
        if self._closed:
            raise SessionClosed(f"the session on {self.source} was closed; open_lidar() makes a new one")
        fatal = self._scanner.over or (None if self._scanner.is_away else self._dialogue.fatal)
        if fatal is not None:
            raise twin_of(fatal)
        if self._loop.is_closed():
            raise SessionClosed(f"the event loop in which the session on {self.source} was opened is closed")
        self._check_loop()

    def _check_loop(self) -> None:
        if not self._loop.is_closed() and _running_loop() not in (None, self._loop):
            raise LocalProtocolError(
                f"the session on {self.source} belongs to another event loop: "
                "use asyncio.run_coroutine_threadsafe() from other threads"
            )


def _running_loop() -> asyncio.AbstractEventLoop | None:
    try:
        return asyncio.get_running_loop()
    except RuntimeError:
        return None


def _if_alive(adopt: Callable[[Connection, Health], None]) -> Callable[[Connection, Health], bool]:
    """As `adopt`, a method, but without keeping its object alive; False when that is gone."""
    method = weakref.WeakMethod(adopt)

    def call(connection: Connection, health: Health) -> bool:
        alive = method()
        if alive is not None:
            alive(connection, health)
        return alive is not None

    return call


def _abandon(dialogue: Dialogue, scanner: Scanner, reconnector: Reconnector | None) -> None:
    """The session was never closed and nobody holds it any more, or the program ends: leave the device still."""
    scanner.abandon()
    dialogue.abandon()
    if reconnector is not None:
        reconnector.abandon()
