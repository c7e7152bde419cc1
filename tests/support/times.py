"""How long something takes on the loop's clock, and tasks that are cancelled while they wait."""

import asyncio
import math
from collections.abc import Coroutine, Iterator
from contextlib import contextmanager
from typing import Any, TypeVar

from tests.support.loop import now

T = TypeVar("T")


@contextmanager
def takes(most_s: float, *, more_than_s: float = -math.inf) -> Iterator[None]:
    """Fail where what is done in the block takes longer, or not as long, on the clock of the loop."""
    began = now()
    yield
    took_s = now() - began
    assert more_than_s < took_s < most_s, f"it took {took_s:.4f} s"


async def begun(work: Coroutine[Any, Any, T], turns: int = 1) -> asyncio.Task[T]:
    """Begin this in a task of its own, and return when the loop has gone round so often."""
    task = asyncio.ensure_future(work)
    for _ in range(turns):
        await asyncio.sleep(0)
    return task


async def cancelled(work: Coroutine[Any, Any, T], after_s: float = 0.0) -> asyncio.Task[T]:
    """Begin this in a task of its own, and cancel it so many seconds later; return when it has ended."""
    task = asyncio.ensure_future(work)
    await asyncio.sleep(after_s)
    task.cancel()
    await asyncio.wait([task])
    return task
