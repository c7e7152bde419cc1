"""A recording as a device for anybody's driver, served on a pseudo-terminal or over TCP as a simulated one is.

It responds to each request as the real device had responded, byte for byte. The request that had started a stream
starts it again, and any stop request pauses it. A device that only talks was never asked: its recording is played
from the first call of `transmit` on, and no request pauses it. It does not respond to requests that the recording
does not hold, as a device ignores a request that it does not know; each is logged.
"""

from __future__ import annotations

from collections import deque

from lidario.errors import RecordingError
from lidario.recording.player import Player
from lidario.recording.read import Piece, StoredStreams
from lidario.sim.device import Received
from lidario.wire.envelope import REQUEST_MAGIC, encode_descriptor
from lidario.wire.events import Descriptor

MOST_LOGGED = 1000
LONGEST_REQUEST = 262
"""A request has a length of one byte and six more bytes at most."""


class PlayedDevice:
    """Implements `SimulatedDevice`.

    Args:
        recording: What it plays.
        rate: How many times as fast as it was recorded.
        loop: Whether it begins anew at its end.

    Attributes:
        finished: Whether the recording is at its end.
        error: Why it cannot be read to its end, or None.
    """

    def __init__(self, recording: StoredStreams, *, rate: float = 1.0, loop: bool = False) -> None:
        self.finished: bool = False
        self.error: RecordingError | None = None
        self._recording = recording
        self._again = loop
        self._log: deque[Received] = deque(maxlen=MOST_LOGGED)
        self._incoming = bytearray()
        self._outgoing = bytearray()
        self._scanning = False
        self._player = Player(recording, rate)
        device = recording.streams[0].family.device()
        self._talks = not any(stream.began.request for stream in recording.streams)
        stops = () if self._talks else (device.stop(), device.reset(), *device.halt())
        # A step that only sets a control line has no bytes, and every request begins with none.
        self._stops = {each.data for each in stops if each.data}
        self._starts = {stream.began.request for stream in recording.streams if stream.began.request}
        known = {*self._stops, *self._starts, *recording.responses}
        self._known = sorted(known, key=len, reverse=True)

    @property
    def baudrate(self) -> int:
        """As `SimulatedDevice.baudrate`; 0 where the line had none."""
        return self._recording.streams[0].began.baudrate or self._recording.about.baudrate

    @property
    def log(self) -> list[Received]:
        """The latest requests, oldest first."""
        return list(self._log)

    @property
    def scanning(self) -> bool:
        """Whether the recording is played at the moment."""
        return self._scanning

    @property
    def motor_on(self) -> bool:
        """As `SimulatedDevice.motor_on`: as long as it scans."""
        return self._scanning

    def receive(self, data: bytes, now: int) -> None:
        self._incoming += data
        while self._incoming:
            begin = self._incoming.find(REQUEST_MAGIC)
            del self._incoming[: len(self._incoming) if begin < 0 else begin]
            request = next((each for each in self._known if self._incoming.startswith(each)), None)
            if request is not None:
                del self._incoming[: len(request)]
                self._obey(request, now)
            elif any(each.startswith(self._incoming) for each in self._known):
                return  # the rest of it is still to come
            else:
                end = self._incoming.find(REQUEST_MAGIC, 1)
                unknown = bytes(self._incoming[: LONGEST_REQUEST if end < 0 else end])
                del self._incoming[: len(unknown)]
                if unknown:
                    self._note(unknown, now, "the recording holds no response to it")

    def transmit(self, now: int) -> bytes:
        self._talk()
        while self._scanning and (due := self._due(now)) is not None and due <= now:
            piece = self._peek()
            assert piece is not None
            self._outgoing += piece.data
            self._player.take(piece)
        data = bytes(self._outgoing)
        self._outgoing.clear()
        return data

    def wakeup(self, now: int) -> int | None:
        self._talk()
        if self._outgoing:
            return now
        return self._due(now) if self._scanning else None

    def _peek(self) -> Piece | None:
        """The next piece; None at the end, and where the file cannot be read any more."""
        try:
            return self._player.peek()
        except RecordingError as error:
            self.error = self.error or error
            self.finished = True
            return None

    def _talk(self) -> None:
        """Begin unasked, where the recorded device had done so; never again behind the end."""
        if self._talks and not self.finished and self._peek() is not None:
            self._scanning = True

    def _due(self, now: int) -> int | None:
        """When the next piece is; None at the end."""
        piece = self._peek()
        if piece is None:
            self._player.begin_anew()
            piece = self._peek()
            if not self._again or piece is None or self.error is not None:
                self._scanning = False
                self.finished = True
                return None
        return self._player.due(piece, now)

    def _obey(self, request: bytes, now: int) -> None:
        found = self._recording.responses.get(request)
        if request in self._stops:
            self._scanning = False
        elif request in self._starts:
            if not self._scanning and (piece := self._peek()) is not None:
                self._begin(piece.stream)
        elif self._scanning:
            self._note(request, now, "while it scans")
            return
        elif found is not None:
            self._outgoing += encode_descriptor(Descriptor(found.kind, len(found.payload), continuous=False))
            self._outgoing += found.payload
        self._note(request, now, "")

    def _begin(self, number: int) -> None:
        began = self._recording.streams[number].began
        self._outgoing += encode_descriptor(
            Descriptor(began.mode.response_type, began.packet_size, continuous=True)
        )
        self._scanning = True
        self._player.rest()

    def _note(self, request: bytes, now: int, why: str) -> None:
        self._log.append(Received(now, request.hex(" "), request, not why, why))
