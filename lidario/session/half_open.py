"""Leaves a device still that is being opened, when the program ends before anybody holds its session.

Ctrl-C is raised wherever the interpreter is, also between two statements that belong together. So a `HalfOpen` is
made before anything is written, and lives in the frames that open the device; when they are gone, its finalizer
writes the stop requests. The session lets go of it as soon as it has a finalizer of its own.
"""

from __future__ import annotations

import weakref

from lidario.session.dialogue import Dialogue

__all__ = ["HalfOpen"]


class HalfOpen:
    """The dialogue with one device that is being opened.

    Args:
        dialogue: The dialogue.
    """

    def __init__(self, dialogue: Dialogue) -> None:
        self._finalizer = weakref.finalize(self, dialogue.abandon)

    def release(self) -> None:
        """Somebody else takes care of the device from now on, or nobody has responded."""
        self._finalizer.detach()
