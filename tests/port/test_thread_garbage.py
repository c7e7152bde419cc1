"""Garbage is collected at any moment in any thread; a session that nobody closed takes its port away then."""

import threading
import time
from functools import partial

import pytest

from lidario.port.inbox import Inbox
from lidario.port.thread import ReadingThread, Watched
from tests.port.test_thread import threads
from tests.support.ports import PATIENCE_S


def watched() -> Watched:
    return Watched(Inbox(-1, time.monotonic_ns, lambda _: b"x"), 0.005, lambda _: None)


@pytest.mark.parametrize("moment", ["before it starts", "in it"])
def test_garbage_may_be_collected_in_a_thread_that_starts(moment: str, monkeypatch: pytest.MonkeyPatch) -> None:
    reading, garbage, kept = ReadingThread(), watched(), watched()
    # Left there by an `add` that Ctrl-C has ended before it started the thread.
    reading.ports.append(garbage)

    class Collecting(threading.Thread):
        """Collects garbage where it starts, or is started."""

        def start(self) -> None:
            if moment == "before it starts":
                reading.remove(garbage)
            super().start()

        def run(self) -> None:
            if moment == "in it":
                reading.remove(garbage)
            super().run()

    adding = threading.Thread(target=partial(reading.add, kept), daemon=True)
    with monkeypatch.context() as patch:
        patch.setattr(threading, "Thread", Collecting)
        adding.start()
        adding.join(PATIENCE_S)
    assert not adding.is_alive()
    assert reading.ports == [kept]
    assert threads()
    reading.remove(kept)
    assert not threads()
