"""Calls that block, kept off the event loop.

Each runs in a thread of its own, which ends with the call. The loop's executor is not used: its threads stay until
the loop is closed, and a call that hangs in a driver would keep the program from ending.
"""

import _thread
import asyncio
import threading
from collections.abc import Callable
from functools import partial
from typing import TypeVar

from lidario.errors import ConnectFailed, LocalProtocolError
from lidario.latch import Latch
from lidario.system import NO_THREADS

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


def start_thread(work: Callable[[], None], name: str) -> threading.Thread:
    """Start a daemon thread, and return it when it has begun.

    Where Ctrl-C ends the waiting, the thread does its work all the same, or was never started. So `work` must find
    out itself whether anybody still needs it.

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


async def run_in_thread(call: Callable[[], T], discard: Callable[[T], None] | None = None) -> T:
    """Run `call` in a thread and return its result, or raise what it raises.

    Cancelling ends the waiting, not the call, and so does Ctrl-C. Its result is then passed to `discard`, perhaps
    in the thread, so that it does not stay open.

    Raises:
        ConnectFailed: The system allows no more threads.
    """
    loop = running_loop()
    future: asyncio.Future[T] = loop.create_future()
    # Who takes the result out of here keeps or discards it: the loop, which may stop at any moment, or the thread.
    held: list[T] = []
    given_up = False

    def throw_away() -> None:
        try:
            result = held.pop()
        except IndexError:
            return
        if discard is not None:
            discard(result)

    def finish() -> None:
        if not future.done():
            future.set_result(held.pop())

    def fail(error: Exception) -> None:
        if not future.done():
            future.set_exception(error)

    def work() -> None:
        try:
            held.append(call())
        except Exception as error:
            _tell(loop, partial(fail, error))
        else:
            if not _tell(loop, finish) or given_up:
                throw_away()

    try:
        try:
            start_thread(work, "lidario: blocking call")
        except RuntimeError as error:
            raise ConnectFailed(NO_THREADS, reason="missing") from error
        return await future
    except BaseException:
        given_up = True
        # The result may be there already: it came in the same iteration of the loop as the cancellation.
        if not future.cancel() and not future.cancelled() and future.exception() is None:
            held.append(future.result())
        throw_away()
        raise


def _tell(loop: asyncio.AbstractEventLoop, callback: Callable[[], None]) -> bool:
    """Have the loop call `callback`; False when the loop was closed."""
    try:
        loop.call_soon_threadsafe(callback)
    except RuntimeError:
        return False
    return True
