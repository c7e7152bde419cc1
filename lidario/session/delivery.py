"""Packets on their way from the line to the stream that runs.

Between the descriptor of a stream and the moment at which its reader is named lies a step of the event loop.
Packets that come meanwhile are kept, so that a stream does not lose its first revolution.
"""

from __future__ import annotations

from collections.abc import Callable

from lidario.wire.events import Packets
from lidario.wire.stats import LinkStats

__all__ = ["Delivery"]

_EARLY_LIMIT = 64
"""Runs of packets kept until their reader is named."""


class Delivery:
    """Hands packets on.

    Args:
        stats: Where packets that nobody has read are counted.
    """

    def __init__(self, stats: LinkStats) -> None:
        self._stats = stats
        self._on_packets: Callable[[Packets], None] | None = None
        self._early: list[Packets] = []

    def deliver_to(self, callback: Callable[[Packets], None] | None) -> None:
        """Call `callback` with each run of packets, those that were kept first; None for nobody."""
        self._on_packets = callback
        early, self._early = self._early, []
        if callback is not None:
            for packets in early:
                callback(packets)
                self._stats.unread_packets -= packets.count

    def deliver(self, packets: Packets, *, streaming: bool) -> None:
        """Hand packets on, or keep them while nobody reads a stream that runs."""
        self._stats.unread_packets += packets.count
        if self._on_packets is not None:
            self._on_packets(packets)
            self._stats.unread_packets -= packets.count
        elif streaming and len(self._early) < _EARLY_LIMIT:
            self._early.append(packets)
