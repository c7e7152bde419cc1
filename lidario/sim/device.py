"""What every simulated device offers: bytes in, bytes out, and time as an argument.

It never reads a clock and never sleeps. So the same device runs in memory, thousands of times faster than real
time, and on a pseudo-terminal or over TCP in real time.
"""

from dataclasses import dataclass
from typing import Protocol


@dataclass(frozen=True, slots=True)
class Received:
    """One request as the device saw it.

    Attributes:
        at_ns: When its last byte arrived, in the server's monotonic nanoseconds.
        name: The documents' name of the request, lower case (``"stop"``, ``"get_info"``), or ``"unknown"``.
        data: The request's bytes.
        obeyed: False when the device discarded it, as the real one would.
        why: Why it was discarded (``"within 10 ms of stop"``); empty when it was obeyed.
        remark: What a host should not have done, although no document says that the device discards such a request;
            mostly empty.
    """

    at_ns: int
    name: str
    data: bytes
    obeyed: bool
    why: str = ""
    remark: str = ""


class SimulatedDevice(Protocol):
    """The device side of a serial line, sans-IO; all times are monotonic nanoseconds and never go back.

    A device for which the control line DTR means something also has ``set_dtr(asserted, now)``; one that notices at
    which speed the host's port runs has ``set_host_baudrate(baudrate, now)``; one whose cable may be out has
    ``unplugged(now)``, which tells whether it is, and ``on_cable(callback)`` where that changes by itself: the
    callback is to be called then. One that has no serial line but is reached by UDP says so by an
    attribute ``is_network``.
    """

    @property
    def baudrate(self) -> int:
        """Speed of the line in bits a second, 8N1; bounds how fast `transmit` hands out bytes."""
        ...

    @property
    def log(self) -> list[Received]:
        """Every request so far, oldest first, the discarded ones included (bounded: the oldest go)."""
        ...

    @property
    def scanning(self) -> bool:
        """Whether a measurement stream runs (or will start once the motor is up to speed)."""
        ...

    @property
    def motor_on(self) -> bool:
        """Whether the motor is powered."""
        ...

    def receive(self, data: bytes, now: int) -> None:
        """Take bytes that the host sent and that arrived at `now`."""
        ...

    def transmit(self, now: int) -> bytes:
        """Hand out the bytes whose last bit has left the device by `now`, and forget them."""
        ...

    def wakeup(self, now: int) -> int | None:
        """When `transmit` will next have something to hand out; None while the device is idle."""
        ...
