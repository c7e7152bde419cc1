"""The guard of an open line: a process that leaves the device still when this one dies without a farewell.

`os._exit`, SIGKILL, a system that is short of memory, a crash of the interpreter: no code of the program runs then.
So another process must write the stop requests. What it does stands in `lidario.port.guard_process`; here it is
started, told what stops the device, and dismissed. Each line has its own, from its opening on, and so has a line
that reconnecting has made.

Between the two is a pair of sockets. The first message passes the descriptor of the port; each says what stops the
device from now on. The end of the socket is the end of the program, unless a farewell came before. A guard that has
let go of the port ends, and that is seen here as the end of the socket.

The guard is no child of this process: a program that waits for all of its children would wait for the guard too. A
forked child of this process lets go of the socket, or the guard would not learn that the parent is dead.

The guard of a dead program holds the line until it has stopped the device. Who opens the line meanwhile waits
for it (`wait_for_guard`), where /proc tells of it.
"""

from __future__ import annotations

import asyncio
import logging
import os
import signal
import socket
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from pathlib import Path

from lidario.basics.system import real_path
from lidario.errors import Unsupported
from lidario.port.background import run_in_thread
from lidario.port.forked import let_go_in_children
from lidario.wire.envelope import Request

_log = logging.getLogger("lidario")

NAME = "lidario-guard"
"""What the process is called in the list of all processes."""
START_S = 10.0
"""Longest time that starting it may take; usually 20 ms."""
RELEASE_S = 0.5
"""Longest time for which closing the port waits until the guard has let go of it; usually a millisecond. A guard
that is stopped or starved is killed then."""
WAIT_S = 4.0
"""Longest time for which a line is not opened for the guard of a dead program. Mostly it is 0.15 s; 2.7 s where the
device owed a response (`lidario.port.guard_process.LONGEST_S`)."""
_LOOK_S = 0.01
MARGIN_S = 0.005
"""Added to every pause that a device demands: an adapter may deliver one request late and the next one on time."""
_SCRIPT = str(Path(__file__).with_name("guard_process.py"))
_FAREWELL = b"farewell\n"
_HURRIED = b"hurried\n"
_NOTHING_YET = b"0.0 0.0 0\n"
_STATES = {None: "-", False: "0", True: "1"}
_SIZE_OF_PID = 16


def check_guard() -> None:
    """Find out whether this system can have a guard.

    Raises:
        Unsupported: It cannot; the text says why, and the cure.
    """
    if not hasattr(os, "posix_spawn") or not hasattr(socket, "send_fds"):
        raise Unsupported(
            "guard: this system cannot pass an open port on to another process (Windows cannot). Open the lidar "
            "without guard, and see that the program is never killed outright"
        )
    if getattr(sys, "frozen", False) or not sys.executable:
        raise Unsupported(
            "guard: this program brings its own interpreter, which cannot be started a second time. Open the lidar "
            "without guard, or run the program by python"
        )
    if not os.path.exists(_SCRIPT):
        raise Unsupported(
            f"guard: lidario lies in an archive, and python cannot start {_SCRIPT}. Install it as files, or open "
            "the lidar without guard"
        )


async def start_guard(port: str) -> Guard:
    """Start the process, in a thread. Cancelling ends it again."""
    loop = asyncio.get_running_loop()
    guard = await run_in_thread(lambda: Guard(port, loop), Guard.dismiss_at_once)
    guard.watch()
    return guard


