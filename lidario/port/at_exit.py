"""What is done when the program ends, also in a process that `multiprocessing` has started.

Such a process ends by `os._exit`, unless it was spawned: nothing that `atexit` knows is called there, and no
finalizer of `weakref` (before Python 3.14). But it has a list of its own.
"""

from __future__ import annotations

import atexit
import sys
import weakref
from collections.abc import Callable
from typing import Any, ParamSpec, TypeVar

P = ParamSpec("P")
T = TypeVar("T")


def finalize(owner: T, leave: Callable[P, object], *args: P.args, **kwargs: P.kwargs) -> weakref.finalize[P, T]:
    """Have `leave` called once, when `owner` is garbage or the program ends; as `weakref.finalize`."""
    finalizer = weakref.finalize(owner, leave, *args, **kwargs)
    _in_child(owner, finalizer)
    return finalizer


def call_at_exit(leave: Callable[[], object]) -> Callable[[], None]:
    """Have `leave` called when the program ends, before what was asked for earlier; returns what forgets it."""
    atexit.register(leave)
    forget = _in_child(None, leave)

    def forget_both() -> None:
        atexit.unregister(leave)
        forget()

    return forget_both


def _in_child(owner: object, leave: Callable[[], object]) -> Callable[[], None]:
    """Have a process that `multiprocessing` has started call `leave` at its end, or when `owner` is garbage."""
    # Such a process has loaded it; others need not.
    process: Any = sys.modules.get("multiprocessing.process")
    if process is None or process.parent_process() is None:
        return lambda: None
    from multiprocessing.util import Finalize

    # Those of priority 0 are called before it waits for processes of its own; the last one first.
    listed = Finalize(owner, leave, exitpriority=0)
    return lambda: listed.cancel()
