"""Ways to block a program: asleep, computing in Python, and in C code that keeps the interpreter lock."""

from __future__ import annotations

import ctypes
import time
from collections.abc import Callable


def _sleep(seconds: float) -> None:
    time.sleep(seconds)


def _compute(seconds: float) -> None:
    until = time.perf_counter() + seconds
    while time.perf_counter() < until:
        sum(range(200))


def _keep_lock(seconds: float) -> None:
    """As an extension module that does not release the lock: `ctypes.PyDLL` keeps it while the function runs."""
    ctypes.PyDLL(None).usleep(round(seconds * 1e6))


KINDS: dict[str, Callable[[float], None]] = {"asleep": _sleep, "Python": _compute, "C with the lock": _keep_lock}
"""What the program does instead of reading."""


class Blocks:
    """When to block, in a program that has been reading for a while.

    Args:
        kind: Which of `KINDS`.
        block_s: How long each time.
        count: How often.
        pause_s: Time between two blocks, and before the first.
    """

    def __init__(self, kind: str, block_s: float, count: int, pause_s: float) -> None:
        self._block = KINDS[kind]
        self._block_s = block_s
        self._left = count
        self._pause_s = pause_s
        self._due = time.monotonic() + pause_s

    def block_if_due(self) -> bool:
        """Block if it is time to; False when all blocks and the pause after them are over."""
        if time.monotonic() >= self._due:
            if not self._left:
                return False
            self._left -= 1
            self._block(self._block_s)
            self._due = time.monotonic() + self._pause_s
        return True
