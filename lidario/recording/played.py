"""A recording as a device for anybody's driver, served on a pseudo-terminal or over TCP as a simulated one is.

It responds to each request as the real device had responded, byte for byte. The request that had started a stream
starts it again, and any stop request pauses it. A device that was never asked only talks: its recording is played
from the first call of `transmit` on, and no request pauses it. It does not respond to requests that the recording
does not hold, as a device ignores a request that it does not know; each is logged.
"""

import re
from contextlib import suppress

from lidario.errors import RecordingError, Unsupported
from lidario.recording.chronicle import EventState
from lidario.recording.read import Piece, Player, StoredStreams
from lidario.sim.line import RequestLog
from lidario.wire.envelope import REQUEST_MAGIC
from lidario.wire.events import Descriptor

LONGEST_REQUEST = 262  # a request has a length of one byte and six more bytes at most


class PlayedDevice:
    """Implements `SimulatedDevice`: plays a recording, so many times as fast, and again at its end with `loop`.

    It has `finished` at the end of the recording, or with an `error` where that cannot be read.
    """

    scanning: bool = False

    def __init__(self, recording: StoredStreams, *, rate: float = 1.0, loop: bool = False) -> None:
        self.finished: bool = False
        self.error: RecordingError | None = None
        self._recording = recording
        self._again = loop
        self.log: RequestLog = RequestLog()
        self._incoming = bytearray()
        self._outgoing = bytearray()
        self._player = Player(recording, rate)
        self._device = device = recording.streams[0].family.device()
        self._starts = {stream.began.request for stream in recording.streams if stream.began.request}
        self._talks = not self._starts
        stops = [device.stop(), *device.halt(), *device.halt_unknown()]
        with suppress(Unsupported):
            stops.append(device.reset())
        # A step that only sets a control line has no bytes, and every request begins with none.
        self._stops = {each.data: each for each in stops if each.data and not self._talks}
        # As it was when the recording began: the latest that it had said of its health may be why that ended.
        responses = recording.responses | EventState(recording.about.events).responses
        # An empty line before a request of text only ends what was half written.
        self._responses = {request.lstrip(b"\n"): found for request, found in responses.items()}
        self._known = sorted({*self._stops, *self._starts, *self._responses}, key=len, reverse=True)
        self._is_text = device.stop().data.endswith(b"\n")
        firsts = bytes({REQUEST_MAGIC, *(each[0] for each in self._known)})
        self._begins = re.compile(rb"[^\n]" if self._is_text else b"[" + re.escape(firsts) + b"]")

    @property
    def baudrate(self) -> int:
        """As `SimulatedDevice.baudrate`; 0 where the line had none."""
        return self._recording.streams[0].began.baudrate or self._recording.about.baudrate

    @property
    def motor_on(self) -> bool:
        """As `SimulatedDevice.motor_on`: as long as it scans."""
        return self.scanning

    def receive(self, data: bytes, now: int) -> None:
        self._incoming += data
        while request := self._next_request():
            if request in self._known:
                self._obey(request, now)
            else:
                self._note(request, now, "the recording holds no response to it")

    def transmit(self, now: int) -> bytes:
        self._talk()
        while self.scanning and (due := self._due(now)) is not None and due <= now:
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
        return self._due(now) if self.scanning else None

    def _next_request(self) -> bytes:
        """The next one that has come whole, known or not; empty where none has."""
        incoming = self._incoming
        begin = self._begins.search(incoming)
        del incoming[: begin.start() if begin else len(incoming)]
        if self._is_text:
            size = incoming.find(b"\n", 0, LONGEST_REQUEST) + 1
            if not size and len(incoming) >= LONGEST_REQUEST:
                size = LONGEST_REQUEST
        elif known := next((each for each in self._known if incoming.startswith(each)), b""):
            size = len(known)
        elif any(each.startswith(incoming) for each in self._known):
            size = 0
        else:
            end = self._begins.search(incoming, 1)
            size = end.start() if end else LONGEST_REQUEST
        request = bytes(incoming[:size])
        del incoming[:size]
        return request

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
            self.scanning = True

    def _due(self, now: int) -> int | None:
        """When the next piece is; None at the end."""
        piece = self._peek()
        if piece is None:
            self._player.begin_anew()
            piece = self._peek()
            if not self._again or piece is None or self.error is not None:
                self.scanning = False
                self.finished = True
                return None
        return self._player.due(piece, now)

    def _obey(self, request: bytes, now: int) -> None:
        found = self._responses.get(request)
        if request in self._stops:
            self.scanning = False
            self._outgoing += self._stops[request].acknowledged
        elif request in self._starts:
            if not self.scanning and (piece := self._peek()) is not None:
                began = self._recording.streams[piece.stream].began
                head = Descriptor(began.mode.response_type, began.packet_size, continuous=True)
                self._outgoing += self._device.respond(request, head)
                self.scanning = True
                self._player.rest()
        elif self.scanning:
            self._note(request, now, "while it scans")
            return
        elif found is not None:
            head = Descriptor(found.kind, len(found.payload), continuous=False)
            self._outgoing += self._device.respond(request, head, found.payload)
        self._note(request, now, "")

    def _note(self, request: bytes, now: int, why: str) -> None:
        self.log.add(now, request.hex(" "), request, why)
