"""Why a port could not be opened, and what the user can do about it.

Everything here may block for tens of milliseconds, since it reads ``/proc``: call it off the event loop.
"""

import errno
import os
import re
import stat
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

from lidario.basics.system import cause_of, real_path
from lidario.basics.whole_file import kind_of
from lidario.errors import ConnectFailed
from lidario.families.registry import FAMILIES
from lidario.port.guard import NAME as GUARD
from lidario.port.guard import is_guarded_here

_GONE = (errno.ENOENT, errno.ENXIO, errno.ENODEV, errno.EIO, errno.ENOTDIR, errno.ENAMETOOLONG, errno.ELOOP)
_NOT_SERIAL = (errno.ENOTTY, errno.EINVAL, errno.EISDIR)
_LOCKED = (errno.EBUSY, errno.EAGAIN, errno.EWOULDBLOCK)


def is_pseudo_terminal(path: str) -> bool:
    """Whether `path` is a pseudo-terminal, whose other end always holds it open."""
    return real_path(path).startswith("/dev/pts/")


def held(path: str) -> bool:
    """Whether another program holds the serial port `path` open.

    It is not opened to find out: Linux raises DTR and RTS at each opening, also of a port that is open already, and
    DTR stops the motor of some lidars.

    Raises:
        OSError: It is no terminal (ENOTTY).
    """
    if next(holders(path), None) is None:
        return False
    device = os.stat(path).st_rdev
    kind = f"/sys/dev/char/{os.major(device)}:{os.minor(device)}/subsystem"
    # ``/dev/null`` is held by many. Pseudo-terminals are not in this list.
    if os.path.exists(kind) and os.path.basename(os.path.realpath(kind)) != "tty":
        raise OSError(errno.ENOTTY, os.strerror(errno.ENOTTY), path)
    return True


def holders(path: str) -> Iterator[tuple[int, str]]:
    """Other processes that hold `path` open, as (pid, name); only where /proc tells."""
    for process in Path("/proc").glob("[0-9]*"):
        if process.name != str(os.getpid()) and _holds(process, path):
            with suppress(OSError):
                yield int(process.name), (process / "comm").read_text().strip()


def _holds(process: Path, path: str) -> bool:
    try:
        wanted = os.stat(path)
        for handle in (process / "fd").iterdir():
            found = handle.stat()
            if stat.S_ISCHR(found.st_mode) and found.st_rdev == wanted.st_rdev:
                return True
    except OSError:
        pass
    return False


def busy(path: str) -> ConnectFailed:
    """The error for a port that is held already, with the name of the program where it can be found."""
    who = min(holders(path), key=lambda holder: holder[1] == GUARD, default=None)
    if who is not None and (who[1] != GUARD or not is_guarded_here(path)):
        why = f"is busy: held by PID {who[0]} ({who[1]}). Stop that program first."
    elif _holds(Path("/proc/self"), path):
        why = "is busy: this program has it open already. A lidar is opened once, and may have several readers."
    else:
        why = "is busy: another program holds it. Stop that program first."
    return ConnectFailed(f"{path} {why}", reason="busy")


def why_not_opened(path: str, error: Exception) -> ConnectFailed:
    """Translate what the operating system or pyserial raised while opening `path`."""
    code = _errno(error)
    text = str(error)
    if code in (errno.EACCES, errno.EPERM):
        return _forbidden(path)
    # On Windows pyserial keeps the cause in its text alone. There a port has no permissions, and one that is open
    # elsewhere is denied.
    if code in _LOCKED or "exclusively lock" in text or "PermissionError" in text:
        return busy(path)
    if instead := _instead(path):
        return ConnectFailed(f"{path} {instead}. `lidario devices` lists the ports", reason="missing")
    if code in _NOT_SERIAL or "configure port" in text:
        why = f"is not a serial port, or cannot be set up as one: {os.strerror(code) if code else text}"
        return ConnectFailed(f"{path} {why}. `lidario devices` lists the ports", reason="missing")
    if code in _GONE or "FileNotFoundError" in text or "\0" in path:
        return ConnectFailed(f"no such port: {path!r}. {_meant(path)}", reason="missing")
    if code:
        text = cause_of(OSError(code, os.strerror(code)))
    return ConnectFailed(f"could not open {path!r}: {text}", reason="missing")


def _meant(path: str) -> str:
    """What somebody may have meant who names a port that is not there."""
    if any(path in family.simulated for family in FAMILIES):
        return f"The simulated lidar of that name is sim://{path}"
    if re.fullmatch(r"[\w.-]+:[0-9]{1,5}", path):
        return f"A lidar on the network is tcp://{path} or udp://{path}"
    if os.sep not in path and "\0" not in path and os.path.exists(f"/dev/{path}"):
        return f"Did you mean /dev/{path}?"
    return "Is it plugged in? `lidario devices` lists the ports"


def _instead(path: str) -> str:
    """What the path is; empty where it may be a serial port, or is not there."""
    try:
        mode = os.stat(path).st_mode
    except (OSError, ValueError):
        return ""
    if stat.S_ISREG(mode):
        return "is a file and not a serial port; the name of a recording ends with .mcap or .bin"
    kind = "" if stat.S_ISCHR(mode) else "a device for disks" if stat.S_ISBLK(mode) else kind_of(mode)
    return kind and f"is {kind} and not a serial port"


def _errno(error: Exception) -> int | None:
    """The system's error number; pyserial sometimes keeps it only in a chained exception."""
    cause: BaseException | None = error
    while cause is not None:
        code = getattr(cause, "errno", None)
        if isinstance(code, int):
            return code
        # termios.error is no OSError and keeps its number here.
        if cause.args and isinstance(cause.args[0], int):
            return cause.args[0]
        cause = cause.__context__
    return None


def _forbidden(path: str) -> ConnectFailed:
    try:
        found = os.stat(path)
    except OSError:
        return ConnectFailed(f"no permission for {path}", reason="permission")
    if instead := _instead(path):
        # The cure for a port would open it to everybody, and it would still be no port.
        return ConnectFailed(f"{path} {instead}", reason="missing")
    return ConnectFailed(f"no permission for {path}{_cure(path, found)}", reason="permission")


def _cure(path: str, found: os.stat_result) -> str:
    """Which group owns the port, and how the user gets access."""
    try:
        import grp  # not on Windows

        name = grp.getgrgid(found.st_gid).gr_name
    except ImportError:
        return "."
    except KeyError:
        name = ""
    for_now = f"\nsudo chmod a+rw {path}   until it is unplugged"
    readable = found.st_mode & (stat.S_IRGRP | stat.S_IWGRP) == stat.S_IRGRP | stat.S_IWGRP
    if name and found.st_gid != 0 and readable:
        if found.st_gid in os.getgroups():
            return f" (group {name}, and you are in it).{for_now}"
        return f" (group {name}); you are not in it.\nsudo usermod -aG {name} $USER   then log out and in again"
    # Being in the group root would open far more than this port, and a group without a name cannot be joined.
    whose = f"group {name}" if name else f"group number {found.st_gid}"
    return (
        f" ({whose}, mode {stat.S_IMODE(found.st_mode):o}).{for_now}\n"
        'or for good: a udev rule, SUBSYSTEM=="tty", GROUP="dialout", MODE="0660", '
        "in /etc/udev/rules.d/99-lidar.rules, and yourself in the group dialout"
    )
