"""What the operating system says of a failure, as the end of a sentence, with the cure where it is not plain."""

import errno
import os
from pathlib import Path
from typing import Final, TypeGuard

NO_FILES: Final = "this program may open no more files: `ulimit -n`, or LimitNOFILE of its service, says how many"
NO_THREADS: Final = (
    "the system allows no more threads: `ulimit -u`, or TasksMax of its service, says how many, and each needs "
    "memory (`ulimit -v`)"
)


def is_exhausted(error: BaseException) -> TypeGuard[OSError | MemoryError]:
    """Whether the system gives this program no more files, or no more memory."""
    return isinstance(error, MemoryError) or (isinstance(error, OSError) and error.errno == errno.EMFILE)


def cause_of(error: OSError | MemoryError) -> str:
    """Why it could not be done."""
    if isinstance(error, MemoryError):
        return "no memory is left"
    if is_exhausted(error):
        return NO_FILES
    text = error.strerror or str(error)
    return text[:1].lower() + text[1:]


def working_folder() -> Path:
    """The folder in which relative paths begin now; where it was removed, one in which nothing is found.

    A program may go to another folder, as a daemon does. What opens a path again begins in this one.
    """
    try:
        return Path.cwd()
    except OSError:
        return Path()


def real_path(path: str) -> str:
    """The path behind all links; as it is where it begins in the working folder, and that was removed."""
    try:
        return os.path.realpath(path)
    except OSError:
        return path
