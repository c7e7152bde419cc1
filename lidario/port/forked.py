"""What a forked child lets go of at once, since it is its parent's.

A line is free for the next program, and its other end learns that it was closed, when the last descriptor of it is
closed. A child that only computes has a copy of each, and would hold the line for as long as it computes.
"""

import os
from contextlib import suppress
from typing import Final, Protocol
from weakref import WeakSet

FORKED: Final = "the lidar was opened before a fork: only the parent process can use it"


class Inherited(Protocol):
    """Something that has descriptors."""

    def forked(self) -> None:
        """In a forked child: close its descriptors, or leave nothing behind them. Never raises."""
        ...


def let_go_in_children(held: Inherited) -> None:
    """Have it called in each child that is forked from now on, as long as it exists."""
    _held.add(held)


def leave_nothing(handle: int) -> None:
    """Let a descriptor lead to nothing. Its number stays taken: who closes it later closes no other file."""
    with suppress(OSError):
        nothing = os.open(os.devnull, os.O_RDWR)
        os.dup2(nothing, handle, inheritable=False)
        os.close(nothing)


_held: WeakSet[Inherited] = WeakSet()


def _let_go() -> None:
    for held in list(_held):
        held.forked()


with suppress(AttributeError):  # not on Windows
    os.register_at_fork(after_in_child=_let_go)
