"""What the environment of the developer changes in programs, and which no test may depend on.

Programs that the tests start inherit the environment, and libraries read it: rich colours what no terminal shows,
click takes the command for a completion, asyncio tells of each step that a busy machine made slow, a client of the
live page asks a proxy for 127.0.0.1. A test that is about such a variable sets it itself.
"""

import os
import signal

from lidario.session.finding import discovery

SET_ASIDE = (
    # Python: containers often set the first one, and it hides what is left in a stream's buffer.
    "PYTHONUNBUFFERED", "PYTHONASYNCIODEBUG", "PYTHONDEVMODE", "PYTHONINSPECT", "PYTHONOPTIMIZE",
    "PYTHONPROFILEIMPORTTIME", "PYTHONSAFEPATH", "PYTHONVERBOSE", "PYTHONWARNINGS",
    # Terminals and colours.
    "CLICOLOR", "CLICOLOR_FORCE", "COLUMNS", "FORCE_COLOR", "LINES", "NO_COLOR", "PY_COLORS", "TTY_COMPATIBLE",
    "TTY_INTERACTIVE", "UNICODE_VERSION",
    # What the command, its libraries and the examples read.
    "LIDAR", "MPLBACKEND", "RUST_LOG", "SSH_CONNECTION", "ZENOH_CONFIG", "_LIDARIO_COMPLETE",
    # Tests that run pytest, with options of their own.
    "PYTEST_ADDOPTS", "PYTEST_DISABLE_PLUGIN_AUTOLOAD", "PYTEST_PLUGINS",
    # No proxy has a way to the servers that tests start.
    "ALL_PROXY", "HTTPS_PROXY", "HTTP_PROXY", "all_proxy", "http_proxy", "https_proxy",
)  # fmt: skip


def set_aside() -> None:
    """Remove these variables from the environment of this process and of those that it starts."""
    for name in SET_ASIDE:
        os.environ.pop(name, None)


def start_fewer_threads() -> None:
    """Have numpy start without threads, here and in programs that tests start: of a hundred that is ten seconds."""
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")


def obey_signals() -> None:
    """Let the signals that tests send do in this process, and in those that it starts, what they usually do."""
    for name in ("SIGINT", "SIGTERM", "SIGHUP", "SIGCHLD"):
        number = getattr(signal, name, None)
        if number is not None and signal.getsignal(number) is signal.SIG_IGN:
            signal.signal(number, signal.default_int_handler if name == "SIGINT" else signal.SIG_DFL)


def search_alone() -> None:
    """Wait for no search of another process of the tests, which its driven clock would take for one that hangs."""
    discovery.NAME += f" of tests in process {os.getpid()}"
