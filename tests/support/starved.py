"""Whether the machine let this process run: what a test sees at true pace means something only then."""

from __future__ import annotations

import threading
import time
from collections.abc import Awaitable, Callable
from functools import wraps
from typing import ParamSpec

P = ParamSpec("P")
TICK_S = 0.005
STARVED_S = 0.1
"""A thread that sleeps 5 ms and comes back this late did not get a core: nor did, perhaps, what is tested."""
TRIES = 12


class Watch:
    """Measures how long another thread of this process waits for a core, and for the interpreter lock.

    Attributes:
        worst_s: The longest time.
    """

    def __init__(self) -> None:
        self.worst_s = 0.0
        self._ending = threading.Event()
        self._thread = threading.Thread(target=self._run, name="watch", daemon=True)

    def __enter__(self) -> Watch:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._ending.set()
        self._thread.join()

    def _run(self) -> None:
        before = time.monotonic()
        while not self._ending.is_set():
            time.sleep(TICK_S)
            now = time.monotonic()
            self.worst_s, before = max(self.worst_s, now - before - TICK_S), now


def unless_starved(test: Callable[P, Awaitable[None]]) -> Callable[P, Awaitable[None]]:
    """Try a test again that failed while the machine did not let this process run; at most `TRIES` times."""

    @wraps(test)
    async def tried(*args: P.args, **kwargs: P.kwargs) -> None:
        for attempt in range(TRIES):
            with Watch() as watch:
                try:
                    await test(*args, **kwargs)
                except AssertionError:
                    if watch.worst_s < STARVED_S or attempt == TRIES - 1:
                        raise
                else:
                    return

    return tried
