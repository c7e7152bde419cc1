"""The text and the exit code for each failure; nothing else decides them.

Ctrl-C is the normal end of an endless stream: the code is 0. Other signals that end a verb give 128 and
the number of the signal, as a shell does.
"""

from __future__ import annotations

import errno
import traceback
from enum import IntEnum
from importlib.util import find_spec

import click

import lidario
from lidario.basics.system import cause_of, is_exhausted
from lidario.cli.streams import CannotWrite, ReaderGone, message

_PREFIX = "error: "


class ExitCode(IntEnum):
    """How the command ends."""

    OK = 0
    UNEXPECTED = 1
    USAGE = 2  # or a missing extra
    NO_DEVICE = 3  # or several and none named
    NO_ACCESS = 4  # no permission, another program holds the port, or a file cannot be written
    NO_DATA = 5  # or wrong responses
    UNHEALTHY = 6  # the device reports a fault
    BAD_RECORDING = 7  # nothing can be read of it
    INTERRUPTED = 130  # by Ctrl-C, in a verb that had not finished


class Stopped(Exception):
    """The signal of that number ended the verb; laser and motor were stopped first."""

    def __init__(self, number: int) -> None:
        super().__init__(f"stopped by signal {number}")
        self.signal = number


_REASONS: dict[lidario.ConnectReason, ExitCode] = {
    "missing": ExitCode.NO_DEVICE,
    "ambiguous": ExitCode.NO_DEVICE,
    "refused": ExitCode.NO_DEVICE,
    "permission": ExitCode.NO_ACCESS,
    "busy": ExitCode.NO_ACCESS,
    "silent": ExitCode.NO_DATA,
    "source": ExitCode.USAGE,
}

_KINDS: dict[ExitCode, type[BaseException] | tuple[type[BaseException], ...]] = {
    ExitCode.BAD_RECORDING: lidario.RecordingError,
    ExitCode.NO_ACCESS: (lidario.CannotRecord, CannotWrite),
    ExitCode.UNHEALTHY: lidario.DeviceFault,
    ExitCode.NO_DATA: (lidario.DeviceLost, lidario.StreamFailed, lidario.ResponseTimeout, lidario.ProtocolError),
    ExitCode.USAGE: (lidario.Unsupported, lidario.InvalidValue),
    ExitCode.OK: ReaderGone,
    ExitCode.INTERRUPTED: (click.Abort, KeyboardInterrupt),
}


def need(module: str, what: str, package: str = "", otherwise: str = "") -> None:
    """Say it before a lidar is opened where a module is missing: the motor need not start for nothing.

    `package` is its name for pip, where that is another one; `otherwise` is what else can be done.

    Raises:
        Unsupported: It is not installed.
    """
    if find_spec(module) is None:
        name = package or module
        raise lidario.Unsupported(f"{what} needs {name}, which is not installed: pip install {name}{otherwise}")


def cannot_listen(where: str, error: OSError, any_free: str) -> lidario.ConnectFailed:
    """The error of a server that cannot listen there; `any_free` is the option that takes any free port."""
    reasons: dict[int | None, lidario.ConnectReason] = {errno.EADDRINUSE: "busy", errno.EACCES: "permission"}
    cure = f". {any_free} takes any free port" if error.errno == errno.EADDRINUSE else ""
    text = f"cannot listen on {where}: {cause_of(error).partition(' (while')[0]}{cure}"
    return lidario.ConnectFailed(text, reason=reasons.get(error.errno, "source"))


def exit_code_of(reason: lidario.ConnectReason) -> int:
    """The exit code of a connection that failed for this reason."""
    return _REASONS.get(reason, ExitCode.UNEXPECTED)


def exit_code(error: BaseException) -> int:
    """The exit code that `error` ends the command with."""
    if isinstance(error, lidario.ConnectFailed):
        return exit_code_of(error.reason)
    if isinstance(error, click.ClickException):
        return error.exit_code
    if isinstance(error, Stopped):
        return 128 + error.signal
    return next((code for code, kinds in _KINDS.items() if isinstance(error, kinds)), ExitCode.UNEXPECTED)


def report(error: BaseException, *, with_traceback: bool = False) -> None:
    """Write to stderr what went wrong, in one or two lines; nothing where nothing went wrong."""
    text = _words(error)
    if text and with_traceback:
        message("".join(traceback.format_exception(error)).removesuffix("\n"))
    if text:
        message(_PREFIX + text.replace("\n", "\n" + " " * len(_PREFIX)))


def _words(error: BaseException) -> str:
    if isinstance(error, lidario.LidarError | CannotWrite):
        return str(error)
    if isinstance(error, click.exceptions.NoArgsIsHelpError) and isinstance(error.ctx.command, click.Group):
        verbs = ", ".join(f"{error.ctx.command_path} {name}" for name in error.ctx.command.commands)
        return f"what shall it do? {verbs}"
    if isinstance(error, click.ClickException):
        message = error.format_message()
        context = error.ctx if isinstance(error, click.UsageError) else None
        help_line = f"\n{context.command_path} --help   lists what is possible" if context else ""
        return message[:1].lower() + message[1:] + help_line
    if isinstance(error, Stopped | ReaderGone | click.Abort | KeyboardInterrupt):
        return ""
    if is_exhausted(error):
        return cause_of(error)
    what = " ".join(str(error).split())
    return f"unexpected {type(error).__name__}{f': {what}' if what else ''} (--traceback shows where)"
