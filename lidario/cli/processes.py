"""Processes that work for a verb, and end with it. Only who needs some imports this: it takes long."""

from __future__ import annotations

import os
import threading
from collections.abc import Iterator
from concurrent.futures import Executor, ProcessPoolExecutor
from contextlib import contextmanager, suppress
from multiprocessing import get_context
from multiprocessing.connection import Connection


@contextmanager
def processes(count: int) -> Iterator[Executor]:
    """So many processes, which end when this one is killed.

    Where the block raises, as by Ctrl-C, they end in the midst of what they do.
    """
    # Not forked: a process that has threads, or a terminal in use, must not be copied.
    context = get_context("spawn")
    theirs, ours = context.Pipe(duplex=False)
    with theirs, ours, ProcessPoolExecutor(count, context, _end_with_parent, (theirs,)) as pool:
        try:
            yield pool
        except BaseException:
            ours.close()
            raise


def _end_with_parent(lifeline: Connection) -> None:
    def wait() -> None:
        # The other end is closed, by the parent or with it.
        with suppress(EOFError, OSError):
            lifeline.recv_bytes()
        os._exit(1)

    threading.Thread(target=wait, daemon=True).start()
