"""Why a port would not open, in the words of somebody who can do something about it."""

from __future__ import annotations

import errno
import os
import stat
from collections.abc import Iterator
from pathlib import Path

from lidario.errors import ConnectFailed

__all__ = ["busy", "holders", "is_pseudo_terminal", "why_not_opened"]

_GONE = (errno.ENOENT, errno.ENXIO, errno.ENODEV, errno.EIO)
_NOT_SERIAL = (errno.ENOTTY, errno.EINVAL)
_LOCKED = (errno.EBUSY, errno.EAGAIN, errno.EWOULDBLOCK)


def is_pseudo_terminal(path: str) -> bool:
    """Whether `path` is a pseudo-terminal, which its other end holds open by nature."""
    return os.path.realpath(path).startswith("/dev/pts/")


def holders(path: str) -> Iterator[tuple[int, str]]:
    """Other processes that hold `path` open, as (pid, name); only where /proc tells, and lets us look."""
    try:
        wanted = os.stat(path)
    except OSError:
        return
    for process in Path("/proc").glob("[0-9]*"):
        if process.name == str(os.getpid()):
            continue
        try:
            for handle in (process / "fd").iterdir():
                found = handle.stat()
                if stat.S_ISCHR(found.st_mode) and found.st_rdev == wanted.st_rdev:
                    yield int(process.name), (process / "comm").read_text().strip()
                    break
        except OSError:
            continue


def busy(path: str) -> ConnectFailed:
    """The error for a port that somebody else uses, with their name where it can be found."""
    who = next(holders(path), None)
    if who is None:
        return ConnectFailed(f"{path} is busy: another program holds it. Stop that program first.", reason="busy")
    return ConnectFailed(
        f"{path} is busy: held by PID {who[0]} ({who[1]}). Stop that program first.", reason="busy"
    )


def why_not_opened(path: str, error: Exception) -> ConnectFailed:
    """Translate what the operating system or pyserial raised while opening `path`."""
    cause: BaseException | None = error
    code: int | None = None
    while cause is not None and code is None:
        code = getattr(cause, "errno", None)
        if code is None and cause.args and isinstance(cause.args[0], int):
            code = cause.args[0]
        cause = cause.__context__
    text = str(error)
    if code in (errno.EACCES, errno.EPERM):
        return _forbidden(path)
    if code in _LOCKED or "exclusively lock" in text:
        return busy(path)
    if code in _GONE or "FileNotFoundError" in text:
        return ConnectFailed(
            f"no such port: {path}. Is it plugged in? `lidario devices` lists the ports", reason="missing"
        )
    if code in _NOT_SERIAL or "configure port" in text:
        return ConnectFailed(f"{path} is not a serial port, or cannot be set up as one ({text})", reason="missing")
    return ConnectFailed(f"could not open {path}: {text}", reason="missing")


def _forbidden(path: str) -> ConnectFailed:
    group = ""
    try:
        import grp  # not on Windows

        name = grp.getgrgid(os.stat(path).st_gid).gr_name
        inside = os.stat(path).st_gid in os.getgroups()
        group = f" (group {name})" if inside else f" (group {name}); you are not in it"
        cure = f"\nsudo usermod -aG {name} $USER   then log out and in again"
    except (ImportError, KeyError, OSError):
        cure = ""
    return ConnectFailed(f"no permission for {path}{group}.{cure}", reason="permission")
