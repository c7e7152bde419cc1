"""What a test may leave behind: no thread, no file descriptor, no asyncio task."""

import asyncio
import gc
import os
import threading
import time
from collections.abc import Awaitable, Callable, Iterator
from contextlib import contextmanager, suppress
from functools import wraps
from typing import ParamSpec, TypeVar

P = ParamSpec("P")
T = TypeVar("T")
FOLDER = "/proc/self/fd"
GRACE_S = 5.0


@contextmanager
def leaves_nothing() -> Iterator[None]:
    """Fail when threads or, on Linux, file descriptors were opened in the block and are still there behind it.

    What is on its way out has `GRACE_S` to end: threads that were told to, objects that only a cycle holds.
    """
    threads, files = set(threading.enumerate()), _files()
    yield
    deadline = time.monotonic() + GRACE_S
    while left := [*map(repr, _threads_since(threads)), *sorted(_files() - files)]:
        assert time.monotonic() < deadline, f"left behind: {', '.join(left)}"
        gc.collect()
        for thread in _threads_since(threads):
            thread.join(0.1)
        time.sleep(0.01)


def leaves_no_task(test: Callable[P, Awaitable[T]]) -> Callable[P, Awaitable[T]]:
    """Make an async test fail when other tasks of its loop still run at its end."""

    @wraps(test)
    async def watched(*args: P.args, **kwargs: P.kwargs) -> T:
        before = asyncio.all_tasks()
        result = await test(*args, **kwargs)
        left = asyncio.all_tasks() - before
        assert not left, f"left behind: {left}"
        return result

    return watched


def _threads_since(before: set[threading.Thread]) -> list[threading.Thread]:
    return [thread for thread in threading.enumerate() if thread not in before]


def _files() -> set[str]:
    """Every open file descriptor with what it refers to; empty where the system does not tell."""
    found: set[str] = set()
    with suppress(FileNotFoundError):
        for name in os.listdir(FOLDER):
            with suppress(FileNotFoundError):  # the descriptor of the listing itself
                found.add(f"{name} -> {os.readlink(f'{FOLDER}/{name}')}")
    return found
