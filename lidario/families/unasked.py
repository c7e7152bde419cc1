"""What is asked of devices that only talk: they stream for as long as they have power, and hear nothing.

Nothing can be asked of such a device, so what it is, and whether it is well, is read from its packets: some of them
in a row, whose check values hold, are its response. STOP and START have no bytes: only the host begins and ends to
listen. The motor turns until the power is cut, which the session says once and treats as no error.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

from lidario.errors import ResponseTimeout
from lidario.families.base import Script
from lidario.wire.envelope import Expected, Request
from lidario.wire.formats import StreamFormat

LINKED = 2
"""Packets in a row that prove that a device of this kind streams at this speed."""
RUNS: Final = 12
"""How many runs of `LINKED` packets are heard where damage lets no longer ones through."""
NOT_STOPPED = Request("STOP", b"", ends_stream=True)
"""Sends nothing to the device. The host only stops listening."""


def hear(
    wire: StreamFormat, packets: int = LINKED, timeout: float = 0.5, wake: bytes = b"", attempts: int = 1
) -> Request:
    """Wait for so many packets in a row; their bytes are the response.

    `wake` starts a device that was stopped, and changes nothing about one that runs.
    """
    expected = Expected(wire.response_type, packets * wire.shortest)
    name = "START" if wake else "LISTEN"
    return Request(name, wake, expected, timeout, attempts=attempts, stream=wire, packets=packets)


def hear_runs(
    wire: Callable[[], StreamFormat],
    packets: int,
    timeout: float,
    wake: bytes = b"",
    linked: int = LINKED,
    attempts: int = 1,
) -> Script[tuple[bytes, ...]]:
    """Hear so many packets in a row, or `RUNS` short runs where the line damages so much that they do not come.

    Args:
        wire: Makes the object for the packets; each request needs one of its own.
        packets: How many packets tell what the device is.
        timeout: How long each run may take, in seconds.
        wake: As for `hear`.
        linked: Packets of a short run.
        attempts: How often the first run is waited for.

    Returns:
        The bytes of each run. No packet is missing within one.

    Raises:
        ResponseTimeout: Not even a short run came.
    """
    yield hear(wire(), linked, timeout, wake, attempts)
    try:
        return ((yield hear(wire(), packets, timeout)),)
    except ResponseTimeout:
        runs: list[bytes] = []
        for _ in range(RUNS):
            runs.append((yield hear(wire(), linked, timeout)))
        return tuple(runs)


def begin(wire: StreamFormat, data: bytes = b"") -> Request:
    """Take what comes from now on for the packets of a stream, after a request where one is needed."""
    return Request("START" if data else "LISTEN", data, stream=wire)
