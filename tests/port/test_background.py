"""A call in a thread, whose result nobody may lose."""

import asyncio
import threading
from contextlib import suppress

import pytest

from lidario.port.background import run_in_thread


@pytest.mark.parametrize("first", ["cancelled", "ended", "closed"])
def test_a_result_that_comes_too_late_is_discarded_though_the_loop_runs_no_more(first: str) -> None:
    called, ends, discarded = threading.Event(), threading.Event(), list[str]()
    done = threading.Event()

    def call() -> str:
        called.set()
        assert ends.wait(30)
        return "open"

    def discard(result: str) -> None:
        discarded.append(result)
        done.set()

    async def main() -> None:
        running = asyncio.create_task(run_in_thread(call, discard))
        await asyncio.sleep(0)
        assert called.wait(30)
        if first == "ended":
            ends.set()
            for thread in threading.enumerate():
                if thread.name == "lidario: blocking call":
                    thread.join(30)
        running.cancel()
        with suppress(asyncio.CancelledError):
            await running

    loop = asyncio.new_event_loop()
    loop.run_until_complete(main())
    if first == "closed":
        loop.close()
    ends.set()
    # The thread ends while the loop stands still, or behind its end.
    assert done.wait(30)
    loop.close()
    assert discarded == ["open"]
