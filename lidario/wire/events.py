"""What `Link` reports: four kinds of event, each plain data.

Events do not depend on how the bytes were cut into chunks, but for one freedom: a run of packets may be
reported in one `Packets` or in several that follow each other. `merged` removes that freedom, for tests and
for whoever replays a recording.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace

__all__ = ["Descriptor", "Event", "Packets", "Response", "Skipped", "merged"]


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
        received_ns: Arrival of the chunk that completed the last of them.
        earlier: Where they lay uncut for a while, the arrivals before that: each the number of packets that were
            complete by then, and when.
    """

    data: bytes
    count: int
    received_ns: int
    earlier: tuple[tuple[int, int], ...] = ()


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
            result[-1] = Packets(last.data + event.data, last.count + event.count, event.received_ns)
        elif isinstance(event, Packets) and event.earlier:
            result.append(replace(event, earlier=()))
        else:
            result.append(event)
    return result
