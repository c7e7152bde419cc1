"""What waits for a reader of a fleet: the latest of every lidar, bounded in number and in bytes."""

from __future__ import annotations

import weakref

import pytest

from lidario.ros import fleet
from lidario.ros.fleet import FleetScan, WaitingScans
from lidario.testing import make_scan
from tests.scans.test_scan import FOUR


def test_a_slow_reader_sees_the_latest_of_every_lidar_and_what_is_missing() -> None:
    waiting = WaitingScans(2)
    for number, (key, lost) in enumerate([("a", 0), ("a", 3), ("b", 0), ("a", 0), ("a", 0)]):
        waiting.put(FleetScan(key, FOUR, number, lost))
    assert len(waiting) == 3
    taken = [waiting.take() for _ in range(3)]
    assert [(each.key, each.sent_ns, each.lost) for each in taken] == [("a", 3, 5), ("a", 4, 0), ("b", 2, 0)]
    assert (len(waiting), waiting.dropped) == (0, 2)


class Key(str):
    """A key of which it is seen when it is forgotten."""


def test_nothing_is_kept_of_a_lidar_whose_scans_are_gone(monkeypatch: pytest.MonkeyPatch) -> None:
    """Lidars come and go, and their number is not ours. Of a bounded number it is kept how many were dropped."""
    monkeypatch.setattr(fleet, "MOST_BYTES", 1)
    monkeypatch.setattr(fleet, "MOST_MISSING", 0)
    scans, keys = WaitingScans(2), [Key("dropped"), Key("taken")]
    kept = [weakref.ref(key) for key in keys]
    while keys:
        scans.put(FleetScan(keys.pop(0), FOUR, 0, 0))
    assert [each() for each in kept] == [None, "taken"]
    scans.take()
    assert kept[1]() is None


def test_scans_that_wait_are_bounded_in_bytes(monkeypatch: pytest.MonkeyPatch) -> None:
    """How many lidars there are is for the network to say."""
    monkeypatch.setattr(fleet, "MOST_BYTES", 30_000)
    scans = WaitingScans(4)
    for number in range(100):
        scans.put(FleetScan(f"k{number % 50}", FOUR, 0, 0))
    left = len(scans)
    assert scans.dropped == 100 - left
    assert 5 < left < 20
    assert [scans.take().key for _ in range(left)] == [f"k{number % 50}" for number in range(100 - left, 100)]
    assert len(scans) == 0


def test_scans_that_take_the_place_of_smaller_ones_are_bounded_too(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(fleet, "MOST_BYTES", 30_000)
    scans, large = WaitingScans(1), make_scan([0.0] * 1000, 1.0)
    for scan in (FOUR, large):
        for number in range(10):
            scans.put(FleetScan(f"k{number}", scan, 0, 0))
    assert [scans.take().key for _ in range(len(scans))] == ["k8", "k9"]
    # A large one behind many small ones of other lidars pushes out as many as it needs.
    for number in range(12):
        scans.put(FleetScan(f"k{number}", large if number == 11 else FOUR, 0, 0))
    assert [scans.take().key for _ in range(len(scans))] == [f"k{number}" for number in range(2, 12)]


def test_what_the_bound_of_bytes_drops_is_told_by_the_next_scan_of_that_lidar(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """It was its only scan that waited."""
    monkeypatch.setattr("lidario.ros.fleet.MOST_BYTES", 5000)
    scans, scan = WaitingScans(1), make_scan([0.0] * 100, 1.0)
    for number in range(20):
        scans.put(FleetScan(f"robots/{number}/scan", scan, 0, 1))
    assert scans.dropped > 10
    for number in range(20):
        scans.put(FleetScan(f"robots/{number}/scan", scan, 0, 0))
    told = [scans.take() for _ in range(len(scans))]
    # Each lidar has lost one message on the way, and its scans before this one were dropped.
    assert {each.lost for each in told} == {2}
