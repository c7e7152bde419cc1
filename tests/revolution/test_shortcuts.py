"""The fast paths give the same results as the general code.

Each test brings the same to both: one form of it takes the shorter way, another that means the same does not.
"""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from lidario.families.base import DecodedRevolution, Samples
from lidario.families.rplidar.formats import DenseFormat
from lidario.revolution.clock import Beginning, RevolutionClock
from lidario.revolution.ended import EndedRevolution
from lidario.revolution.partial import PartialRevolution, SampleArrays
from lidario.revolution.timing import first_sample_ns
from lidario.wire.blocks import Block
from lidario.wire.events import Packets

WIRE = DenseFormat()
SAMPLE_NS = 31250.0
NOTHING = np.empty(0, np.float32)


@given(
    delays=st.lists(st.integers(0, 5_000_000), min_size=1, max_size=20),
    carried=st.integers(0, 39),
    byte_ns=st.sampled_from([0.0, 10_000.0]),
)
def test_the_time_of_the_first_sample(delays: list[int], carried: int, byte_ns: float) -> None:
    """Without a gap, and with one in which no sample is missing; packets come late, each by another delay."""
    each, packets = 40, len(delays)
    began_ns = 10**12
    on_time = [began_ns + round((carried + (number + 1) * each - 1) * SAMPLE_NS) for number in range(packets)]
    latest = 0
    arrivals = []
    for number, (at_ns, delay) in enumerate(zip(on_time, delays, strict=True)):
        latest = max(latest, at_ns + delay)
        arrivals.append((number + 1, latest))
    run = Packets(bytes(84 * packets), (Block(84, packets),), tuple(arrivals))
    decoded = DecodedRevolution(packets * each, 0.0, 0.0)
    samples = Samples(NOTHING, NOTHING, None, range(each, packets * each + 1, each), [decoded], 0, packets)
    some = np.zeros(carried, np.float32)
    found = []
    # Where the angles are not certain, too.
    for lost, certain in ((0, True), (0, False), (1, True)):
        samples = replace(samples, certain=certain)
        partial = PartialRevolution(whole=True, runs=[run], lost_behind_carried=lost)
        if carried:
            partial.carried, partial.carried_ns = SampleArrays(some, some, None), began_ns + 10**10
        elif lost:
            samples = replace(samples, gaps=[(0, 0)])
        ended = EndedRevolution(partial, run, samples, SampleArrays(some, some, None), 0, [], revoked=0)
        ended.sample_ns = SAMPLE_NS
        found.append(first_sample_ns(ended, byte_ns))
    assert found[0] == found[1] == found[2]
    least = min(late - at_ns for (_, late), at_ns in zip(arrivals, on_time, strict=True))
    assert found[0] == pytest.approx(began_ns + least - 1.5 * SAMPLE_NS - 84 * byte_ns, abs=1)


@given(
    speeds=st.lists(st.floats(0.97, 1.03), min_size=4, max_size=20),
    late=st.lists(st.floats(0, 0.1), min_size=20, max_size=20),
    over=st.sampled_from([0.0, 0.05, 0.6]),
    missing=st.integers(0, 4),
    gap=st.booleans(),
    read=st.booleans(),
    at=st.integers(3, 19),
)
def test_counting_revolutions(
    speeds: list[float], late: list[float], over: float, missing: int, gap: bool, read: bool, at: int
) -> None:
    """Late stamps make no revolution, and those of which nothing came are told."""
    beginnings = []
    start_ns, turn_ns = 10.0**12, 1e8
    for number, (speed, share) in enumerate(zip(speeds, late, strict=False)):
        lost = missing > 0 and gap and number + 1 == at
        before = 0.0 if number else over
        beginnings.append(
            Beginning(
                round(start_ns + (before + share) * turn_ns),
                before,
                turn_ns,
                turn_ns / 80,
                packets=80 - 5 * lost,
                lost=5 * lost,
                broken=False,
                number=0,  # both are told below
                packets_before=0,
                reads_ns=(0, round(10 * turn_ns), round(10.6 * turn_ns)) if read else (),
            )
        )
        start_ns += turn_ns * (1 + missing * (number + 1 == at))
        turn_ns *= speed
    clock, told = RevolutionClock(1e9), list[int]()
    for here in beginnings:
        here.number = len(told) + sum(told)
        here.packets_before = 80 * here.number
        told.append(clock.follow(here).unseen)
    # Where no packet is known to be missing, late stamps might be all, until reads went on and they stayed late.
    assert sum(told) == (missing if at < len(beginnings) and (gap or read) else 0)
