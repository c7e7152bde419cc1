"""Plays a script of a family: what it yields is asked, and it goes on with what was responded."""

from collections.abc import Awaitable, Callable
from typing import TypeVar

from lidario.errors import ResponseTimeout
from lidario.families.base import Script
from lidario.wire.envelope import Request

T = TypeVar("T")


async def play(script: Script[T], ask: Callable[[Request], Awaitable[bytes]], first: Request | None = None) -> T:
    """Play `script` to its end: each request that it yields is asked, and the payload is sent back into it.

    `first` is its first request, where it was advanced to that one already. A ResponseTimeout of `ask` is raised in
    the script.

    Returns:
        The result of the script.

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
