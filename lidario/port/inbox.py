"""What was read from one line and was not handed over yet.

Two threads read into an `Inbox`: the event loop's, and `lidario.port.thread`, which reads while the loop is busy.
A lock makes reading and storing one step, so that the bytes stay in order, and closing waits for a read in
progress, so that no descriptor is read that was closed and may have been reused.

The inbox is bounded. What does not fit is still read and is counted, since nothing tells what the kernel drops.

A line is a terminal, a connection, or a socket for datagrams; a `Kind` says what a read of it tells.
"""

import ctypes
import os
import select
import threading
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass

INBOX_BYTES = 1024 * 1024
"""Most bytes that are kept: 15 s of the fastest stream."""
MOST_BYTES = 256 * 1024
"""Read in a row at most, so that a line that never runs dry cannot keep the reader."""
MOST_READS = 4096
"""Likewise; datagrams may be small."""
_STOOD_NS = 100_000_000
"""Where the bytes of a full buffer came in so much less than the time since the read before, others were lost."""

Read = Callable[[int], bytes]
"""Reads a descriptor, some kilobytes at most. It raises BlockingIOError where nothing is there; it never blocks."""


@dataclass(frozen=True, slots=True)
class Kind:
    """How much one read of a line brings, and what that tells."""

    size: int  # bytes of one read at most
    more: int  # behind a read of so many there may be more; 0 for datagrams, of which each is one read
    loses: bool = False  # whether such a read finds the system's buffer full, and what comes then is lost
    ended: str = "the other end closed it"  # what it means that it is readable, and has nothing to read


TERMINAL = Kind(4096, 4095, loses=True, ended="the line was hung up")
"""On Linux a read of a terminal brings a byte less than its buffer has, at most."""
CONNECTION = Kind(65536, 65536)
DATAGRAMS = Kind(65536, 0)


def make_read(size: int = TERMINAL.size) -> Read:
    """A function that reads a non-blocking descriptor without giving up the interpreter lock.

    `os.read` gives the lock up, and in a program that computes it gets it back 5 ms later, the switch interval of
    the interpreter. So with `os.read` ten ports cannot be read within 50 ms, and each time stamp is 5 ms late. A
    read that does not block takes a few microseconds, for which the lock is kept. Where ctypes is missing,
    `os.read` is used.
    """
    try:
        function = ctypes.PyDLL(None, use_errno=True).read
    except (AttributeError, OSError, TypeError):  # pragma: no cover - no C library to be found, as on Windows
        return lambda handle: os.read(handle, size)
    function.argtypes = (ctypes.c_int, ctypes.c_void_p, ctypes.c_size_t)
    function.restype = ctypes.c_ssize_t
    buffer = ctypes.create_string_buffer(size)
    view = memoryview(buffer)
    address = ctypes.addressof(buffer)

    def read(handle: int) -> bytes:
        count = function(handle, address, size)
        if count < 0:
            number = ctypes.get_errno()
            # OSError makes it a BlockingIOError where nothing is there.
            raise OSError(number, os.strerror(number))
        return bytes(view[:count])

    return read


@dataclass(slots=True)
class Late:
    """What was lost, or may have been, because this computer read a line too late."""

    overflow_bytes: int = 0  # bytes that were read and dropped, because the program did not take them for too long
    full_reads: int = 0  # reads that found the system's buffer full: bytes that came since may be lost


