"""A port that plays a file: the session above it is the one of a live device.

The line waits for the request `PLAY`, sends the descriptor of the stream that comes next, and from the moment the
session takes packets it hands over what was recorded, in the same pieces and with the times at which they came. So
the scans have the stamps that the live ones had. While no stream is wanted it stands still.

Where a live stream was interrupted, to ask something or to change the mode, the session is told to start its
stream again, which leads to the next one of the recording. At the end of the file readers come to their end; who
then reads again gets the recording from its beginning.

With a rate of 0 it is played as fast as it is read: only while every reader waits for a scan. No scan is dropped
then.
"""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Callable, Iterator
from itertools import chain
from typing import Any, Protocol

from lidario.errors import DeviceLost, RecordingError
from lidario.port.line import Line, Schedule
from lidario.port.port import Port
from lidario.recording.device import PLAY, mode_type
from lidario.recording.read import LONGEST_PAUSE_NS, Piece, StoredStream, StoredStreams
from lidario.wire.envelope import encode_descriptor
from lidario.wire.events import Descriptor

__all__ = ["Audience", "ReplayPort", "open_replay", "pieces_from"]

_log = logging.getLogger("lidario")

TICK_S = 0.002
"""Pieces that are due within this time are handed over together."""
MOST_AT_ONCE = 64
"""Pieces after which other tasks may run, where nothing is waited for."""
MOST_IN_VAIN = 2
"""A recording that was played to its end so often without a scan does not begin anew, also in a loop."""
LOOP_GAP_NS = 1_000_000_000
"""Between the end of the recording and its beginning, in a loop."""


class Audience(Protocol):
    """The session, as far as a replay needs it."""

    def restart(self, *, failed: bool) -> None:
        """The stream was interrupted here, or had `failed`: start it again."""
        ...

    def set_zero_offset(self, degrees: float, *, behind: bool) -> None:
        """Here another zero-angle offset was chosen, clockwise degrees; it holds as in `Piece`."""
        ...

    def finish(self) -> None:
        """The recording is at its end: end every stream."""
        ...

    @property
    def scans(self) -> int:
        """Scans that were made so far."""
        ...

    @property
    def is_waiting(self) -> bool:
        """Whether every reader has taken all its scans."""
        ...

    def on_taken(self, callback: Callable[[], None]) -> None:
        """Call `callback` each time a reader has taken a scan, or has left; and drop no scan any more."""
        ...


class ReplayPort(Port):
    """A port with a recording at its other end.

    Args:
        recording: The recording.
        rate: How many times as fast as it was recorded; 0 for as fast as it is read.
        loop: Whether it begins anew at its end.
        pieces: What is played first, where that is not all of it.

    Attributes:
        offset_of: The zero-angle offset to add where the recording has another one.
    """

    def __init__(
        self, recording: StoredStreams, *, rate: float, loop: bool, pieces: Iterator[Piece] | None = None
    ) -> None:
        self.offset_of: Callable[[float], float] = lambda recorded_deg: recorded_deg
        if recording.damage:
            _log.warning("%s: %s; everything else is played", recording.path, recording.damage)
        first = recording.streams[0].began
        super().__init__(str(recording.path), first.baudrate)
        self._played_ns = 0
        self._length_s = recording.duration_ns * 1e-9 if recording.timed else None
        self._replay = _ReplayLine(self, recording, rate, loop, pieces or recording.pieces())
        self.connection_made(self._replay)

    @property
    def is_live(self) -> bool:
        """As `Port.is_live`."""
        return False

    @property
    def length_s(self) -> float | None:
        """As `Lidar.length_s`."""
        return self._length_s

    @property
    def wall_offset_ns(self) -> int:
        """As `Port.wall_offset_ns`: that of the recorded stream."""
        return self.stream.began.wall_offset_ns

    @property
    def stream(self) -> StoredStream:
        """The stream that is played, or will be next."""
        return self._replay.stream

    def now(self) -> int:
        """The time that has been reached in the recording."""
        return self._played_ns

    def follow(self, audience: Any) -> None:
        """Name the session (an `Audience`) that it plays to."""
        self._replay.follow(audience)

    def play(self, data: bytes, at_ns: int) -> None:
        """Hand over what was recorded at that time."""
        self._played_ns = at_ns
        self.show("in", data, at_ns)
        self.hand_over(data, at_ns)


