"""What the port receives becomes responses and packets, a bounded time of it in each turn of the event loop.

Whatever comes at once, and however much work its bytes are meant to make, the rest of the program runs in between
(`lidario.port.turns`). What waits is bounded in bytes; what is beyond that is dropped and counted.

Between the descriptor of a stream and the moment at which its reader is named lies a step of the event loop.
Packets that come meanwhile are kept, so that a stream does not lose its first revolution.
"""

import time
from abc import ABC, abstractmethod
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from itertools import chain
from typing import Final, TypeAlias

from lidario.basics.model import LineErrors
from lidario.port.port import Port
from lidario.port.turns import DELIVERY_BYTES, MOST_WAITING, Turns
from lidario.recording.chronicle import Chronicle
from lidario.revolution.together import SLICE, joined, slices
from lidario.wire.events import Packets, Response
from lidario.wire.link import Link
from lidario.wire.states import LinkState
from lidario.wire.stats import LinkStats

IDLE_SLICE: Final = 8192
"""Bytes that are parsed in one step while nothing waits: a revolution of most devices."""
EARLY_BYTES: Final = 256 * 1024
"""Most bytes of packets that are kept until their reader is named; so many come in four seconds."""
_STREAMING = LinkState.STREAMING

TakePackets: TypeAlias = Callable[[Packets], Iterable[None]]
"""Takes packets, in steps."""


class Intake(ABC):
    """A line to a device, with what becomes of its bytes; the base of `Dialogue`."""

    def __init__(self, port: Port) -> None:
        self.port: Port = port  # the open port
        self.link: Link = Link()  # the parser of what it receives
        self.stats: LinkStats = self.link.stats  # its counters, also of packets that nobody has read
        self.chronicle: Chronicle = Chronicle()  # what happened so far, for recordings
        self._turns = Turns(time.monotonic_ns if port.is_real_time else port.now, self.mistaken)
        self._early: deque[Packets] = deque()
        self._errors_before = port.errors
        self._overflow, self._full_reads = port.late.overflow_bytes, port.late.full_reads
        self.deliver_to(None)

    @property
    def errors(self) -> LineErrors:
        """As `Port.errors`, without what was counted before at other speeds."""
        return self.port.errors - self._errors_before

    def data_received(self, data: bytes, now: int, arrivals: Sequence[tuple[int, int]] = ()) -> None:
        """Count what the port has lost; then the bytes are parsed, at once where nothing waits."""
        late = self.port.late
        if overflow := late.overflow_bytes - self._overflow:
            # They came before `data`: the port keeps what comes first.
            self.link.discard_data(overflow)
        self.stats.late_reads += late.full_reads - self._full_reads
        self._overflow, self._full_reads = late.overflow_bytes, late.full_reads
        size, idle = len(data) + DELIVERY_BYTES, not self._turns.waiting
        if not idle and self._turns.size + size > MOST_WAITING:
            self.link.discard_data(len(data), shown=True)
            return
        steps = self._receive(data, now, arrivals, IDLE_SLICE if idle else SLICE)
        self._turns.add(chain.from_iterable(steps), size)

    def _receive(
        self, data: bytes, now: int, arrivals: Sequence[tuple[int, int]], most: int
    ) -> Iterator[Iterable[None]]:
        """Parse, so many bytes at a time; tell responses at once, and hand on all packets together; in steps."""
        runs: list[Packets] = []
        # Live it is mostly one piece: a revolution, or less.
        whole = len(data) <= most
        for piece in ((data, now, arrivals),) if whole else slices(data, now, arrivals, most):
            self.link.receive_data(*piece)
            for event in self.link.events_received():
                if isinstance(event, Packets):
                    runs.append(event)
                else:
                    # Of a stream, the script is told what its descriptor announces.
                    self.responded(event.payload if isinstance(event, Response) else bytes((event.type,)))
            if not whole:
                yield (None,)
        self.taken()
        if runs:
            yield self.deliver(joined(runs))

    def deliver_to(self, callback: TakePackets | None) -> None:
        """Have `callback` take all packets, first those since the descriptor. With None, none are taken."""
        self._on_packets = callback
        if callback is None:
            self._early.clear()
            # Of all packets that were kept since then.
            self._early_bytes = 0
        elif self._early:
            self._turns.add(self._take_early())

    def deliver(self, packets: Packets) -> Iterable[None]:
        """Hand packets on behind those that were kept, or keep them while nobody reads a stream that runs."""
        take = self._on_packets
        if take is None:
            self.stats.unread_packets += packets.count
            if self.link.state is _STREAMING and self._early_bytes < EARLY_BYTES:
                self._early.append(packets)
                self._early_bytes += len(packets.data) + DELIVERY_BYTES
            return ()
        return chain(self._take_early(), take(packets)) if self._early else take(packets)

    def _take_early(self) -> Iterator[None]:
        while self._early and self._on_packets is not None:
            packets = self._early.popleft()
            self.stats.unread_packets -= packets.count
            yield from self._on_packets(packets)

    @abstractmethod
    def responded(self, payload: bytes) -> None:
        """The device has responded."""

    @abstractmethod
    def taken(self) -> None:
        """Something that was received has been parsed."""

    @abstractmethod
    def mistaken(self, error: Exception) -> None:
        """Something failed at what was received, which is a mistake of ours."""
