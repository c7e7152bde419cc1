"""The ledger closes: whatever a test does, every byte and every packet that came in is counted exactly once.

Bytes are checked of every `Link` that a test makes; bytes and packets of every `Lidar`, by its public `Stats`.
"""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any
from weakref import ref

import pytest

from lidario.basics.model import Stats
from lidario.families.base import Stream
from lidario.revolution.assemble import AssemblerStats
from lidario.session.finding.connection import At
from lidario.session.lidar import Lidar
from lidario.session.streaming.running import Running, Totals
from lidario.wire.link import Link

BYTES = (
    "packet_bytes", "record_bytes", "skipped_bytes", "response_bytes", "stray_bytes", "drained_bytes",
    "discarded_bytes",
)  # fmt: skip
"""Fields of `LinkStats` and `Stats` whose sum, and what is buffered, is what was received."""
PACKETS = ("scan_packets", "discarded_packets", "doubled_packets", "false_packets", "unfinished_packets")
"""Fields of `AssemblerStats` and `Stats` whose sum is all packets."""


def _sum(counters: object, names: tuple[str, ...]) -> int:
    counts = [getattr(counters, name) for name in names]
    assert min(counts) >= 0, f"a count below 0: {counters}"
    return sum(counts)


def assert_link_closes(link: Link) -> None:
    """Every byte that the link received is in exactly one of its counters, or still in its buffer."""
    accounted = _sum(link.stats, BYTES) + link.buffered
    assert link.stats.bytes_received == accounted, f"{accounted} bytes accounted for in {link.stats}"


def assert_stats_close(stats: Stats) -> None:
    """Every byte and every packet of a session is in exactly one of its counters."""
    accounted = _sum(stats, BYTES) + stats.buffered
    assert stats.bytes_received == accounted, f"{accounted} bytes accounted for in {stats}"
    accounted = _sum(stats, PACKETS)
    assert stats.packets == accounted, f"{accounted} packets accounted for in {stats}"


@dataclass
class Ledgers:
    """What was made, held so that no device is kept from being collected.

    Attributes:
        streams: What outlives a session that had a stream: its counters, and the links that its packets came by.
    """

    links: list[Link] = field(default_factory=list)  # every link
    sessions: list[ref[Lidar]] = field(default_factory=list)  # every session, as long as it lives
    streams: list[tuple[AssemblerStats, list[Link]]] = field(default_factory=list)

    def assert_closed(self) -> None:
        """Fail when one of them does not close."""
        for link in self.links:
            assert_link_closes(link)
        for lidar in self.sessions:
            alive = lidar()
            if alive is not None:
                assert_stats_close(alive.stats)
        for assembled, links in self.streams:
            unread = sum(link.stats.unread_packets for link in links)
            packets = sum(link.stats.packets for link in links)
            accounted = unread + _sum(assembled, PACKETS)
            assert packets == accounted, (
                f"{accounted} packets accounted for in {[link.stats for link in links]} {assembled}"
            )


@contextmanager
def ledgers_made() -> Iterator[Ledgers]:
    """Collect every link and session that is made in the block, whoever makes it."""
    found = Ledgers()
    make_link, make_lidar, make_running = Link.__init__, Lidar.__init__, Running.__init__

    def link_made(self: Link, *args: Any) -> None:
        make_link(self, *args)
        found.links.append(self)

    def lidar_made(self: Lidar, *args: Any, **kwargs: Any) -> None:
        make_lidar(self, *args, **kwargs)
        found.sessions.append(ref(self))

    def running_made(self: Running, stream: Stream, at: At, latency: float, totals: Totals, *rest: Any) -> None:
        make_running(self, stream, at, latency, totals, *rest)
        links = next((links for assembled, links in found.streams if assembled is totals.assembled), None)
        if links is None:
            found.streams.append((totals.assembled, links := []))
        if at.dialogue.link not in links:
            links.append(at.dialogue.link)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Link, "__init__", link_made)
        patch.setattr(Lidar, "__init__", lidar_made)
        patch.setattr(Running, "__init__", running_made)
        yield found
