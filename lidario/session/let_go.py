"""A session that nobody holds any more, or whose program ends: what is done without the `Lidar`.

These functions hold no reference to it, so that it can be collected while its tasks and timers go on.
"""

from __future__ import annotations

import asyncio
import weakref
from collections.abc import Callable

from lidario.model import Health
from lidario.session.connection import Connection
from lidario.session.dialogue import Dialogue
from lidario.session.reconnect import Reconnector
from lidario.session.scanner import Scanner

__all__ = ["abandon", "if_alive", "running_loop"]


def running_loop() -> asyncio.AbstractEventLoop | None:
    """The loop that runs here, if one does."""
    try:
        return asyncio.get_running_loop()
    except RuntimeError:
        return None


def if_alive(adopt: Callable[[Connection, Health], None]) -> Callable[[Connection, Health], bool]:
    """As `adopt`, a method, but without keeping its object alive; False when that is gone."""
    method = weakref.WeakMethod(adopt)

    def call(connection: Connection, health: Health) -> bool:
        alive = method()
        if alive is not None:
            alive(connection, health)
        return alive is not None

    return call


def abandon(dialogue: Dialogue, scanner: Scanner, reconnector: Reconnector | None) -> None:
    """The session was never closed and nobody holds it any more, or the program ends: leave the device still."""
    scanner.abandon()
    dialogue.abandon()
    if reconnector is not None:
        reconnector.abandon()
