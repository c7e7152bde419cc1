"""The speed of a rotor from a few packets, each of which tells an angle and a time."""

import tracemalloc

import numpy as np
import pytest

from lidario.families.rplidar.formats import DenseFormat
from lidario.families.rplidar.simulated.packers import pack_dense
from lidario.revolution.sparse_speed import SparseSpeed, dated_angles
from lidario.wire.blocks import Block
from lidario.wire.events import Packets

MS = 1e6


def found(angles: np.ndarray, times_ns: np.ndarray) -> list[float]:
    """What it takes the rotor to turn, after each packet; 0 where that is not known."""
    search, told = SparseSpeed(1e9), list[float]()
    for angle, at_ns in zip(angles.tolist(), times_ns.tolist(), strict=True):
        search.add(angle % 1.0, round(at_ns))
        told.append(search.revolution_ns())
    return told


@pytest.mark.parametrize("hertz", [2.0, 10.0, 21.0])
@pytest.mark.exhaustive("seed", sample=[0], full=range(4))
def test_scarce_packets_tell_the_speed(hertz: float, seed: int) -> None:
    """One packet in a revolution or less, late by some milliseconds, and one in ten is none."""
    random = np.random.default_rng(seed)
    times_ns = np.cumsum(random.exponential(1.3 / hertz * 1e9, 60))
    angles = times_ns * 1e-9 * hertz + random.random()
    angles[random.random(60) < 0.1] = random.random()
    told = found(angles, times_ns + random.uniform(0, 0.02 / hertz * 1e9, 60))
    known = [ns for ns in told if ns]
    assert len(known) > 5
    assert known == pytest.approx([1e9 / hertz] * len(known), rel=0.005)


@pytest.mark.parametrize("seed", range(3))
def test_packets_of_one_angle_tell_it_too(seed: int) -> None:
    """They fit twice the speed as well, and three times it: the slowest is taken."""
    random = np.random.default_rng(seed)
    turns = np.cumsum(random.integers(1, 5, 60)).astype(float)
    known = [ns for ns in found(turns, turns * 140 * MS) if ns]
    assert len(known) > 5
    assert known == pytest.approx([140 * MS] * len(known), rel=1e-3)


@pytest.mark.parametrize(("off", "is_told"), [(0.15, True), (0.4, False)])
@pytest.mark.parametrize("seed", range(3))
def test_angles_may_be_off_by_a_sixth_of_a_revolution(seed: int, off: float, is_told: bool) -> None:
    """A packet is dated by the read that brought it, and that may come late."""
    random = np.random.default_rng(seed)
    turns = np.cumsum(random.uniform(0.6, 1.9, 60))
    assert any(found(turns + off * random.integers(0, 2, 60), turns * 140 * MS)) is is_told


@pytest.mark.long
@pytest.mark.parametrize("hertz", [1, 3, 10])
def test_packets_of_any_angle_tell_nothing(hertz: int) -> None:
    random = np.random.default_rng(hertz)
    times_ns = np.cumsum(random.exponential(1e9 / hertz, 200))
    assert not any(found(random.random(200), times_ns))


def test_packets_of_few_revolutions_tell_nothing() -> None:
    """Not twice the speed either, at which they would be of enough revolutions."""
    turns = np.arange(14) // 3 * 1.0
    assert not any(found(turns, turns * 100 * MS + np.arange(14)))


def test_packets_that_come_together_or_far_apart_tell_nothing() -> None:
    assert not any(found(np.linspace(0, 1, 40), np.zeros(40)))
    for apart_s in (2.3, 30):  # so that 20 s hold no ten packets
        assert not any(found(np.zeros(40), np.arange(40) * apart_s * 1e9))


def test_times_that_go_back_make_it_try_no_more_speeds() -> None:
    """A read that was late by minutes is dated back. One search held 48 MB."""
    random = np.random.default_rng(1)
    times_ns = np.arange(40) * 1.2e9
    times_ns[::5] += 300e9
    tracemalloc.start()
    try:
        found(random.random(40), times_ns)
        _, most = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert most < 1e6


@pytest.mark.parametrize("reads", range(1, 10))
def test_of_one_revolution_two_packets_are_taken(reads: int) -> None:
    """Each with the time at which it came: the last one of its read."""
    wire = DenseFormat()
    data = pack_dense([700 * at for at in range(2 * reads)], [[1000] * 40] * (2 * reads))
    arrivals = tuple((2 * read + 2, 1000 * read) for read in range(reads))
    taken = dated_angles(wire, Packets(data, (Block(84, 2 * reads),), arrivals))
    assert len(taken) == min(2, reads)
    assert set(taken) <= {(700 * (2 * read + 1) / 23040, 1000 * read) for read in range(reads)}
