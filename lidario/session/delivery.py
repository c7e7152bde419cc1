"""Packets on their way from the line to the stream that runs.

Between the descriptor of a stream and the moment at which its reader is named lies a step of the event loop.
Packets that come meanwhile are kept, so that a stream does not lose its first revolution.

What a reader makes of packets may take long, so it does that in steps (`lidario.port.turns`).
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable, Iterator
from itertools import chain
from typing import Final, TypeAlias

from lidario.wire.events import Packets
from lidario.wire.stats import LinkStats

__all__ = ["EARLY_BYTES", "Delivery", "TakePackets"]

EARLY_BYTES: Final = 256 * 1024
"""Most bytes of packets that are kept until their reader is named; so many come in four seconds."""
_RUN_BYTES: Final = 512
"""What a run of packets takes beside its bytes, about."""

TakePackets: TypeAlias = Callable[[Packets], Iterable[None]]
"""Takes packets, in steps."""


class Delivery:
    """Hands packets on.

    Args:
        stats: Where packets that nobody has read are counted.
    """

    def __init__(self, stats: LinkStats) -> None:
        self._stats = stats
        self._on_packets: TakePackets | None = None
        self._early: deque[Packets] = deque()
        self._early_bytes = 0

    def deliver_to(self, callback: TakePackets | None) -> bool:
        """Have `callback` take packets; None for nobody. Returns whether some were kept for it (`early`)."""
        self._on_packets = callback
        if callback is None:
            self._early.clear()
            self._early_bytes = 0
        return bool(self._early)

    def deliver(self, packets: Packets, *, streaming: bool) -> Iterable[None]:
        """Hand packets on behind those that were kept, or keep them while nobody reads a stream that runs."""
        take = self._on_packets
        if take is None:
            self._stats.unread_packets += packets.count
            if streaming and self._early_bytes < EARLY_BYTES:
                self._early.append(packets)
                self._early_bytes += len(packets.data) + _RUN_BYTES
            return ()
        return chain(self.early(), take(packets)) if self._early else take(packets)

    def early(self) -> Iterator[None]:
        """Hand on what was kept."""
        while self._early and self._on_packets is not None:
            packets = self._early.popleft()
            self._early_bytes -= len(packets.data) + _RUN_BYTES
            self._stats.unread_packets -= packets.count
            yield from self._on_packets(packets)
