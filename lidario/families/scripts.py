"""Pieces of scripts that several families use: to ask a device, to hear its packets, or to return what is known.

Responses carry no check value, and one flipped bit may show another device. So a question whose answer decides how
a device is read, or what is done to it, is repeated until two responses are equal (`agreed`).

A device that only talks streams for as long as it has power, and hears nothing. Model and health are read from its
packets: a few packets whose check values hold are its response (`hear`). STOP and START have no bytes: only the
host begins and ends to listen. The motor turns until the power is cut. The session says so once and does not treat
it as an error.
"""

import struct
from collections.abc import Callable
from typing import Final

from lidario.basics.arguments import finite
from lidario.basics.model import Health, HealthStatus
from lidario.errors import InvalidValue, RemoteProtocolError, ResponseTimeout
from lidario.families.base import Script, T
from lidario.wire.envelope import Expected, Request
from lidario.wire.formats import StreamFormat

STATUSES: Final = (HealthStatus.OK, HealthStatus.WARNING, HealthStatus.ERROR)
"""Health by its number, the same in every family so far."""
HEAR_S: Final = 0.5  # longest wait for the packets that identify a device
MOST_DIFFERENT: Final = 5  # after this many responses, all different, no more are asked for
LINKED: Final = 2  # this many packets in a row prove that a device that only talks streams at this speed
RUNS: Final = 12  # how many runs of `LINKED` packets are heard if damage lets no longer ones through
NOT_STOPPED: Final = Request("STOP", b"", ends_stream=True)
"""Sends nothing to the device. The host only stops listening."""


def told(value: T) -> Script[T]:
    """A script that asks nothing: the value is known."""
    yield from ()
    return value


def frequency_within(hertz: object, limits: tuple[float, float], whose: str) -> float:
    """The scan frequency in Hz; InvalidValue if it is not within the `limits` of the model `whose`."""
    lowest, highest = limits
    wanted = finite(hertz, "a scan frequency")
    if not lowest <= wanted <= highest:
        raise InvalidValue(f"{wanted:g} Hz is outside of the {whose}'s {lowest:g} to {highest:g} Hz")
    return wanted


def agreed(request: Request, *told: bytes) -> Script[bytes]:
    """Ask until two responses are equal, those `told` before included. After a first response, one may be missing.

    Raises:
        RemoteProtocolError: Five responses were all different.
        ResponseTimeout: The first response did not come, or two later ones did not.
    """
    seen, missed, left = set[bytes](), False, list(told)
    while len(seen) < MOST_DIFFERENT:
        try:
            payload = left.pop(0) if left else (yield request)
        except ResponseTimeout:
            if missed or not seen:
                raise
            missed = True
            continue
        if payload in seen:
            return payload
        seen.add(payload)
    raise RemoteProtocolError(
        f"{MOST_DIFFERENT} responses to {request.name} were all different: the line damages what it carries"
    )


def health_of(request: Request, told: bytes) -> Script[Health]:
    """Status and code, by the response that came to `request`.

    An error makes the session reset the device, so it is believed only if it came twice. A status that no document
    defines counts as a warning, since only one number is known to mean an error.
    """
    status, code = struct.unpack("<BH", (yield from agreed(request, told)) if any(told) else told)
    if status < len(STATUSES):
        return Health(STATUSES[status], code)
    return Health(HealthStatus.WARNING, code, f"it reports health status {status}, which is not defined")


def hear(
    wire: StreamFormat, packets: int = LINKED, timeout: float = HEAR_S, wake: bytes = b"", attempts: int = 1
) -> Request:
    """A request that waits for so many packets; their bytes, without noise between them, are the response.

    `wake` are bytes that start a device that was stopped, and change nothing in one that runs.
    """
    expected = Expected(wire.response_type, packets * wire.shortest)
    name = "START" if wake else "LISTEN"
    return Request(name, wake, expected, timeout, attempts=attempts, stream=wire, packets=packets)


def hear_runs(
    wire: Callable[[], StreamFormat],  # each request needs an object of its own
    packets: int,
    timeout: float,
    wake: bytes = b"",
    linked: int = LINKED,
    attempts: int = 1,
) -> Script[tuple[bytes, ...]]:
    """Hear so many packets, or `RUNS` times a few if the line damages so much that these do not come.

    A few are `linked` packets. They are waited for first, with `attempts` of `timeout` seconds each; if they do not
    come, ResponseTimeout is raised. Returns the bytes that were heard each time.
    """
    yield hear(wire(), linked, timeout, wake, attempts)
    try:
        return ((yield hear(wire(), packets)),)
    except ResponseTimeout:
        runs: list[bytes] = []
        for _ in range(RUNS):
            runs.append((yield hear(wire(), linked)))
        return tuple(runs)


def begin(wire: StreamFormat, data: bytes = b"") -> Request:
    """The request from which on all bytes are packets of a stream; `data` are its bytes, if it needs any."""
    return Request("START" if data else "LISTEN", data, stream=wire)