class Inbox:
    """Reads a line, whose descriptor does not block, and keeps what came; any thread may call it."""

    def __init__(
        self,
        handle: int,
        clock: Callable[[], int],
        read: Read | None = None,
        late: Late | None = None,
        kind: Kind = TERMINAL,
    ) -> None:
        self.last_ns: int = clock()  # when it was read last, whether or not anything was there
        self.size: int = 0  # bytes kept
        self.first_ns: int = 0  # when the first bytes that are kept were read; 0 when there are none
        self._late = late or Late()
        self._handle = handle
        self._clock = clock
        # Its buffer is used under the lock of this inbox alone.
        self._read = read or make_read(kind.size)
        self._kind = kind
        # Reentrant: the garbage collector may call `close` during a read.
        self._lock = threading.RLock()
        self._closed = False
        self._shared = True
        self._chunks: list[bytes] = []
        self._arrivals: list[tuple[int, int]] = []
        # The usual pace: how many bytes came, and how long that took; without the time in which nobody read.
        self._came = self._took_ns = 0
        self._from_ns = 0  # since when what is read next has come; 0 where nothing came yet

    def share(self, shared: bool) -> None:
        """Allow or forbid reads of the other thread; when this returns, a read in progress has ended."""
        with self._lock:
            self._shared = shared
            self._came = self._took_ns = self._from_ns = 0

    def read(self, *, from_thread: bool = False) -> None:
        """Read all there is, and keep it with the time.

        Where nobody read for long, as in a program that was stopped by Ctrl-Z, the system has kept what came first:
        its time is that of what was read before, and what so many bytes take at the usual pace.

        Args:
            from_thread: Whether the other thread reads. It reads only while the inbox is shared.

        Raises:
            OSError: The line is dead, or was hung up: it is readable, and has nothing to read.
        """
        with self._lock:
            if self._closed or (from_thread and not self._shared):
                return
            kind, is_cut = self._kind, False
            try:
                data = self._read(self._handle)
                if not data and kind.more and _is_readable(self._handle):
                    # Bytes that came between the two calls, or the end.
                    data = self._read(self._handle)
                    if not data:
                        raise OSError(kind.ended)
                if len(data) >= kind.more:
                    data, is_cut = self._read_on(data)
            except BlockingIOError:
                data = b""
            now = self._clock()
            at_ns, size = now, self.size
            is_rest = self._from_ns < self.last_ns
            if self._came and (is_rest or len(data) >= (kind.more or kind.size)):
                full_ns = self._from_ns + len(data) * self._took_ns // self._came
                at_ns = full_ns if now - full_ns > _STOOD_NS else now
            if self._from_ns:
                self._came += len(data)
                self._took_ns += at_ns - self._from_ns
            if self._from_ns or data:
                # What is left came no later.
                self._from_ns = at_ns if is_cut else now
            self.last_ns = now
            size += len(data)
            if size > INBOX_BYTES:
                self._late.overflow_bytes += len(data)
            elif data:
                self._chunks.append(data)
                self._arrivals.append((size, at_ns))
                self.size, self.first_ns = size, self.first_ns or now

    def _read_on(self, first: bytes) -> tuple[bytes, bool]:
        """Behind a read that was full, all else that waits, and whether that is more than may be read in a row.

        All of it gets one time, or else the last of it would seem to have come late.
        """
        kind, pieces, left = self._kind, [first], MOST_BYTES - len(first)
        self._late.full_reads += kind.loses
        # Where the line has died, the next read tells it.
        with suppress(OSError):
            while len(pieces[-1]) >= kind.more and left > 0 and len(pieces) < MOST_READS:
                pieces.append(self._read(self._handle))
                left -= len(pieces[-1])
        return b"".join(pieces), left <= 0 or len(pieces) >= MOST_READS

    def take(self) -> tuple[list[bytes], list[tuple[int, int]]]:
        """Return what was kept, and empty the inbox: the chunks, and how many bytes had come by when."""
        with self._lock:
            chunks, self._chunks = self._chunks, []
            arrivals, self._arrivals = self._arrivals, []
            self.size = self.first_ns = 0
            return chunks, arrivals

    def close(self) -> None:
        """Stop reading; when this returns, a read in progress in another thread has ended. What was kept stays."""
        with self._lock:
            self._closed = True


def _is_readable(handle: int) -> bool:
    poll = select.poll()  # select() itself refuses file descriptors beyond 1023
    poll.register(handle, select.POLLIN)
    return bool(poll.poll(0))