class _ReplayLine(Line):
    """Plays the recording into the port."""

    def __init__(
        self, port: ReplayPort, recording: StoredStreams, rate: float, loop: bool, pieces: Iterator[Piece]
    ) -> None:
        self._loop = asyncio.get_running_loop()
        self._port = port
        self._recording = recording
        self._rate = rate
        self._again = loop
        self._audience: Audience | None = None
        self._closing = False
        self._pieces = pieces
        self._next: Piece | None = next(pieces, None)
        self._number = 0 if self._next is None else self._next.stream
        self._wanted = False
        self._timer: asyncio.TimerHandle | asyncio.Handle | None = None
        # Loop time and recorded time that belong together since the stream began; None before its first piece.
        self._base: tuple[float, int] | None = None
        self._reached_ns = 0
        self._shift_ns = 0
        self._last_ns = 0
        self._offset_deg = 0.0
        self._scans_before = self._in_vain = 0

    @property
    def stream(self) -> StoredStream:
        return self._recording.streams[self._number]

    def follow(self, audience: Audience) -> None:
        self._audience = audience
        if not self._rate:
            audience.on_taken(self._arm)

    def is_closing(self) -> bool:
        return self._closing

    def write(self, data: bytes) -> None:
        if data != PLAY or self._closing:
            return
        began = self.stream.began
        self._port.baudrate = began.baudrate
        self._offset_deg = began.zero_offset_deg
        announced = encode_descriptor(Descriptor(mode_type(self.stream), began.packet_size, continuous=True))
        self._loop.call_soon(self._announce, announced)

    def set_polling(self, latency: float, schedule: Schedule | None) -> None:  # noqa: ARG002
        # The session takes packets from now on, or no more.
        self._wanted = schedule is not None
        self._base = None
        self._arm()

    def close(self) -> None:
        self._end()

    def abort(self) -> None:
        self._end()

    def write_without_loop(self, data: bytes) -> None:
        """A recording takes no bytes: they are dropped."""

    def close_without_loop(self) -> None:
        self._closing = True

    def _announce(self, descriptor: bytes) -> None:
        if not self._closing:
            self._port.play(descriptor, self._port.now())

    def _arm(self) -> None:
        """Come back when the next piece is due."""
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None
        if not self._wanted or self._closing:
            return
        if not self._rate:
            if self._audience is None or self._audience.is_waiting:
                self._timer = self._loop.call_soon(self._play)
            return
        due = self._due()
        self._timer = self._loop.call_at(max(due, self._loop.time() + TICK_S), self._play)

    def _due(self) -> float:
        """When the next piece is due; the first one of a stream is so at once."""
        piece = self._peek()
        now = self._loop.time()
        if piece is None:
            return now
        if self._base is None or piece.at_ns - self._reached_ns > LONGEST_PAUSE_NS:
            self._base = (now, piece.at_ns)
            self._reached_ns = piece.at_ns
        began, first_ns = self._base
        return began + (piece.at_ns - first_ns) * 1e-9 / self._rate

    def _play(self) -> None:
        self._timer = None
        for _ in range(MOST_AT_ONCE):
            if not self._wanted or self._closing or self._port.is_forked:
                return
            piece = self._peek()
            if piece is None or piece.stream != self._number:
                self._go_on(piece)
                return
            if self._rate:
                if self._due() > self._loop.time():
                    break
            elif self._audience is not None and not self._audience.is_waiting:
                return
            self._next = None
            self._reached_ns = piece.at_ns
            # Time never goes back, whatever a file says.
            self._last_ns = max(self._last_ns, piece.at_ns + self._shift_ns)
            if piece.zero_offset_deg != self._offset_deg:
                self._offset_deg = piece.zero_offset_deg
                if self._audience is not None:
                    self._audience.set_zero_offset(self._port.offset_of(self._offset_deg), behind=piece.behind)
            self._port.play(piece.data, self._last_ns)
        self._arm()

    def _peek(self) -> Piece | None:
        """The next piece; None at the end of the recording."""
        if self._next is None:
            try:
                self._next = next(self._pieces, None)
            except RecordingError as error:
                self._end(error)
        return self._next

    def _go_on(self, piece: Piece | None) -> None:
        """The stream is over: go on with the next one, or end."""
        self._wanted = False
        self._base = None
        ended = piece is None
        if piece is None:
            self._pieces = self._recording.pieces()
            piece = self._peek()
            if not self._again:
                self._last_ns = 0
            elif piece is not None:
                self._shift_ns = self._last_ns + LOOP_GAP_NS - piece.at_ns
        self._number = 0 if piece is None else piece.stream
        if self._audience is None or self._closing:
            return
        if ended and (not self._again or piece is None or not self._brings_scans(self._audience)):
            self._audience.finish()
        else:
            self._audience.restart(failed=not ended and self.stream.began.continues)

    def _brings_scans(self, audience: Audience) -> bool:
        """Whether to begin anew: who reads a recording without a full revolution would wait for ever."""
        # The first time a reader may have come when only the end was left.
        self._in_vain = self._in_vain + 1 if audience.scans == self._scans_before else 0
        self._scans_before = audience.scans
        if self._in_vain < MOST_IN_VAIN:
            return True
        self._in_vain = 0
        return False

    def _end(self, error: RecordingError | None = None) -> None:
        if self._closing:
            return
        self._closing = True
        self._wanted = False
        if self._timer is not None:
            self._timer.cancel()
        self._next = None
        self._pieces = iter(())
        lost = None
        if error is not None:
            lost = DeviceLost(str(error))
            lost.__cause__ = error
        self._loop.call_soon(self._port.connection_lost, lost)


def pieces_from(recording: StoredStreams, begin_s: float) -> Iterator[Piece]:
    """What was received from so many seconds behind the first byte on. A long file is read up to there.

    Raises:
        RecordingError: The recording is over by then, or tells no times.
    """
    if not begin_s:
        return recording.pieces()
    if not recording.timed:
        raise RecordingError(f"{recording.path} tells no times: it is played from its beginning, without from=")
    pieces = recording.pieces()
    first = next(pieces, None)
    begin_ns = 0 if first is None else first.at_ns + round(begin_s * 1e9)
    following = next((piece for piece in pieces if piece.at_ns >= begin_ns), None)
    if following is None:
        raise RecordingError(
            f"{recording.path} lasts {recording.duration_ns * 1e-9:.1f} s: from={begin_s:g} is behind its end"
        )
    return chain((following,), pieces)


def open_replay(
    recording: StoredStreams, *, rate: float = 1.0, loop: bool = False, pieces: Iterator[Piece] | None = None
) -> ReplayPort:
    """A port that plays `recording`, and `pieces` of it before all else; needs a running event loop."""
    return ReplayPort(recording, rate=rate, loop=loop, pieces=pieces)
