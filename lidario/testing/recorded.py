"""A recording as what a test works on: as a source for the program, or as the scans themselves."""

import os
from functools import cached_property
from pathlib import Path

from lidario import RecordingError, Scan, decode_file
from lidario.basics.arguments import path_of


class RecordedLidar:
    """A recording.

    Attributes:
        path: The file, ``run.mcap`` or ``raw.bin``.

    Raises:
        RecordingError: There is no such file.
        InvalidValue: `path` cannot be the name of a file.
    """

    def __init__(self, path: str | os.PathLike[str]) -> None:
        self.path: Path = path_of(path, "a recording")
        if not os.path.isfile(self.path):  # Path.is_file raises for names that are too long
            raise RecordingError(f"there is no recording {self.path}")

    def __repr__(self) -> str:
        return f"<RecordedLidar {self.path}>"

    def __fspath__(self) -> str:
        return str(self.path)

    @property
    def source(self) -> str:
        """What `lidario.open_lidar` opens: it is played as fast as it is read, and no scan is dropped."""
        return f"{self.path}?rate=0"

    @cached_property
    def scans(self) -> list[Scan]:
        """All scans, decoded once, without a session and without an event loop.

        Raises:
            RecordingError: Nothing can be read of the file.
        """
        return list(decode_file(self.path))
