"""Ctrl-C at a chosen place of the main thread: between any two lines, or only where the interpreter raises it.

CPython looks for a signal where a Python function begins and where a C function has returned. So it never raises
KeyboardInterrupt between the last line of a ``with lock:`` and the release of the lock, as a line tracer does. Code
that takes no lock is tested at every line; code that takes one, at every call.

Nor does it raise between the taking of the lock and the block, but for Python 3.14 up to 3.14.8 at least. There the
lock stays taken, and no code in Python can prevent it (https://github.com/python/cpython/issues/148874).
"""

import _thread
import asyncio
import gc
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType
from typing import Any, Self

PATIENCE_S = 20.0
NOT_OURS = ("_weakrefset.py", "selectors.py")
"""Python ignores what is raised in the callback of a weak reference; an event loop is broken where its own selector
was interrupted."""


@contextmanager
def as_if_running(loop: asyncio.AbstractEventLoop) -> Iterator[None]:
    """Have `loop` be the running one of this thread, so that a step of a coroutine can be taken by hand."""
    set_running = asyncio._set_running_loop  # noqa: SLF001 - asyncio has it for event loops
    set_running(loop)
    try:
        yield
    finally:
        set_running(None)


@contextmanager
def no_collection() -> Iterator[None]:
    """Garbage is collected at any moment, and Python ignores what is raised in a finalizer."""
    was_enabled = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if was_enabled:
            gc.enable()


class CtrlC:
    """Raises KeyboardInterrupt at the n-th line that is executed in its block, if there are so many.

    Args:
        line: Which line, from 0 on; those of what is called are counted too.
        folders: Only lines of files whose paths have one of these in them are counted; by default all.
    """

    def __init__(self, line: int, *folders: str) -> None:
        self.place = ""  # where that was; empty where there are fewer lines
        self._left = line
        self._folders = folders or ("",)

    def __enter__(self) -> None:
        self._before = sys.gettrace()
        sys.settrace(self._trace)

    def __exit__(self, *exception: object) -> None:
        sys.settrace(self._before)

    def _trace(self, frame: FrameType, event: str, _: object) -> Any:
        path = frame.f_code.co_filename
        # Python ignores what is raised in the callback of a weak reference. Raised in `__exit__`, it would keep the
        # tracer of before from coming back: that of coverage.
        if not any(each in path for each in self._folders) or "_weakrefset" in path or path == __file__:
            return None
        if event == "line":
            self._left -= 1
            if self._left < 0:
                sys.settrace(None)
                self.place = f"{frame.f_code.co_qualname}:{frame.f_lineno}"
                raise KeyboardInterrupt(self.place)
        return self._trace


def interrupted(line: int, function: Callable[[], object]) -> None:
    """Call `function`, and raise KeyboardInterrupt at the n-th line that is executed, if there are so many."""
    with no_collection(), CtrlC(line):
        function()


def interrupted_at_call(number: int, function: Callable[[], object]) -> str:
    """Call `function`, and raise KeyboardInterrupt at the n-th call from there, from 0 on, if there are so many.

    That is where a Python function begins, or a C function has returned. Returns where that was; "" when there are
    fewer, or it was raised where Python ignores it.
    """
    left, place = number, ""

    def profile(frame: FrameType, event: str, called: Any) -> None:
        nonlocal left, place
        if event not in ("call", "c_return") or frame.f_code.co_filename.endswith(NOT_OURS):
            return
        if event == "c_return" and called.__name__ == "__enter__":
            return
        left -= 1
        if left < 0:
            sys.setprofile(None)
            after = f" after {called.__name__}" if event == "c_return" else ""
            place = f"{frame.f_code.co_qualname}:{frame.f_lineno}{after}"
            raise KeyboardInterrupt(place)

    before = sys.getprofile()
    with no_collection():
        sys.setprofile(profile)
        try:
            function()
        except KeyboardInterrupt:
            return place
        finally:
            sys.setprofile(before)
    return place


class StartedThreads:
    """Follows the threads that are started by `_thread.start_new_thread` within a ``with`` block.

    ``_thread._count()`` counts a thread only when it has begun to run, and that may be after the call has returned.
    """

    def __enter__(self) -> Self:
        self._start = _thread.start_new_thread
        self._before = threading.active_count()
        self._asked = 0
        self._ended = list[None]()
        _thread.start_new_thread = self._counted  # type: ignore[assignment]
        return self

    def __exit__(self, *exception: object) -> None:
        _thread.start_new_thread = self._start

    def _counted(self, function: Callable[..., object], arguments: tuple[Any, ...]) -> int:
        def run() -> None:
            try:
                function(*arguments)
            finally:
                self._ended.append(None)

        # No call lies between these two, so Ctrl-C never comes there.
        self._asked += 1
        return self._start(run, ())

    def all_ended(self, place: str) -> None:
        """Wait until none of them runs, and no other thread that was not there before.

        Args:
            place: Where Ctrl-C came, for the message.
        """
        deadline = time.monotonic() + PATIENCE_S
        while len(self._ended) < self._asked or threading.active_count() > self._before:
            assert time.monotonic() < deadline, (place, threading.enumerate())
            time.sleep(0.0005)


def at_every_call(tried: Callable[[int, StartedThreads], str], stride: int = 1) -> int:
    """Try something with Ctrl-C at every so many-th call of it; behind each, the threads of it end.

    Args:
        tried: Is told at which call, and returns where that was, or "" when there are fewer.
        stride: One of so many calls.

    Returns:
        At how many calls it was.
    """
    number, count = stride // 2, 0
    with StartedThreads() as started:
        while place := tried(number, started):
            started.all_ended(place)
            number, count = number + stride, count + 1
        started.all_ended("without Ctrl-C")
    return count
