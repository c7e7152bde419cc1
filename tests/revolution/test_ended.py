"""What a revolution that has ended tells, of which something is missing."""

from dataclasses import replace
from math import nan
from typing import Any

import numpy as np
import pytest

from lidario.families.base import Samples
from lidario.families.rplidar.formats import DenseFormat
from lidario.families.ydlidar.formats import PointCloud
from lidario.revolution.ended import EndedRevolution
from lidario.revolution.partial import PartialRevolution, SampleArrays
from lidario.wire.blocks import Block
from lidario.wire.events import Packets

SAMPLE_NS = 31250.0
EACH = 40
NOTHING = np.empty(0, np.float32)
END_NS = 10**12
USUAL_NS = 80 * EACH * SAMPLE_NS


def decoded(packets: int, revolution_packets: float, **changes: Any) -> Samples:
    return replace(
        Samples(
            NOTHING,
            NOTHING,
            None,
            before_seam=packets * EACH,
            ends=range(EACH, packets * EACH + 1, EACH),
            lost=0,
            unbroken=packets,
            revolution_packets=revolution_packets,
            revolution_samples=revolution_packets * EACH,
            reported_rpm=nan,
        ),
        **changes,
    )


def partial(packets: int, last_ns: int, **changes: Any) -> PartialRevolution:
    run = Packets(bytes(84 * packets), (Block(84, packets),), ((packets, last_ns),))
    carried = SampleArrays(NOTHING, NOTHING, None)
    return replace(PartialRevolution(whole=True, behind_gap=False, carried=carried, runs=[run]), **changes)


def ended(revolution: PartialRevolution, samples: Samples, start_ns: int) -> EndedRevolution:
    count = samples.ends[-1]
    arrays = SampleArrays(np.empty(count, np.float32), np.empty(count, np.float32), None)
    return EndedRevolution(
        revolution,
        revolution.runs[0],
        samples,
        arrays,
        samples.lost,
        [],
        start_ns=start_ns,
        elapsed_ns=revolution.last_ns - start_ns,
        sample_ns=SAMPLE_NS,
        spanned_ns=count * SAMPLE_NS,
    )


@pytest.mark.parametrize(("packets", "broken"), [(2, True), (3, False), (80, False)])
def test_of_few_packets_whose_angles_are_not_certain_nothing_is_believed(packets: int, broken: bool) -> None:
    samples = decoded(packets, 80.0, certain=False)
    here = ended(partial(packets, END_NS), samples, round(END_NS - packets * EACH * SAMPLE_NS))
    assert here.is_broken(USUAL_NS) is broken


def test_more_than_one_revolution_by_its_angles_is_broken() -> None:
    for lost, behind, broken in ((0, 0, False), (39, 0, False), (41, 0, True), (41, 10, False)):
        samples = decoded(80, 80.0, lost=lost, lost_behind=behind)
        here = ended(partial(80, END_NS), samples, round(END_NS - USUAL_NS))
        assert here.is_broken(USUAL_NS) is broken, lost


def test_how_much_of_a_revolution_must_have_come() -> None:
    def least(packets: int, wire: Any = None, **changes: Any) -> float:
        samples = decoded(packets, 80.0, **changes)
        here = ended(partial(packets, END_NS), samples, END_NS - packets)
        return here.least_ns(wire or DenseFormat(), 0.8 * USUAL_NS)

    assert least(41) == least(40) == 0.0
    assert least(39) == pytest.approx(0.5 * USUAL_NS)
    # By the revolutions before, where the angles tell nothing.
    assert least(39, certain=False) == pytest.approx(0.4 * USUAL_NS)
    # A check value keeps false marks away.
    assert least(39, PointCloud()) == least(39, PointCloud(), certain=False) == 0.0
