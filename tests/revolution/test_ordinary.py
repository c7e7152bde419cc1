"""A revolution that looks ordinary at a glance is one of which the judges find nothing."""

from dataclasses import replace
from math import nan
from typing import Any

import numpy as np
import pytest

from lidario.families.base import Samples
from lidario.families.rplidar.formats import DenseFormat
from lidario.revolution.ended import EndedRevolution
from lidario.revolution.judge import beginning_of, is_broken, least_of
from lidario.revolution.ordinary import ordinary_beginning
from lidario.revolution.partial import PartialRevolution, SampleArrays
from lidario.wire.blocks import Block
from lidario.wire.events import Packets

SAMPLE_NS = 31250.0
EACH = 40
NOTHING = np.empty(0, np.float32)


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


def glance(here: EndedRevolution, ordinary_ns: float) -> object:
    return ordinary_beginning(DenseFormat(), here, ordinary_ns, number=7, packets_before=500)


@pytest.mark.parametrize("share", [0.3, 0.49, 0.51, 0.97, 1.0, 1.03, 1.45, 1.55, 2.5])
@pytest.mark.parametrize("late", [-0.9, -0.4, -0.3, 0.0, 0.3, 0.45, 0.55, 0.85, 0.95, 1.5])
@pytest.mark.parametrize("before", [0.3, 1.0, 3.0])
def test_what_is_told_is_what_the_judges_find(share: float, late: float, before: float) -> None:
    packets = 80
    samples = decoded(packets, packets / share)
    spanned_ns = samples.ends[-1] * SAMPLE_NS
    start_ns = round(10**12 - spanned_ns * (1 + late))
    here = ended(partial(packets, 10**12), samples, start_ns)
    told = glance(here, before * spanned_ns)
    broken = is_broken(here, before * spanned_ns)
    found = beginning_of(
        DenseFormat(),
        here,
        here.partial.runs[0],
        samples,
        gap_behind=False,
        broken=broken,
        number=7,
        packets_before=500,
    )
    unusual = broken or least_of(DenseFormat(), here, 0.0) > 0
    # Where a read came too late for its stamp, the beginning is told by the end.
    unusual |= found.start_ns != start_ns
    assert told is None if unusual else told == found or elapsed_too_long(late)


def elapsed_too_long(late: float) -> bool:
    """Where this is so, it depends on each packet's arrival whether the revolution is broken."""
    return late > 0.5


ORDINARY_START_NS = 10**12 - 80 * EACH * 31250


def test_an_ordinary_revolution_is_one() -> None:
    assert glance(ended(partial(80, 10**12), decoded(80, 80.0), ORDINARY_START_NS), 1e8) is not None


@pytest.mark.parametrize(
    ("revolution", "samples"),
    [
        ({"whole": False}, {}),
        ({"carried": None, "behind_gap": True}, {}),
        ({}, {"lost": 1, "lost_behind": 1}),
        ({}, {"certain": False}),
    ],
)
def test_what_may_be_unusual_is_left_to_the_judges(revolution: dict[str, Any], samples: dict[str, Any]) -> None:
    here = ended(partial(80, 10**12, **revolution), decoded(80, 80.0, **samples), ORDINARY_START_NS)
    assert glance(here, 1e8) is None
