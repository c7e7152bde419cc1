"""The session with one device: what a user holds.

Every method that talks to the device may be called in any state, and by several tasks at once. While streams run,
it interrupts them, asks, and has them started again: the readers see a longer step between two time stamps, and
`Stats.interruptions` counts it. A question that needs no request, or is refused, interrupts nothing.

With `reconnect`, the line to the device may change in the life of a session: `_adopt` takes a new one over.
"""

import asyncio
import os
import weakref
from typing import NoReturn, Self

from lidario.basics.arguments import callable_of, path_of, yes_or_no
from lidario.basics.entered import AsyncOnly, Held
from lidario.basics.model import Health, ScanMode, Stats
from lidario.config.read import LidarConfig
from lidario.errors import LocalProtocolError, SessionClosed
from lidario.port.at_exit import finalize
from lidario.port.forked import FORKED
from lidario.port.line import Tap
from lidario.recording.parts import Split
from lidario.recording.record import Recording
from lidario.scans.laserscans import LaserScans
from lidario.session.finding.connection import At, Connection
from lidario.session.finding.reconnect import Reconnector
from lidario.session.recorded import RecordedSession
from lidario.session.streaming.line_changes import LineChanges
from lidario.session.streaming.running import Counters
from lidario.session.streaming.scanner import Scanner
from lidario.session.streams import Streams
from lidario.session.talking.trouble import twin_of


