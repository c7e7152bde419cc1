"""Opening a recording by its source, whichever kind of file it is."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

from lidario.recording.raw import RawRecording
from lidario.recording.read import McapRecording, StoredStreams, is_mcap
from lidario.source import Source, parse_source

__all__ = ["FileSource", "file_source", "open_stored", "open_stored_source"]


class FileSource(NamedTuple):
    """What a source of the kind ``file`` says.

    Attributes:
        path: The file.
        family: Of bare bytes, the name of the family.
        sample_us: Of bare bytes, microseconds a sample.
    """

    path: Path
    family: str | None = None
    sample_us: float | None = None


def file_source(text: str) -> FileSource | None:
    """The file that a source names; None where it names none.

    Raises:
        ConnectFailed: It is no source (reason ``source``).
    """
    source = parse_source(text)
    return _file_source(source) if source.kind == "file" else None


def _file_source(source: Source) -> FileSource:
    sample_us = source.options.get("sample_us")
    return FileSource(Path(source.address), source.family, None if sample_us is None else float(sample_us))


def open_stored(path: Path, family: str | None = None, sample_us: float | None = None) -> StoredStreams:
    """Read what a file holds; `family` and `sample_us` are for bare bytes, MCAP states them itself.

    Raises:
        RecordingError: Nothing can be read of it.
    """
    return McapRecording(path) if is_mcap(path) else RawRecording(path, family, sample_us)


def open_stored_source(source: Source, family: str | None = None) -> StoredStreams:
    """As `open_stored`, for a source of the kind ``file``."""
    path, named, sample_us = _file_source(source)
    return open_stored(path, family or named, sample_us)
