"""Playing a script of a family: each request that it yields is asked, and the payload is sent back into it."""

from __future__ import annotations

from collections.abc import Awaitable, Callable
from typing import TypeVar

from lidario.errors import ResponseTimeout
from lidario.families.base import Script
from lidario.wire.envelope import Request

__all__ = ["play"]

T = TypeVar("T")


async def play(script: Script[T], ask: Callable[[Request], Awaitable[bytes]], first: Request | None = None) -> T:
    """Play `script` to its end, and return its result.

    Cancelling closes the script.

    Args:
        script: A script of a family.
        ask: Sends a request and returns the payload of its response. Its ResponseTimeout is raised in the script.
        first: Its first request, where it was advanced to that one already.

    Raises:
        Whatever the script raises, and what `ask` raises unless the script catches it.
    """
    try:
        request = next(script) if first is None else first
        while True:
            try:
                payload = await ask(request)
            except ResponseTimeout as timeout:
                request = script.throw(timeout)
            else:
                request = script.send(payload)
    except StopIteration as stop:
        result: T = stop.value
        return result
    finally:
        script.close()
