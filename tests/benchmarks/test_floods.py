"""The floods reach a program and it is measured, in /proc/, whatever the figures are on this machine."""

import math

import pytest

from benchmarks.floods.__main__ import flood, rows
from benchmarks.floods.bytes import BLOB, FLOODS, blob
from lidario.families.rplidar.formats import DenseFormat
from lidario.wire.link import Link


@pytest.mark.long
def test_a_flood_is_measured() -> None:
    found = flood("tcp", "short", 0.5, "-")
    assert math.isfinite(found["late_ms"])
    assert found["received_mb"] > 1
    assert found["memory_mb"] < 60


def test_every_flood_is_tried_from_every_line() -> None:
    assert {way for way, _ in rows()} == {"tcp", "udp", "udp-tiny", "pty", "zenoh", "fleet"}
    assert all(("pty", kind) in rows() for kind in FLOODS)


@pytest.mark.parametrize("kind", ["endless", "short", "restarts"])
def test_their_packets_are_intact(kind: str) -> None:
    link = Link()
    link.enter_stream(DenseFormat())
    link.receive_data(blob(kind), 0)
    assert link.stats.packet_bytes == len(blob(kind)) > 0.9 * BLOB
