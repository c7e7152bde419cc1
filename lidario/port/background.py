"""Calls that block, kept off the event loop.

Each runs in a thread of its own, which ends with the call. The loop's executor is not used: its threads stay until
the loop is closed, and a call that hangs in a driver would keep the program from ending.
"""

import asyncio
import threading
from collections.abc import Callable, Coroutine
from typing import Any, TypeVar

from lidario.basics.system import NO_THREADS
from lidario.errors import ConnectFailed, LocalProtocolError
from lidario.port.latch import start_apart

T = TypeVar("T")


def running_loop() -> asyncio.AbstractEventLoop:
    """The event loop that runs here.

    Raises:
        LocalProtocolError: None does: it was called outside of a coroutine, or under trio.
    """
    try:
        return asyncio.get_running_loop()
    except RuntimeError:
        raise LocalProtocolError(
            "lidario needs an asyncio event loop: under trio, run it by anyio.run(main, backend='asyncio')"
        ) from None


def begin_task(loop: asyncio.AbstractEventLoop, coroutine: Coroutine[Any, Any, T], name: str) -> asyncio.Task[T]:
    """Have `loop` run a coroutine as a task, from its next turn on.

    A program may give its loop a factory that runs each new task at once, up to its first pause
    (`asyncio.eager_task_factory`). That would be too early here: the code that begins the task has not ended its
    own step. So the factory is not used.
    """
    return asyncio.Task(coroutine, loop=loop, name=name)


def start_thread(work: Callable[[], None], name: str) -> threading.Thread:
    """Start a daemon thread, and return it when it has begun.

    Where Ctrl-C ends the waiting, the thread does its work all the same, or was never started. So `work` must find
    out itself whether anybody still needs it.

    Raises:
        RuntimeError: The system allows no more threads, or no memory is left for one.
    """
    thread = threading.Thread(target=work, name=name, daemon=True)
    failures: list[Exception] = []
    start_apart(thread.start, failures.append)
    if failures:
        raise RuntimeError(*failures[0].args) from failures[0]
    return thread


async def run_in_thread(call: Callable[[], T], discard: Callable[[T], None] | None = None) -> T:
    """Run `call` in a thread and return its result, or raise what it raises.

    Cancelling ends the waiting, not the call, and so does Ctrl-C. Its result is then passed to `discard`, perhaps
    in the thread, so that it does not stay open.

    Raises:
        ConnectFailed: The system allows no more threads.
    """
    loop = running_loop()
    over = loop.create_future()
    # Who takes the result out of here keeps or discards it: the loop, which may stop at any moment, or the thread.
    held: list[T] = []
    failures: list[Exception] = []
    given_up = False

    def throw_away() -> None:
        try:
            result = held.pop()
        except IndexError:
            return
        if discard is not None:
            discard(result)

    def wake() -> None:
        if not over.done():
            over.set_result(None)

    def work() -> None:
        try:
            held.append(call())
        except Exception as error:
            failures.append(error)
        if not _tell(loop, wake) or given_up:
            throw_away()

    try:
        try:
            start_thread(work, "lidario: blocking call")
        except RuntimeError as error:
            raise ConnectFailed(NO_THREADS, reason="missing") from error
        await over
        if failures:
            raise failures.pop()
        return held.pop()
    except BaseException:
        given_up = True
        throw_away()
        raise


def _tell(loop: asyncio.AbstractEventLoop, callback: Callable[[], None]) -> bool:
    """Have the loop call `callback`; False when the loop was closed."""
    try:
        loop.call_soon_threadsafe(callback)
    except RuntimeError:
        return False
    return True
