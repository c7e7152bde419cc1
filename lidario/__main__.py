"""The command ``lidario``, also as ``python -m lidario``.

Only what must work before anything else is here: the version, which is asked for by scripts and must come at
once, and one sentence for those who installed the library without the command's extra. Everything else is in
`lidario.cli`.
"""

import os
import sys

from lidario.cli.streams import CannotWrite, ReaderGone, emit, finish, message, nowhere

UNEXPECTED = 1
NO_STDOUT = 2
CANNOT_WRITE = 4
NEEDED = ("click", "rich")
"""What the extra `cli` brings and every command needs."""
MISSING_EXTRA = 2
INTERRUPTED = 130


def main() -> int:
    """Run the command with the arguments of the process; returns the exit code."""
    if not _standard_streams():
        message("error: there is nowhere to write to: stdout is closed")
        return NO_STDOUT
    try:
        code = _version() if sys.argv[1:] == ["--version"] else _verb()
    except KeyboardInterrupt:
        # Before there was anything to end, or behind its end.
        code = INTERRUPTED
    finish()
    return code


def _version() -> int:
    from lidario import __version__

    try:
        emit(f"lidario {__version__}\n")
    except ReaderGone:
        return 0
    except CannotWrite as error:
        message(f"error: {error}")
        return CANNOT_WRITE
    return 0


def _verb() -> int:
    # The OpenBLAS in numpy starts a thread for each core, and all of them wait in a loop at first: importing numpy
    # took 0.15 s of CPU time with them and 0.08 s without, on two cores. No verb multiplies matrices.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    for size in ("COLUMNS", "LINES"):
        # Programs that have no terminal tell such a size to those that they start, and rich would draw nothing.
        if os.environ.get(size) == "0":
            del os.environ[size]
    try:
        from lidario.cli.main import cli

        return cli.run(sys.argv[1:])
    except ModuleNotFoundError as error:
        if (error.name or "").partition(".")[0] not in NEEDED:
            return _cannot_load(error)
        message(
            f"error: the command needs {error.name}, which is not installed: pip install click rich websockets mcap"
        )
        return MISSING_EXTRA
    except Exception as error:
        return _cannot_load(error)


def _cannot_load(error: BaseException) -> int:
    """Tell in a line what numpy tells in a page: a package is damaged, or there is no memory to load it."""
    if "--traceback" in sys.argv:
        raise error
    while error.__cause__ is not None:
        error = error.__cause__
    what = " ".join(str(error).split()) or type(error).__name__
    message(
        f"error: the command cannot be loaded: {what}. Is enough memory left (`ulimit -v`), and everything "
        "installed? --traceback shows where"
    )
    return UNEXPECTED


def _standard_streams() -> bool:
    """Replace standard streams that are closed; whether stdout was open.

    Otherwise the serial port would be opened in the place of a closed one, and what is printed would be sent to the
    lidar.
    """
    is_open = sys.stdout is not None
    for name, mode in (("stdin", "r"), ("stdout", "w"), ("stderr", "w")):
        if getattr(sys, name) is None:
            setattr(sys, name, nowhere(mode))
    return is_open


if __name__ == "__main__":
    sys.exit(main())
