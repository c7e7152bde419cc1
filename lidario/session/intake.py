"""What the port receives becomes responses and packets, a bounded time of it in each turn of the event loop.

Whatever comes at once, and however much work its bytes are meant to make, the rest of the program runs in between
(`lidario.port.turns`). What waits is bounded in bytes; what is beyond that is dropped and counted.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator, Sequence
from typing import Final

from lidario.port.port import Port
from lidario.port.turns import DELIVERY_BYTES, MOST_WAITING, Turns
from lidario.revolution.together import SLICE, join_runs, slices
from lidario.session.delivery import TakePackets
from lidario.session.device_line import DeviceLine
from lidario.wire.events import Packets, Response

__all__ = ["IDLE_SLICE", "Intake"]

IDLE_SLICE: Final = 8192
"""Bytes that are parsed in one step while nothing waits: a revolution of most devices."""


class Intake(DeviceLine, ABC):
    """A line to a device, with what becomes of its bytes; the base of `Dialogue`."""

    def __init__(self, port: Port) -> None:
        super().__init__(port)
        self._overflow, self._full_reads = port.overflow_bytes, port.full_reads
        self._turns = Turns(port.now, self.mistaken)

    def deliver_to(self, callback: TakePackets | None) -> None:
        """Have `callback` take all packets, those that came since the descriptor first; None for nobody."""
        if self._delivery.deliver_to(callback):
            self._turns.add(self._delivery.early())

    def data_received(self, data: bytes, now: int, arrivals: Sequence[tuple[int, int]] = ()) -> None:
        """As `Receiver`."""
        overflow = self._port.overflow_bytes
        if overflow != self._overflow:
            # They came before `data`: the port keeps what comes first.
            self._link.discard_data(overflow - self._overflow)
            self._overflow = overflow
        if (full := self._port.full_reads) != self._full_reads:
            self._link.stats.late_reads += full - self._full_reads
            self._full_reads = full
        size, idle = len(data) + DELIVERY_BYTES, self._turns.is_idle
        if not idle and self._turns.size + size > MOST_WAITING:
            self._link.discard_data(len(data), shown=True)
            return
        try:
            if idle and len(data) <= IDLE_SLICE:
                # Live it is mostly so: a revolution, or less, and nothing before it.
                runs = self._parse(data, now, arrivals)
                if len(runs) == 1:
                    self._turns.add(self._delivery.deliver(runs[0], streaming=self.is_streaming))
                elif runs:
                    self._turns.add(self._hand_on(runs))
                self.taken()
            else:
                self._turns.add(self._receive(data, now, arrivals, IDLE_SLICE if idle else SLICE), size)
        except Exception as error:
            self.mistaken(error)

    def _parse(self, data: bytes | memoryview, now: int, arrivals: Sequence[tuple[int, int]]) -> list[Packets]:
        """The packets that these bytes complete; responses are told at once."""
        self._link.receive_data(data, now, arrivals)
        runs: list[Packets] = []
        for event in self._link.events_received():
            if isinstance(event, Packets):
                runs.append(event)
            else:
                # Of a stream, the script is told what its descriptor announces.
                self.responded(event.payload if isinstance(event, Response) else bytes((event.type,)))
        return runs

    def _receive(self, data: bytes, now: int, arrivals: Sequence[tuple[int, int]], most: int) -> Iterator[None]:
        """Parse, so many bytes at a time, and hand on what was found, in steps."""
        runs: list[Packets] = []
        for piece in slices(data, now, arrivals, most):
            runs += self._parse(*piece)
            yield
        yield from self._hand_on(runs)
        self.taken()

    def _hand_on(self, runs: list[Packets]) -> Iterator[None]:
        for packets in join_runs(runs) if len(runs) > 1 else runs:
            if isinstance(packets, Packets):
                yield from self._delivery.deliver(packets, streaming=self.is_streaming)

    @abstractmethod
    def responded(self, payload: bytes) -> None:
        """The device has responded."""

    @abstractmethod
    def taken(self) -> None:
        """Something that was received has been taken."""

    @abstractmethod
    def mistaken(self, error: Exception) -> None:
        """Something failed at what was received, which is a mistake of ours."""