class Lidar(Streams, AsyncOnly, Held):
    """One open device; made by `open_lidar`, and best used as its context manager.

    Its methods belong to the event loop in which it was opened; in another one they raise `LocalProtocolError`.
    Every question (`get_...`) and every setting (`set_...`) raises `ResponseTimeout` when the device does not
    respond, `RemoteProtocolError` when its response cannot be right, `DeviceLost` when the port dies, and
    `SessionClosed` after `close`. Cancelling one gives up the response: the device may have obeyed all the same. A
    stream that was interrupted is started again in any case.

    Attributes:
        source: The source it was opened from.
        config: Its settings, of the file that `open_lidar` was given.
    """

    _instead = "a lidar is used asynchronously: write `async with`, and `async for scan in lidar.scans():`"

    def __init__(
        self,
        connection: Connection,
        health: Health,
        source: str,
        latency: float,
        keep_spinning: bool,
        reconnector: Reconnector,
        config: LidarConfig = LidarConfig(),  # noqa: B008 - it never changes
        *,
        rests: bool = True,
    ) -> None:
        at = At(connection.dialogue, connection.info)
        super().__init__(at, Scanner(at, latency), reconnector)
        self.source = source
        self.config = config
        self._scanner.control.usual_mode = config.mode
        at.dialogue.stopper.keep_spinning = keep_spinning
        self._scanner.failures.take_note(health)
        self._counters = Counters()
        reconnector.adopt = weakref.WeakMethod(self._adopt)
        reconnector.gave_up, reconnector.unused = self._scanner.failures.end, self._scanner.unused
        if reconnector.comes_back:
            self._scanner.failures.come_back = reconnector.begin
        at.dialogue.port.follow(self._scanner)
        self._recorded = RecordedSession(at, self._scanner, source, config.filters)
        self._loop = asyncio.get_running_loop()
        self._abandoned = finalize(self, _abandon, at, self._scanner, reconnector)
        connection.release()
        # Not on a bench, which drives the device below the session. It may turn from power-up on, or since its port
        # was opened: the first reader need not wait for that.
        self._scanner.rests = rests
        if rests:
            self._scanner.hub.linger()

    def __repr__(self) -> str:
        state = "scanning" if self.is_scanning else "idle"
        if not self.is_connected:
            state = "closed" if isinstance(self._at.dialogue.fatal, SessionClosed) else "away"
        return f"<Lidar {self.info.model} {self.info.serial} on {self.source}: {state}>"

    @property
    def is_scanning(self) -> bool:
        """Whether a stream runs or is about to; also for the second after its last reader has gone."""
        return self._scanner.control.is_scanning

    @property
    def is_connected(self) -> bool:
        """Whether there is a line to the device; False after its loss, also while the session comes back."""
        return not self._scanner.control.is_away and self._at.dialogue.fatal is None

    @property
    def can_be_stopped(self) -> bool:
        """Whether laser and motor can be switched off from here; False of a device that only talks."""
        return self._at.dialogue.device.can_be_stopped

    @property
    def motor_can_be_stopped(self) -> bool:
        """Whether the motor can be switched off from here; else it turns for as long as it has power."""
        return self.can_be_stopped and self._at.dialogue.device.motor_obeys

    @property
    def mode(self) -> ScanMode | None:
        """The scan mode that runs, if one does."""
        return self._scanner.control.mode

    @property
    def baudrate(self) -> int:
        """Speed of the line in bits a second; 0 where it has none, or where it is unknown."""
        return self._at.dialogue.port.baudrate

    @property
    def length_s(self) -> float | None:
        """Seconds that the recording lasts; None of a device, and of bytes that tell no times."""
        return self._at.dialogue.port.length_s

    @property
    def reached_s(self) -> float | None:
        """Seconds of the recording that have been played, also before a place that it was opened at (``from=``).

        In a loop it begins anew. None where `length_s` is.
        """
        return self._at.dialogue.port.reached_s

    @property
    def measured_scan_frequency(self) -> float | None:
        """Measured revolutions a second, from the latest scan; None before the first."""
        latest = self._scanner.hub.latest
        return None if latest is None else latest.rpm / 60

    @property
    def health(self) -> Health:
        """What the device last said of its state, whether it was asked by the program or by the session."""
        return self._scanner.failures.health

    @property
    def stats(self) -> Stats:
        """Counters since the session was opened, summed over all lines to the device."""
        totals, dropped = self._scanner.control.totals, self._scanner.hub.dropped
        return self._counters.stats(self._at.dialogue, totals, dropped, self._reconnector.count)

    def line_changes(self) -> LineChanges:
        """What becomes of the line, for ``async for``: lost, back, over; for programs that show it.

        It begins with how the line is now, and ends when the session is closed.
        """
        self._check_loop()
        return self._scanner.line.read()

    async def stop(self, *, motor: bool = False) -> None:
        """Stop laser and motor, and end every stream; returns when that was seen. The session stays open.

        With `keep_spinning` it is the laser alone. Every reader ends, behind the scan that waits for it if there is
        one, also where its stream is just being started. Stop requests are written before anything is awaited, or,
        where the device does not listen at that moment, by a timer; and again until the device was seen still. That
        takes a tenth of a second, and more where it takes its time to respond. Cancelling ends only the waiting.

        Args:
            motor: Stop the motor too, in spite of `keep_spinning`, which holds no more from then on.

        Raises:
            StreamFailed: It was not seen still within 2 s: bytes still arrive after several stop requests, or it
                does not respond any more.
            InvalidValue: `motor` is neither True nor False.
        """
        self._check_open()
        if yes_or_no(motor, "motor"):
            self._at.dialogue.stopper.stop_motor_too()
            self._reconnector.stop_motor_too()
        await self._scanner.stop()

    def tap(self, tap: Tap) -> None:
        """Have `tap` called with every chunk of raw bytes, in and out. One that raises is removed, and logged.

        Raises:
            InvalidValue: `tap` cannot be called.
        """
        self._check_open()
        callable_of(tap, "a tap")
        self._at.dialogue.port.add_tap(tap)

    def untap(self, tap: Tap) -> None:
        """Stop calling `tap`. Ignored where it is not there."""
        self._at.dialogue.port.remove_tap(tap)

    def record(
        self,
        path: str | os.PathLike[str],
        *,
        scans: bool | LaserScans = False,
        overwrite: bool = False,
        sync: bool = True,
        split_s: float | None = None,
        split_bytes: int | None = None,
        keep_bytes: int | None = None,
    ) -> Recording:
        """Record every byte in both directions to an MCAP file, for use in ``async with``.

        A thread writes. It ends with the block, or with the session, or by itself where the disk is full or too
        slow; then the log and `Recording.error` say so, and the session goes on. ``open_lidar(path)`` plays it.

        Args:
            path: The file to make.
            scans: Whether to write each scan too, as ``sensor_msgs/msg/LaserScan`` on the topic ``/scan``; or how,
                with a `LaserScans` of its own. All messages of a file are on one grid.
            overwrite: Whether a file that is there already may be replaced.
            sync: Whether the disk is told once a second to write, so that a power cut costs little more than that.
            split_s: Seconds after which the recording goes on in another file, at least 1; None for one file. Names
                are made of `path` and the time in UTC, as ``run-20260131T235959Z.mcap``. `Recording.source` names
                all of them, for ``open_lidar``.
            split_bytes: The same after so many bytes, at least 100000; whichever is reached first.
            keep_bytes: Most bytes of all files of these names, also of earlier recordings: the oldest are removed,
                never the one that is written. None to keep all; at least two files.

        Raises:
            CannotRecord: When the block is entered: the file cannot be made, ``mcap`` is not installed, or whole
                scans arrive from another machine and `scans` is not set, so that nothing would be kept.
            InvalidValue: `path` cannot be the name of a file, or a figure cannot be.
        """
        self._check_open()
        if isinstance(scans, LaserScans):
            messages: LaserScans | None = scans
        else:
            messages = LaserScans() if yes_or_no(scans, "scans") else None
        return Recording(
            path_of(path, "a recording"),
            self._recorded,
            scans=messages,
            overwrite=yes_or_no(overwrite, "overwrite"),
            sync=yes_or_no(sync, "sync"),
            split=Split(split_s, split_bytes, keep_bytes),
        )

    async def close(self) -> None:
        """Stop laser and motor and close the port; returns when it is closed. Harmless when done before.

        Everything else ends with SessionClosed at once: readers, questions, a stream that is being started. The
        stop requests are written before anything is awaited, or, where the device does not listen at that moment,
        by a timer. They are written again until the device was seen still: that takes a tenth of a second, more
        where it takes its time to respond, and up to 2 s where the line loses all. Where it cannot be seen, the log
        says so. Cancelling it ends only the waiting for the port to close, which comes after that.

        Raises:
            LocalProtocolError: It was called in another event loop, such as one of another thread. The session goes
                on: close it in its own loop.
        """
        if self._scanner.is_forked:
            return
        self._check_loop()
        text = f"the session on {self.source} was closed; open_lidar() makes a new one"
        self._scanner.failures.end(SessionClosed(text))
        self._reconnector.cancel()
        await self._at.dialogue.close()
        # Where the loop is closed the coroutine is being collected, and nothing can be waited for.
        ended = self._loop.is_closed()
        if not ended:
            await self._reconnector.ended()
        # Not earlier: a KeyboardInterrupt may come anywhere above, and then the finalizer stops the device.
        self._abandoned.detach()
        if ended:
            return
        await self._scanner.starter.ended()
        await self._recorded.close()

    async def __aenter__(self) -> Self:
        self._check_open()
        return self

    def __aiter__(self) -> NoReturn:
        raise LocalProtocolError("a lidar may have several streams: write `async for scan in lidar.scans():`")

    async def __aexit__(self, *_: object) -> None:
        await self.close()

    def _adopt(self, connection: Connection, health: Health) -> None:
        """There is a new line to the device: from now on it is the one of this session."""
        old, new = self._at.dialogue, connection.dialogue
        for tap in old.port.taps:
            new.port.add_tap(tap)
        self._counters.line_lost(old)
        at = self._at
        # From here on the finalizer of the session leaves this device still.
        at.dialogue, at.info = new, connection.info
        new.port.follow(self._scanner)
        connection.release()
        self._scanner.failures.take_note(health)
        self._recorded.adopt()
        self._scanner.adopt()
        if not self.is_scanning:
            self._reconnector.proven = True

    def _check_open(self) -> None:
        fatal = self._at.dialogue.fatal
        if fatal is not None and not self._scanner.control.is_away:
            raise twin_of(fatal)
        if self._loop.is_closed():
            raise SessionClosed(f"the event loop in which the session on {self.source} was opened is closed")
        self._check_loop()

    def _check_loop(self) -> None:
        try:
            running = asyncio.get_running_loop()
        except RuntimeError:
            running = None
        if running is self._loop:
            return
        if self._scanner.is_forked:
            raise LocalProtocolError(FORKED)
        if running is not None and not self._loop.is_closed():
            raise LocalProtocolError(
                f"the session on {self.source} belongs to another event loop: "
                "use asyncio.run_coroutine_threadsafe() from other threads"
            )


def _abandon(at: At, scanner: Scanner, reconnector: Reconnector) -> None:
    """The session was never closed and nobody holds it any more, or the program ends: leave the device still."""
    scanner.abandon()
    at.dialogue.abandon()
    reconnector.abandon()
