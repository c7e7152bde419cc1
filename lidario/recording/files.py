"""Opening a recording by its source, whichever kind of file it is."""

from __future__ import annotations

import logging
from pathlib import Path
from typing import NamedTuple

from lidario.errors import RecordingError
from lidario.families.base import Known
from lidario.recording.raw import RawRecording
from lidario.recording.read import McapRecording, StoredStreams, is_mcap
from lidario.recording.sequence import files_of
from lidario.source import Source, parse_source

__all__ = ["FileSource", "Known", "file_source", "open_stored", "open_stored_source"]

_log = logging.getLogger("lidario")
_PLAYED = ("rate", "loop", "from")


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
