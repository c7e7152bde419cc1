"""Opening a recording by its source, whichever kind of file it is; and reading ``raw.bin``.

Such a file has the bytes as they were received, without times and without what was sent. What stands before the
stream is skipped. Times are made from the number of samples, as `lidario.decode` does, so that a replay and
`decode` give the same stamps.
"""

import logging
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

from lidario.basics.model import DeviceInfo
from lidario.basics.source import Source, parse_source
from lidario.errors import RecordingError
from lidario.families.base import Known
from lidario.recording.about import About
from lidario.recording.chronicle import StreamBegan
from lidario.recording.offline import OfflineDecoder
from lidario.recording.opened import StoredFile
from lidario.recording.read import McapRecording, Piece, StoredStream, StoredStreams, is_mcap
from lidario.recording.sequence import files_of
from lidario.recording.stored_times import StoredTimes
from lidario.wire.events import Packets
from lidario.wire.link import Link

__all__ = ["FileSource", "Known", "file_source", "open_stored", "open_stored_source"]

_log = logging.getLogger("lidario")
_PLAYED = ("rate", "loop", "from")
_PIECE = 1024
"""Bytes that are played at once: what an adapter delivers in 10 ms, or so."""
SEARCHED = 1 << 20  # bytes from the beginning of a file in which its stream must begin


class FileSource(NamedTuple):
    """What a source of the kind ``file`` says; `played` are its options that say how it is played."""

    path: Path
    known: Known = Known()
    played: tuple[str, ...] = ()


def file_source(text: str) -> FileSource | None:
    """The file that a source names; None where it names none. Raises as `parse_source`."""
    source = parse_source(text)
    return _file_source(source) if source.kind == "file" else None


def _file_source(source: Source) -> FileSource:
    sample_us = source.options.get("sample_us")
    known = Known(source.family, source.model, None if sample_us is None else float(sample_us))
    return FileSource(Path(source.address), known, tuple(name for name in source.options if name in _PLAYED))


def open_stored(path: Path, known: Known = Known()) -> StoredStreams:  # noqa: B008 - it cannot be changed
    """Read what a file holds, or all files that a pattern names, as one recording. Raises as `lidario.decode_file`.

    `known` is for bare bytes, MCAP states it itself: it is logged that what was said is not used. A model that is
    guessed is logged, too.
    """
    paths = files_of(path)
    if any(is_mcap(each) for each in paths):
        stored = McapRecording(path, paths)
        if known not in (Known(), Known(stored.about.info.family)):
            _log.warning("%s tells by itself which lidar it is of: what was said of bare bytes is not used", path)
        return stored
    if len(paths) != 1:
        raise RecordingError(
            f"{path} names {len(paths)} files, and none begins as MCAP does: they are empty or damaged, or bare "
            "bytes, which tell no times: then name one of them"
        )
    recording = RawRecording(next(iter(paths)), known)
    if recording.guess:
        _log.warning("%s: %s", recording.path, recording.guess)
    return recording


def open_stored_source(source: Source, family: str | None = None) -> StoredStreams:
    """As `open_stored`, for a source of the kind ``file``."""
    file = _file_source(source)
    return open_stored(file.path, file.known._replace(family=family or file.known.family))


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
        link, times, at_ns = Link(), StoredTimes(stream), 0
        link.enter_stream(stream.format)
        with StoredFile(self.path, self.size, self.folder) as file:
            file.seek(self.streams[0].began.at)
            while data := file.read(_PIECE):
                link.receive_data(data, 0)
                for event in link.events_received():
                    if isinstance(event, Packets):
                        at_ns = times.dated(event).received_ns
                yield Piece(0, at_ns, data, 0.0)
