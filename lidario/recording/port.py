"""Playing a recording to a session, as if its device were there (`lidario.recording.fed`).

While no stream is wanted the recording stands still. Where a live stream was interrupted, to ask something or to
change the mode, the session is told to start its stream again, which leads to the next one of the recording. At the
end of the file readers come to their end; who then reads again gets the recording from its beginning.

With a rate of 0 it is played as fast as it is read: only while every reader waits for a scan. No scan is dropped
then.
"""

import asyncio
import logging
from collections.abc import Iterator
from itertools import chain
from pathlib import Path

from lidario.errors import DeviceLost, RecordingError
from lidario.recording.fed import Audience, FedPort
from lidario.recording.read import Piece, Player, StoredStream, StoredStreams

_log = logging.getLogger("lidario")

TICK_S = 0.002  # pieces that are due within this time are handed over together
MOST_AT_ONCE = 64  # pieces after which other tasks may run, where nothing is waited for
MOST_IN_VAIN = 2
"""A recording that was played to its end so often without a scan does not begin anew, also in a loop."""
LOOP_GAP_NS = 1_000_000_000  # between the end of the recording and its beginning, in a loop


class ReplayPort(FedPort):
    """A port with a recording at its other end; needs a running event loop.

    It is played at `rate`, 0 for as fast as it is read, again and again with `loop`, and first the `pieces`, where
    that is not all of it.
    """

    def __init__(
        self,
        recording: StoredStreams,
        *,
        rate: float = 1.0,
        loop: bool = False,
        pieces: Iterator[Piece] | None = None,
    ) -> None:
        if recording.damage:
            _log.warning("%s: %s; everything else is played", recording.path, recording.damage)
        self._recording = recording
        self._rate = rate
        self._again = loop
        self._player = Player(recording, rate, pieces)
        first = self._player.peek()
        self._number = 0 if first is None else first.stream
        self._timer: asyncio.TimerHandle | asyncio.Handle | None = None
        self._played_ns = 0
        self._reached_ns = 0 if first is None else first.at_ns  # as the file says it, also when it is played again
        self._shift_ns = 0
        self._last_ns = 0
        self._offset_deg = 0.0
        self._scans_before = self._in_vain = 0
        super().__init__(str(recording.path), recording.streams[0].began.baudrate)
        self.files: tuple[Path, ...] = tuple(recording.folder / each for each in recording.paths)
        self.length_s: float | None = recording.duration_ns * 1e-9 if recording.timed else None

    @property
    def stream(self) -> StoredStream:
        """The stream that is played, or will be next."""
        return self._recording.streams[self._number]

    @property
    def wall_offset_ns(self) -> int:
        """That of the recorded stream."""
        return self.stream.began.wall_offset_ns

    @property
    def reached_s(self) -> float | None:
        """As `Lidar.reached_s`."""
        return None if self.length_s is None else max(0, self._reached_ns - self._recording.began_ns) * 1e-9

    def now(self) -> int:
        """The time that has been reached in the recording."""
        return self._played_ns

    def follow(self, audience: Audience) -> None:
        """Name the session to which it plays; at a rate of 0, its readers say when to go on."""
        super().follow(audience)
        if not self._rate:
            audience.on_taken(self._arm)

    def announce(self) -> None:
        """Send the descriptor of the stream, which begins with its own zero-angle offset."""
        self._offset_deg = self.stream.began.zero_offset_deg
        super().announce()

    def want(self, on: bool) -> None:
        """Go on, or stand still."""
        super().want(on)
        self._player.rest()
        self._arm()

    def let_go(self, error: DeviceLost | None) -> None:
        """Play no more; the port is told soon that its line is closed, or lost."""
        self._player.end()
        if self._timer is not None:
            self._timer.cancel()
        self._loop.call_soon(self.connection_lost, error)

    def _arm(self) -> None:
        """Come back when the next piece is due."""
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None
        if not self.is_wanted:
            return
        if not self._rate:
            if self.audience.is_waiting:
                self._timer = self._loop.call_soon(self._play)
            return
        piece, now = self._peek(), self._loop.time()
        due = now if piece is None else self._due(piece)
        self._timer = self._loop.call_at(max(due, now + TICK_S), self._play)

    def _due(self, piece: Piece) -> float:
        return self._player.due(piece, round(self._loop.time() * 1e9)) * 1e-9

    def _play(self) -> None:
        self._timer = None
        for _ in range(MOST_AT_ONCE):
            if not self.is_wanted or self.is_forked:
                return
            piece = self._peek()
            if piece is None or piece.stream != self._number:
                self._go_on(piece)
                return
            if self._rate:
                if self._due(piece) > self._loop.time():
                    break
            elif not self.audience.is_waiting:
                return
            self._player.take(piece)
            self._reached_ns = piece.at_ns
            # Time never goes back, whatever a file says.
            self._last_ns = max(self._last_ns, piece.at_ns + self._shift_ns)
            if piece.zero_offset_deg != self._offset_deg:
                self._offset_deg = piece.zero_offset_deg
                self.audience.set_zero_offset(self.offset_of(self._offset_deg), behind=piece.behind)
            self._played_ns = self._last_ns
            self.data_received(piece.data)
        self._arm()

    def _peek(self) -> Piece | None:
        """The next piece; None at the end of the recording, and where it cannot be read any more."""
        try:
            return self._player.peek()
        except RecordingError as error:
            lost = DeviceLost(str(error))
            lost.__cause__ = error
            self.end(lost)
            return None

    def _go_on(self, piece: Piece | None) -> None:
        """The stream is over: go on with the next one, or end."""
        self.is_wanted: bool = False
        ended = piece is None
        if piece is None and self.is_open:
            self._player.begin_anew()
            piece = self._peek()
            if not self._again:
                self._last_ns = 0
            elif piece is not None:
                self._shift_ns = self._last_ns + LOOP_GAP_NS - piece.at_ns
        self._number = 0 if piece is None else piece.stream
        if not self.is_open:
            return
        if ended and (not self._again or piece is None or not self._brings_scans()):
            self.audience.finish()
        else:
            self.audience.restart(failed=not ended and self.stream.began.continues)

    def _brings_scans(self) -> bool:
        """Whether to begin anew: who reads a recording without a full revolution would wait for ever."""
        # The first time a reader may have come when only the end was left.
        self._in_vain = self._in_vain + 1 if self.audience.scans == self._scans_before else 0
        self._scans_before = self.audience.scans
        if self._in_vain < MOST_IN_VAIN:
            return True
        self._in_vain = 0
        return False


def pieces_from(recording: StoredStreams, begin_s: float) -> Iterator[Piece]:
    """What was received from so many seconds behind the first byte on. A long file is read up to there.

    Raises RecordingError where it is over by then, or tells no times.
    """
    if not begin_s:
        return recording.pieces()
    if not recording.timed:
        raise RecordingError(f"{recording.path} tells no times: it is played from its beginning, without from=")
    pieces = recording.pieces()
    begin_ns = recording.began_ns + round(begin_s * 1e9)
    following = next((piece for piece in pieces if piece.at_ns >= begin_ns), None)
    if following is None:
        raise RecordingError(
            f"{recording.path} lasts {recording.duration_ns * 1e-9:.1f} s: from={begin_s:g} is behind its end"
        )
    return chain((following,), pieces)
