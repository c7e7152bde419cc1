"""Opening a recording by its source, whichever kind of file it is."""

from __future__ import annotations

from pathlib import Path

from lidario.recording.raw import RawRecording
from lidario.recording.read import McapRecording, StoredStreams, is_mcap
from lidario.source import Source

__all__ = ["open_stored", "open_stored_source"]


def open_stored(path: Path, family: str | None = None, sample_us: float | None = None) -> StoredStreams:
    """Read what a file holds; `family` and `sample_us` are for bare bytes, MCAP states them itself.

    Raises:
        RecordingError: Nothing can be read of it.
    """
    return McapRecording(path) if is_mcap(path) else RawRecording(path, family, sample_us)


def open_stored_source(source: Source, family: str | None = None) -> StoredStreams:
    """As `open_stored`, for a source of the kind ``file``."""
    sample_us = source.options.get("sample_us")
    return open_stored(
        Path(source.address), family or source.family, None if sample_us is None else float(sample_us)
    )
