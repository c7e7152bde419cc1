"""A file that appears under its name when it is whole, and takes the place of one that was there in one step."""

import contextlib
import errno
import os
import stat
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from secrets import token_hex

_BY_HANDLE = "/proc/self/fd/{}"
_KINDS = {
    stat.S_IFDIR: "a directory", stat.S_IFIFO: "a pipe (FIFO)", stat.S_IFSOCK: "a socket",
    stat.S_IFCHR: "a device", stat.S_IFBLK: "a device",
}  # fmt: skip


def kind_of(mode: int) -> str:
    """What a path leads to, in words, by its mode; empty for a regular file."""
    return "" if stat.S_ISREG(mode) else _KINDS.get(stat.S_IFMT(mode), "no regular file")


def not_a_file(path: Path) -> str:
    """What stands where a file shall be written, in words; empty where that is a regular file, or nothing."""
    try:
        return kind_of(os.stat(path).st_mode)
    except OSError:
        return ""


def is_named_pipe(path: str | os.PathLike[str]) -> bool:
    """Whether `path` is a pipe with a name (FIFO): to open it waits until somebody writes to it, for ever perhaps.

    What a shell puts in the place of ``<(…)`` is a pipe, too, but has no name: somebody writes to it.
    """
    with contextlib.suppress(OSError):
        return stat.S_ISFIFO(os.stat(path).st_mode) and os.path.exists(os.path.realpath(path))
    return False


@contextmanager
def whole_file(path: Path) -> Iterator[Path]:
    """A new file to write to, which takes the name `path` when the block ends; one that fails leaves nothing.

    Where the system has files without a name, as Linux does, nor does a program that is killed meanwhile. A
    symbolic link stays, and leads to the new file.

    Raises:
        OSError: It cannot be written; or what is there is no file, such as ``/dev/null``, and stays.
    """
    path = Path(os.path.realpath(path))
    kind = not_a_file(path)
    if kind:
        raise OSError(errno.EINVAL, f"it is {kind}, which is not replaced by a file")
    part = path.with_name(f".lidario-{token_hex(8)}")
    nameless: int | None = None
    try:
        nameless = _nameless(path.parent)
        if nameless is None:
            open(part, "xb").close()
            yield part
        else:
            yield Path(_BY_HANDLE.format(nameless))
            # Python follows this link only where a folder is named, though none is needed.
            os.link(_BY_HANDLE.format(nameless), part, src_dir_fd=nameless, follow_symlinks=True)
        os.replace(part, path)
    finally:
        with contextlib.suppress(OSError):
            os.unlink(part)
        if nameless is not None:
            os.close(nameless)


def _nameless(folder: Path) -> int | None:
    """A new file in `folder` that goes with this process unless it gets a name; None where there is no such."""
    if hasattr(os, "O_TMPFILE"):
        with contextlib.suppress(OSError):
            handle = os.open(folder, os.O_TMPFILE | os.O_RDWR, 0o666)
            if os.path.exists(_BY_HANDLE.format(handle)):
                return handle
            os.close(handle)
    return None
