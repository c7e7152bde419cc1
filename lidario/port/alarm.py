"""Sleep until a time that other threads may put off, or bring forward, while it lasts.

Putting it off must not cost a wake-up, since it is done each time the event loop was in time. On Linux the kernel's
timer can be set anew while a thread waits for it. Elsewhere the thread wakes at the old time and sleeps on.
"""

import ctypes
import os
import threading
import time
from typing import Final

_CLOEXEC: Final = getattr(os, "O_CLOEXEC", 0)  # TFD_CLOEXEC is the same
_ABSOLUTE: Final = 1
"""TFD_TIMER_ABSTIME of timerfd_settime(2)."""
_LAST_S: Final = 2**31 - 1
"""The greatest number of seconds where C's `long` has 32 bits."""


class Alarm:
    """One thread waits; any thread sets until when. Times are seconds of the monotonic clock.

    This one wakes at each time that it was told, and looks; `TimerAlarm` does not where the time was put off.
    """

    def __init__(self) -> None:
        self.at: float = 0.0  # until when
        self._earlier = threading.Event()

    def set(self, at: float) -> None:
        """Wait until then, also in a `wait` that has begun. Not to be called by two threads at once."""
        earlier = at < self.at
        self.at = at
        if earlier:
            self._earlier.set()

    def wait(self) -> None:
        """Return when it is time."""
        while (rest := self.at - time.monotonic()) > 0:
            self._earlier.wait(rest)
            # Before the time is read again: one that was set since is seen.
            self._earlier.clear()

    def close(self) -> None:
        """Give back what the system gave; no thread may wait then."""


class TimerAlarm(Alarm):
    """By timerfd_create(2).

    Raises:
        OSError: The system gives no timer.
        AttributeError: It is none that could.
    """

    def __init__(self) -> None:
        super().__init__()
        # The interpreter lock is kept: the calls take no time, and waiting for it would.
        library = ctypes.PyDLL(None, use_errno=True)
        create, self._set = library.timerfd_create, library.timerfd_settime
        create.argtypes = (ctypes.c_int, ctypes.c_int)
        self._set.argtypes = (ctypes.c_int, ctypes.c_int, ctypes.c_void_p, ctypes.c_void_p)
        # Two times, the first of which is that of repeats; each in seconds and nanoseconds.
        self._times = (ctypes.c_long * 4)()
        self._address = ctypes.addressof(self._times)
        self._handle = create(time.CLOCK_MONOTONIC, _CLOEXEC)
        if self._handle < 0:
            raise OSError(number := ctypes.get_errno(), os.strerror(number))

    def set(self, at: float) -> None:
        self.at = at
        times, at = self._times, min(at, _LAST_S)
        times[2] = int(at)
        # Zero would stop it.
        times[3] = int(at % 1 * 1e9) or 1
        self._set(self._handle, _ABSOLUTE, self._address, None)

    def wait(self) -> None:
        os.read(self._handle, 8)

    def close(self) -> None:
        os.close(self._handle)


def make_alarm() -> Alarm:
    """The best that there is."""
    try:
        return TimerAlarm()
    except (AttributeError, MemoryError, OSError, TypeError):
        return Alarm()
