"""Reading ``raw.bin``: bytes as they were received, without times and without what was sent.

What stands before the stream is skipped. Times are made from the number of samples, as `lidario.decode` does, so
that a replay and `decode` give the same stamps.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

from lidario.errors import RecordingError
from lidario.families.base import Known
from lidario.model import DeviceInfo
from lidario.recording.about import About
from lidario.recording.chronicle import StreamBegan
from lidario.recording.offline import OfflineDecoder
from lidario.recording.opened import StoredFile
from lidario.recording.read import Piece, StoredStream, StoredStreams
from lidario.recording.stored_times import StoredTimes
from lidario.revolution.incoming import Incoming
from lidario.revolution.stats import AssemblerStats
from lidario.wire.events import Packets
from lidario.wire.link import Link

_PIECE = 1024
"""Bytes that are played at once: what an adapter delivers in 10 ms, or so."""
SEARCHED = 1 << 20
"""Bytes from the beginning of a file in which its stream must begin."""


class RawRecording(StoredStreams):
    """Bytes of one stream; `guess` is that of `RawStream`. Raises as `lidario.decode_file`."""

    def __init__(self, path: Path, known: Known = Known()) -> None:  # noqa: B008 - it cannot be changed
        super().__init__(path, timed=False)
        with StoredFile(path) as file:
            self.size: int = file.size
            head = file.read(SEARCHED)
        try:
            decoder = OfflineDecoder(head, known)
        except RecordingError as error:
            raise RecordingError(f"{path}: {error}") from None
        stream, found = decoder.stream, decoder.family
        self.guess: str = decoder.guess
        model = (decoder.title or f"{found.title} (model not recorded)") + (" (a guess)" if decoder.guess else "")
        info = DeviceInfo(found.name, model, 0, "", 0, "")
        self.about: About = About(info, source=str(path))
        began = StreamBegan.of(stream, decoder.begin, b"", 0, 0)
        began = replace(began, mode=replace(stream.mode, typical=True))
        self.streams: tuple[StoredStream, ...] = (StoredStream(found, began, timed=False),)

    def pieces(self) -> Iterator[Piece]:
        """As `StoredStreams.pieces`; a piece has come when its last whole packet was measured."""
        stream = self.streams[0].open()
        link = Link()
        link.enter_stream(stream.format)
        incoming = Incoming(stream, AssemblerStats(), StoredTimes(stream))
        at_ns = 0
        with StoredFile(self.path, self.size) as file:
            file.seek(self.streams[0].began.at)
            while data := file.read(_PIECE):
                link.receive_data(data, 0)
                for event in link.events_received():
                    if isinstance(event, Packets) and (taken := incoming.take(event)) is not None:
                        at_ns = taken[0].received_ns
                yield Piece(0, at_ns, data, 0.0)
