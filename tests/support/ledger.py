"""The ledger closes: whatever a test does, every byte and every packet that came in is counted exactly once.

Bytes are checked of every `Link` that a test makes; bytes and packets of every `Lidar`, by its public `Stats`.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import wraps
from typing import Any
from weakref import ref

import pytest

from lidario.model import Stats
from lidario.revolution.assemble import AssemblerStats
from lidario.session.lidar import Lidar
from lidario.session.streaming.scanner import Scanner
from lidario.wire.link import Link

BYTES = (
    "packet_bytes",
    "record_bytes",
    "skipped_bytes",
    "response_bytes",
    "stray_bytes",
    "drained_bytes",
    "discarded_bytes",
)
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
        links: Every link.
        sessions: Every session: itself as long as it lives, and what outlives it: the links it has had, and the
            counters.
    """

    links: list[Link] = field(default_factory=list)
    sessions: list[tuple[ref[Lidar], list[Link], AssemblerStats]] = field(default_factory=list)

    def assert_closed(self) -> None:
        """Fail when one of them does not close."""
        for link in self.links:
            assert_link_closes(link)
        for lidar, links, assembled in self.sessions:
            alive = lidar()
            if alive is not None:
                assert_stats_close(alive.stats)
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
    make_link, make_lidar, adopt = Link.__init__, Lidar.__init__, Scanner.adopt

    def link_made(self: Link, *args: Any) -> None:
        make_link(self, *args)
        found.links.append(self)

    def lidar_made(self: Lidar, *args: Any, **kwargs: Any) -> None:
        make_lidar(self, *args, **kwargs)
        found.sessions.append((ref(self), [self._at.dialogue.link], self._scanner.totals.assembled))

    @wraps(adopt)
    def adopted(self: Scanner) -> None:
        for _, links, assembled in found.sessions:
            if assembled is self.totals.assembled:
                links.append(self._at.dialogue.link)
        adopt(self)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Link, "__init__", link_made)
        patch.setattr(Lidar, "__init__", lidar_made)
        patch.setattr(Scanner, "adopt", adopted)
        yield found
