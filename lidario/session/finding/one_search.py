"""One search for lidars at a time on this machine, in whatever program.

A search asks at every port, and while it does, each of them is busy for others. Two that run at the same time, as
where the programs of two lidars begin with the machine, would each find some ports busy and miss what is there.
"""

from __future__ import annotations

import asyncio
import errno
import logging
import socket
import sys
import threading
from collections.abc import Callable
from contextlib import ExitStack

_log = logging.getLogger("lidario")

NAME = "\0lidario: a search for lidars"
"""An abstract socket: it is no file, and the system lets go of it when its program dies."""
POLL_S = 0.02
LONGEST_S = 20.0
"""After that the other search hangs, as where its program was stopped by Ctrl-Z. Asking takes 4 s, asking with
patience 8 s, opening what was found 4 s."""
_here = threading.Lock()


async def only_search() -> ExitStack:
    """Wait until no other search runs; none begins until the result is closed. Cancelling ends the waiting."""
    loop = asyncio.get_running_loop()
    began = loop.time()
    release = _begin()
    if release is None:
        _log.info("another search for lidars runs on this machine: waiting for its end")
    while release is None and loop.time() < began + LONGEST_S:
        await asyncio.sleep(POLL_S)
        release = _begin()
    ends = ExitStack()
    if release is not None:
        ends.callback(release)
    return ends


def _begin() -> Callable[[], None] | None:
    """Begin a search; returns what ends it, or None while another one runs."""
    if sys.platform != "linux":
        # Only those of this program are known.
        return _here.release if _here.acquire(blocking=False) else None
    try:
        name = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
    except OSError:  # a sandbox without such sockets: others are not known
        return lambda: None
    try:
        name.bind(NAME)
    except OSError as error:
        name.close()
        return None if error.errno == errno.EADDRINUSE else lambda: None
    return name.close