class Guard:
    """The guard of one line. Made in a thread, since it waits until the process runs.

    Args:
        port: How the line is called.
        loop: The loop that is to see its end.

    Attributes:
        awaits_change: Whether it was told that the device may not listen, which may have changed since.

    Raises:
        Unsupported: The process could not be started.
    """

    def __init__(self, port: str, loop: asyncio.AbstractEventLoop) -> None:
        self._port, self._loop = port, loop
        self._told = b""
        self.awaits_change: bool = False
        self._ended = False
        self._dismissed: Callable[[], None] | None = None
        self._timer: asyncio.TimerHandle | None = None
        try:
            self._channel, self._pid = _started(port)
        except (OSError, ValueError) as error:
            why = "it ended at once" if isinstance(error, ValueError) else error
            raise Unsupported(
                f"guard: {sys.executable} could not start its process ({why}). Open the lidar without guard"
            ) from error
        # Where this process is the one that orphans are given to, as the first one of a container is.
        self._is_ours = _reap(self._pid, os.WNOHANG)
        let_go_in_children(self)

    def watch(self) -> None:
        """Have the loop see its end."""
        self._loop.add_reader(self._channel.fileno(), self._readable)

    def take(self, handle: int, *, hurried: bool = False) -> None:
        """Pass it the line. It writes nothing before it was told what stops the device.

        Args:
            handle: The descriptor.
            hurried: Whether low latency was set, which it is to give back.
        """
        with suppress(OSError):
            socket.send_fds(self._channel, [_HURRIED * hurried + _NOTHING_YET], [handle])

    def tell(self, requests: Sequence[Request], last: Sequence[Request], listens_at: float) -> None:
        """Say what stops the device from now on. To be called before anything is written that changes it.

        Args:
            requests: The stop requests, at least one.
            last: What is written once after them, since the device may not hear anything then.
            listens_at: When the device listens at the latest, on the monotonic clock.
        """
        awaits_change = listens_at > time.monotonic()
        settle = max(request.settle for request in requests) + MARGIN_S
        # As `lidario.port.guard_process.order_in` reads it.
        words = [repr(settle), repr(listens_at if awaits_change else 0.0), str(len(last))]
        words += [_STATES[request.dtr] + request.data.hex() for request in (*last, *requests)]
        message = " ".join(words).encode() + b"\n"
        if message != self._told and self.send(message):
            self._told, self.awaits_change = message, awaits_change

    def dismiss(self, then: Callable[[], None]) -> None:
        """Say farewell: nothing is to be stopped any more. Calls `then` when it has let go of the line."""
        if self._loop.is_closed():
            self.dismiss_at_once()
        if self._ended:
            then()
            return
        self._dismissed = then
        self.send(_FAREWELL)
        self._timer = self._loop.call_later(RELEASE_S, self._give_up)

    def dismiss_at_once(self) -> None:
        """As `dismiss`, without a loop; blocks for a millisecond, `RELEASE_S` at most."""
        if self._ended:
            return
        self.send(_FAREWELL)
        with suppress(OSError):
            self._channel.settimeout(RELEASE_S)
            self._channel.recv(1)
        self._kill()
        self._end()

    def forked(self) -> None:
        """Close this end of the socket, in a forked child: it is the parent's guard."""
        self._ended = True
        self._channel.close()

    def send(self, message: bytes) -> bool:
        """Send it a line; False where the guard is stopped, or gone."""
        try:
            return self._channel.send(message) == len(message)
        except OSError:
            return False

    def _readable(self) -> None:
        """Nothing is ever sent: it is the end."""
        self._loop.remove_reader(self._channel.fileno())
        self._end()
        if self._dismissed is None:
            _log.warning(
                "%s: its guard has ended (was it killed?). The session goes on, but laser and motor too, if this "
                "program is killed",
                self._port,
            )
            return
        if self._timer is not None:
            self._timer.cancel()
        self._dismissed()

    def _give_up(self) -> None:
        """It did not let go in time."""
        self._kill()
        self._readable()

    def _kill(self) -> None:
        """It had nothing to do any more. The number is its own as long as the socket has not ended."""
        self._channel.setblocking(False)
        try:
            self._channel.recv(1)
        except BlockingIOError:  # no end, and nothing is ever sent
            with suppress(OSError):
                os.kill(self._pid, signal.SIGKILL)
        except OSError:
            pass

    def _end(self) -> None:
        self._ended = True
        self._channel.close()
        if self._is_ours:
            _reap(self._pid)


def _started(port: str) -> tuple[socket.socket, int]:
    """Start the process; returns the socket that leads to it, which does not block, and its number.

    Raises:
        OSError: It does not come to run.
        ValueError: It has ended at once.
    """
    nothing = (os.POSIX_SPAWN_OPEN, 1, os.devnull, os.O_WRONLY, 0), (os.POSIX_SPAWN_DUP2, 1, 2)
    ours, theirs = socket.socketpair()
    child = 0
    try:
        with theirs:
            child = os.posix_spawn(
                sys.executable,
                # -I and -S: nothing of the user's is imported. The last arguments tell others whose guard it is, of
                # what.
                [sys.executable, "-I", "-S", _SCRIPT, NAME, str(os.getpid()), port],
                os.environ,
                file_actions=[(os.POSIX_SPAWN_DUP2, theirs.fileno(), 0), *nothing],
                # Those of the terminal, and those that a service manager sends to all processes of a service, must
                # not end it before the program.
                setsigmask=signal.valid_signals(),
            )
        ours.settimeout(START_S)
        pid = int(ours.recv(_SIZE_OF_PID))
    except BaseException:
        ours.close()
        if child:
            with suppress(OSError):
                os.kill(child, signal.SIGKILL)
        raise
    finally:
        # It ends as soon as the guard runs.
        if child:
            _reap(child)
    ours.setblocking(False)
    return ours, pid


def _reap(child: int, options: int = 0) -> bool:
    """Wait for a child; False where it is none, or somebody else has waited for it."""
    try:
        os.waitpid(child, options)
    except OSError:
        return False
    return True


def wait_for_guard(line: str) -> None:
    """Block while the guard of a dead program holds this line, a serial port or one of a network.

    A bridge may take one connection only, and a device would hear both.
    """
    deadline = time.monotonic() + WAIT_S
    while time.monotonic() < deadline:
        same = real_path(line)  # a serial port has several names
        if not any(real_path(held) == same and _is_dead(program) for program, held in _guards()):
            return
        time.sleep(_LOOK_S)


def is_guarded_here(line: str) -> bool:
    """Whether this line, as for `wait_for_guard`, has a guard of this program, which holds it then."""
    same = real_path(line)
    return any(program == os.getpid() and real_path(held) == same for program, held in _guards())


def _guards() -> Iterator[tuple[int, str]]:
    """All guards: the number of the program of each, and its line as that has named it."""
    for process in Path("/proc").glob("[0-9]*"):
        try:
            # NAME, PID and PORT; a zero byte ends each.
            *_, name, program, line, _ = os.fsdecode((process / "cmdline").read_bytes()).split("\0")
            if name == NAME:
                yield int(program), line
        except (OSError, ValueError):
            continue  # it has just ended, or has fewer arguments


def _is_dead(pid: int) -> bool:
    """Whether a process has ended, be it a zombie or gone."""
    try:
        state = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0]
    except OSError:
        return True
    return state in "ZX"
