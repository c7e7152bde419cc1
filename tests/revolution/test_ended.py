"""What a revolution that has ended tells, of which something is missing."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from lidario.families.base import DecodedRevolution, Samples
from lidario.families.rplidar.formats import DenseFormat
from lidario.families.rplidar.simulated.packers import pack_dense
from lidario.families.ydlidar.formats import PointCloud
from lidario.revolution.ended import EndedRevolution, share_before
from lidario.revolution.partial import PartialRevolution, SampleArrays
from lidario.revolution.timing import first_sample_ns
from lidario.wire.blocks import Block
from lidario.wire.events import Packets

SAMPLE_NS = 31250.0
EACH = 40
NOTHING = np.empty(0, np.float32)
NO_ARRAYS = SampleArrays(NOTHING, NOTHING, None)
USUAL_NS = 80 * EACH * SAMPLE_NS


def decoded(packets: int, revolution_packets: float, **changes: Any) -> Samples:
    """So many packets of a revolution that has `revolution_packets`."""
    revolution = DecodedRevolution(packets * EACH, revolution_packets, revolution_packets * EACH)
    ends = range(EACH, packets * EACH + 1, EACH)
    return Samples(NOTHING, NOTHING, None, ends, [revolution], lost=0, unbroken=packets, **changes)


def partial(packets: int, *, over: float = 0.0, **changes: Any) -> PartialRevolution:
    """A revolution of which so many packets came; such a part of it was over when the first one did."""
    first = pack_dense([round(over * 23040)], [[0] * EACH])
    run = Packets(first + bytes(84 * (packets - 1)), (Block(84, packets),), ((packets, 0),))
    return replace(PartialRevolution(whole=True, behind_gap=False, carried=NO_ARRAYS, runs=[run]), **changes)


def ended(packets: int, **changes: Any) -> EndedRevolution:
    """One of which so many packets came, of 80."""
    revolution, samples = partial(packets), decoded(packets, 80.0, **changes)
    here = EndedRevolution(revolution, revolution.runs[0], samples, NO_ARRAYS, 0, [], revoked=0)
    here.sample_ns, here.spanned_ns, here.told = SAMPLE_NS, packets * EACH * SAMPLE_NS, True
    return here


@pytest.mark.parametrize("certain", [False, True])
def test_its_first_sample_is_dated_by_its_last_whether_angles_are_certain_or_not(certain: bool) -> None:
    """Its packets came at 0, later than their last sample by a packet on the line and one and a half samples."""
    found = first_sample_ns(ended(30, certain=certain), 10_000.0)
    assert found == pytest.approx(-(30 * EACH - 1 + 1.5) * SAMPLE_NS - 84 * 10_000, abs=1)


def test_how_much_of_a_revolution_must_have_come() -> None:
    def least(packets: int, wire: Any = None, **changes: Any) -> float:
        return ended(packets, **changes).least_ns(wire or DenseFormat(), 0.8 * USUAL_NS)

    assert least(41) == least(40) == 0.0
    assert least(39) == pytest.approx(0.5 * USUAL_NS)
    # By the revolutions before, where the angles tell nothing.
    assert least(39, certain=False) == pytest.approx(0.4 * USUAL_NS)
    # A check value keeps false marks away.
    assert least(39, PointCloud()) == least(39, PointCloud(), certain=False) == 0.0


@pytest.mark.parametrize(
    ("over", "packets", "share"),
    [
        # Within the first packet's arc it began.
        (0.8 / 80, 80, 0), (1.0 / 80, 80, 1.0 / 80), (0.8 / 200, 200, 0), (1.5 / 200, 200, 1.5 / 200),
        # It trembled back behind the seam.
        (0.5, 80, 0.5), (0.91, 80, 0.91), (0.92, 80, 0),
    ],
)  # fmt: skip
def test_what_was_over_when_its_first_packet_came(over: float, packets: int, share: float) -> None:
    samples, wire = decoded(40, packets), DenseFormat()
    lost: dict[str, Any] = {"behind_gap": True, "carried": None, "over": over}
    assert share_before(wire, partial(40, **lost), samples) == pytest.approx(share, abs=1e-4)
    # By where its seam is.
    moved: dict[str, Any] = {**lost, "over": (over + 0.25) % 1, "seam": 23040 // 4}
    assert share_before(wire, partial(40, **moved), samples) == pytest.approx(share, abs=1e-4)
    # Its first packet is the first behind the seam.
    sure: dict[str, Any]
    for sure in ({"behind_gap": False}, {"carried": NO_ARRAYS}):
        assert share_before(wire, partial(40, **lost | sure), samples) == 0


def test_where_samples_are_missing() -> None:
    samples = decoded(5, 80.0, gaps=[(80, 40)])
    revolution = PartialRevolution(whole=True)
    assert revolution.gaps(samples, 20, 200, revoked=False) == [(100, 40)]
    assert revolution.gaps(samples, 20, 100, revoked=False) == []  # behind its end
    revolution.skipped_behind_carried = 7
    assert revolution.gaps(samples, 20, 200, revoked=False) == [(20, 7), (100, 40)]
    # Without the samples that were carried over, it begins behind that gap.
    assert revolution.gaps(samples, 20, 200, revoked=True) == [(80, 40)]
    assert revolution.gaps(replace(samples, certain=False), 20, 200, revoked=False) is None
