"""Starting a thread in a way that Ctrl-C may end anywhere.

`threading.Thread.start` waits, by a Condition, until the thread has begun. Ctrl-C in the midst of that leaves a
lock taken, and the thread waits for it for ever; or it gives a lock back twice, and RuntimeError is raised instead
of KeyboardInterrupt. So `Thread.start` is called where Ctrl-C does not come: in a thread of its own, which the
interpreter starts in one piece.
"""

from __future__ import annotations

import _thread
import threading
from collections.abc import Callable

from lidario.latch import Latch

__all__ = ["start_thread"]


def start_thread(work: Callable[[], None], name: str) -> threading.Thread:
    """Start a daemon thread, and return it when it has begun.

    Where Ctrl-C ends the waiting, the thread does its work all the same, or was never started. So `work` must find
    out itself whether anybody still needs it.

    Args:
        work: What it does.
        name: Its name.

    Raises:
        RuntimeError: The system allows no more threads.
    """
    thread = threading.Thread(target=work, name=name, daemon=True)
    begun = Latch()
    failures: list[RuntimeError] = []

    def start() -> None:
        try:
            thread.start()
        except RuntimeError as error:
            failures.append(error)
        finally:
            begun.set()

    _thread.start_new_thread(start, ())
    begun.wait()
    if failures:
        raise failures[0]
    return thread
