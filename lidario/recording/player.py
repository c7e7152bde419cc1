"""Going through a recording in its time: which piece is next, and when it is due, at any rate."""

from __future__ import annotations

from collections.abc import Iterator

from lidario.recording.read import LONGEST_PAUSE_NS, Piece, StoredStreams


class Player:
    """Goes through the pieces of a recording, so many times as fast; first `pieces`, if that is not all of it."""

    def __init__(self, recording: StoredStreams, rate: float, pieces: Iterator[Piece] | None = None) -> None:
        self._recording = recording
        self._rate = rate
        self._pieces = recording.pieces() if pieces is None else pieces
        self._next: Piece | None = None
        # The caller's time and the recorded time that belong together; None while it rests.
        self._base: tuple[int, int] | None = None
        self._stream = -1
        self._reached_ns = 0

    def peek(self) -> Piece | None:
        """The next piece; None at the end.

        Raises:
            RecordingError: The file cannot be read any more; behind that is the end.
        """
        if self._next is None:
            self._next = next(self._pieces, None)
        return self._next

    def take(self, piece: Piece) -> None:
        """The next piece is played: go on to the one behind it."""
        self._next = None
        self._reached_ns = piece.at_ns

    def due(self, piece: Piece, now_ns: int) -> int:
        """When the next piece is due, on the caller's clock.

        The first one of a stream, behind a rest, and behind a pause that is too long is due at once.
        """
        pause_ns = piece.at_ns - self._reached_ns
        if self._base is None or piece.stream != self._stream or pause_ns > LONGEST_PAUSE_NS:
            self._base = (now_ns, piece.at_ns)
            self._stream, self._reached_ns = piece.stream, piece.at_ns
        began_ns, first_ns = self._base
        return began_ns + round((piece.at_ns - first_ns) / self._rate)

    def rest(self) -> None:
        """Nothing is played now: what comes next is due at once."""
        self._base = None

    def begin_anew(self) -> None:
        """Go back to the beginning of the recording."""
        self._pieces, self._next = self._recording.pieces(), None
        self.rest()

    def end(self) -> None:
        """Play no more: the file is closed."""
        self._pieces, self._next = iter(()), None
