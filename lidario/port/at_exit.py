"""What is done when the program ends, also where `multiprocessing` is used.

A process that it has started ends by `os._exit`, unless it was spawned: nothing that `atexit` knows is called
there, and no finalizer of `weakref` (before Python 3.14). The program that has started it waits for it at its end,
before it comes to what `atexit` was told earlier. But `multiprocessing` has a list of its own, of what is done
before that.
"""

from __future__ import annotations

import atexit
import sys
import weakref
from collections.abc import Callable
from typing import ParamSpec, TypeVar

P = ParamSpec("P")
T = TypeVar("T")


def finalize(owner: T, leave: Callable[P, object], *args: P.args, **kwargs: P.kwargs) -> weakref.finalize[P, T]:
    """Have `leave` called once, when `owner` is garbage or the program ends; as `weakref.finalize`."""
    finalizer = weakref.finalize(owner, leave, *args, **kwargs)
    _listed(owner, finalizer)
    return finalizer


def call_at_exit(leave: Callable[[], object]) -> Callable[[], None]:
    """Have `leave` called when the program ends, before what was asked for earlier; returns what forgets it."""
    atexit.register(leave)
    forget = _listed(None, leave)

    def forget_both() -> None:
        atexit.unregister(leave)
        forget()

    return forget_both


def _listed(owner: object, leave: Callable[[], object]) -> Callable[[], None]:
    """Have `multiprocessing` call `leave` at the end, or when `owner` is garbage; returns what forgets it."""
    # Who uses it has loaded it; others need not.
    if "multiprocessing.process" not in sys.modules:
        return lambda: None
    from multiprocessing.util import Finalize

    # Those of priority 0 are called before it waits for processes of its own; the last one first.
    entry = Finalize(owner, leave, exitpriority=0)
    return lambda: entry.cancel()
