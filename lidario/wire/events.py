"""What `Link` reports: four kinds of event, each plain data.

Events do not depend on how the bytes were cut into chunks, but for one freedom: a run of packets may be
reported in one `Packets` or in several that follow each other. `merged` removes that freedom, for tests and
for whoever replays a recording.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import TypeAlias

__all__ = ["Arrival", "Descriptor", "Event", "Packets", "Response", "Skipped", "merged"]

Arrival: TypeAlias = tuple[int, int]
"""How much had come, and when: a number of bytes or of packets, and the time in the caller's nanoseconds."""


@dataclass(frozen=True, slots=True)
class Descriptor:
    """The device announced a measurement stream; packets follow until it is stopped.

    Attributes:
        type: Answer type, e.g. 0x85.
        size: Length of one packet in bytes, as the device claims it.
        continuous: True for a stream, False for a single answer.
    """

    type: int
    size: int
    continuous: bool


@dataclass(frozen=True, slots=True)
class Response:
    """The single answer to the pending request.

    Attributes:
        type: Answer type, e.g. 0x04.
        payload: The bytes after the descriptor.
        received_ns: Arrival of the chunk that completed it, in the caller's nanoseconds.
    """

    type: int
    payload: bytes
    received_ns: int


@dataclass(frozen=True, slots=True)
class Packets:
    """Consecutive intact packets of the stream's format, with nothing lost between them on the wire.

    Attributes:
        data: The packets, back to back.
        count: How many there are.
        arrivals: When they came: pairs ``(packets, at_ns)``, so many of them were complete at that time; ascending,
            the last pair is for all of them. More than one pair only when they were collected from several reads.
    """

    data: bytes
    count: int
    arrivals: tuple[Arrival, ...]

    @property
    def received_ns(self) -> int:
        """Arrival of the read that completed the last of them."""
        return self.arrivals[-1][1]


@dataclass(frozen=True, slots=True)
class Skipped:
    """A stretch of the stream that belongs to no packet; reported once, when the next packet is found.

    Attributes:
        size: Length of the stretch in bytes.
    """

    size: int


Event = Descriptor | Response | Packets | Skipped


def merged(events: Iterable[Event]) -> list[Event]:
    """The same events with neighbouring `Packets` joined; the last arrival counts."""
    result: list[Event] = []
    for event in events:
        last = result[-1] if result else None
        if isinstance(event, Packets) and isinstance(last, Packets):
            count = last.count + event.count
            result[-1] = Packets(last.data + event.data, count, ((count, event.received_ns),))
        elif isinstance(event, Packets) and len(event.arrivals) > 1:
            result.append(replace(event, arrivals=event.arrivals[-1:]))
        else:
            result.append(event)
    return result
