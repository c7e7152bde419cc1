"""What a revolution that has ended tells, of which something is missing."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from lidario.families.base import DecodedRevolution, Samples
from lidario.families.rplidar.formats import DenseFormat
from lidario.families.rplidar.nodes import NodeFormat
from lidario.families.rplidar.simulated.packers import pack_dense
from lidario.families.ydlidar.formats import PointCloud
from lidario.revolution.ended import EndedRevolution, packet_time, share_before
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
            ends=range(EACH, packets * EACH + 1, EACH),
            revolutions=[DecodedRevolution(packets * EACH, revolution_packets, revolution_packets * EACH)],
            lost=0,
            unbroken=packets,
        ),
        **changes,
    )


def partial(packets: int, last_ns: int, *, over: float = 0.0, **changes: Any) -> PartialRevolution:
    first = pack_dense([round(over * 23040)], [[0] * EACH])
    run = Packets(first + bytes(84 * (packets - 1)), (Block(84, packets),), ((packets, last_ns),))
    carried = SampleArrays(NOTHING, NOTHING, None)
    return replace(PartialRevolution(whole=True, behind_gap=False, carried=carried, runs=[run]), **changes)


def ended(revolution: PartialRevolution, samples: Samples, start_ns: int) -> EndedRevolution:
    count = samples.ends[-1]
    arrays = SampleArrays(np.empty(count, np.float32), np.empty(count, np.float32), None)
    gaps = [each for each in samples.gaps if each[0] < count]
    here = EndedRevolution(revolution, revolution.runs[0], samples, arrays, samples.lost, gaps, revoked=0)
    here.start_ns = start_ns
    here.sample_ns, here.spanned_ns, here.told = SAMPLE_NS, count * SAMPLE_NS, True
    return here


@pytest.mark.parametrize("packets", [2, 3, 80])
def test_of_packets_whose_angles_are_not_certain_nothing_is_delivered(packets: int) -> None:
    samples = decoded(packets, 80.0, certain=False)
    here = ended(partial(packets, END_NS), samples, round(END_NS - packets * EACH * SAMPLE_NS))
    assert here.is_broken(DenseFormat(), USUAL_NS)
    # Where each tells the angles of all its samples, no speed is needed.
    assert here.is_broken(NodeFormat(), USUAL_NS) is (packets < 3)


def test_more_than_one_revolution_by_its_angles_is_broken() -> None:
    for lost, behind, broken in ((0, 0, False), (39, 0, False), (41, 0, True), (41, 10, False)):
        samples = decoded(80, 80.0, lost=lost, lost_behind=behind)
        here = ended(partial(80, END_NS), samples, round(END_NS - USUAL_NS))
        assert here.is_broken(DenseFormat(), USUAL_NS) is broken, lost


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


def test_one_that_took_much_longer_than_what_is_known_of_it_is_broken() -> None:
    whole, half = decoded(80, 80.0), decoded(40, 80.0, lost=40, gaps=[(20 * EACH, 40 * EACH)])
    for samples, late, broken in (
        (whole, 0.89, False), (whole, 0.91, True),
        # A turn is likelier to hide in a gap.
        (half, 0.64, False), (half, 0.66, True),
    ):  # fmt: skip
        here = ended(partial(80, END_NS), samples, round(END_NS - (1 + late) * USUAL_NS))
        assert here.is_broken(DenseFormat(), USUAL_NS) is broken


@pytest.mark.parametrize(("next_after", "broken"), [(0.0, False), (0.2, False), (0.4, True), (1.0, True)])
def test_its_last_packet_may_have_waited_while_nothing_came(next_after: float, broken: bool) -> None:
    """Half a turn is missing behind it, and passed before it was read unless it passed before the next one was."""
    behind = 80 * EACH // 2
    samples = decoded(79, 80.0, lost=41, lost_behind=40, gaps=[(EACH, EACH), (79 * EACH, behind)])
    revolution = partial(80, END_NS, ended_ns=round(END_NS + next_after * USUAL_NS))
    here = ended(revolution, samples, round(END_NS - 1.85 * USUAL_NS))
    assert here.is_broken(DenseFormat(), USUAL_NS) is broken


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
    assert share_before(wire, partial(40, END_NS, **lost), samples) == pytest.approx(share, abs=1e-4)
    # By where its seam is.
    moved: dict[str, Any] = {**lost, "over": (over + 0.25) % 1, "seam": 23040 // 4}
    assert share_before(wire, partial(40, END_NS, **moved), samples) == pytest.approx(share, abs=1e-4)
    # Its first packet is the first behind the seam.
    sure: dict[str, Any]
    for sure in ({"behind_gap": False}, {"carried": SampleArrays(NOTHING, NOTHING, None)}):
        assert share_before(wire, partial(40, END_NS, **lost | sure), samples) == 0


@pytest.mark.parametrize(("over", "enough"), [(5, False), (9, False), (11, True), (20, True)])
def test_what_is_missing_at_its_beginning_was_lost(over: int, enough: bool) -> None:
    revolution = partial(30, END_NS, behind_gap=True, carried=None, over=over / 80)
    least_ns = ended(revolution, decoded(30, 80.0), 0).least_ns(DenseFormat(), 0.0)
    assert least_ns == (0 if enough else pytest.approx(0.5 * USUAL_NS))


@pytest.mark.parametrize("certain", [False, True])
@pytest.mark.parametrize("told", [False, True])
def test_only_a_time_of_a_sample_that_is_told_proves_how_long_it_took(certain: bool, told: bool) -> None:
    here = ended(partial(80, END_NS), decoded(80, 80.0, certain=certain), round(END_NS - USUAL_NS))
    here.told = told
    beginning = here.beginning(DenseFormat(), broken=False, number=3, packets_before=7)
    assert beginning.tells_time is (certain and told)
    assert beginning.spanned_ns == (USUAL_NS if certain and told else 0)


@pytest.mark.parametrize("certain", [False, True])
def test_how_many_samples_are_missing_in_it(certain: bool) -> None:
    """At least as many as the packets that are missing hold."""
    samples = decoded(80, 80.0, certain=certain, lost=1, lost_behind=1, gaps=[(80 * EACH, 60)])
    here = ended(partial(80, END_NS), samples, 0)
    assert here.missing_samples(gap_behind=True) == (60 if certain else EACH)
    assert here.missing_samples(gap_behind=False) == EACH
    here.gaps = [(200, 30), (400, 25)]
    assert here.missing_samples(gap_behind=True) == (115 if certain else 55)
    assert here.missing_samples(gap_behind=False) == 55


@pytest.mark.parametrize(("longest", "ordinary"), [(39, False), (40, True), (80, True)])
@pytest.mark.parametrize("certain", [False, True])
def test_of_short_packets_nobody_knows_what_an_ordinary_one_takes(
    longest: int, ordinary: bool, certain: bool
) -> None:
    """But not more than the longest one there is, of 80 samples."""
    sizes = (10 + 2 * 7, 10 + 2 * longest)
    packets = Packets(bytes(sum(sizes)), tuple(Block(size, 1) for size in sizes), ((2, END_NS),))
    samples = decoded(2, 20.0, certain=certain)
    each = 80 if not ordinary else 40 if certain else longest
    assert packet_time(PointCloud(), packets, samples, SAMPLE_NS) == (each * SAMPLE_NS, ordinary)
    # Where all are alike, an ordinary one came.
    alike = partial(2, END_NS).runs[0]
    assert packet_time(DenseFormat(), alike, samples, SAMPLE_NS) == (EACH * SAMPLE_NS, True)


@pytest.mark.parametrize(("there", "behind", "broken"), [(1590, 0, False), (1610, 0, True), (1590, 500, False)])
def test_so_is_one_that_misses_too_many_samples_inside(there: int, behind: int, broken: bool) -> None:
    gaps = [(400, there), *([(80 * EACH, behind)] if behind else [])]
    here = ended(partial(80, END_NS), decoded(80, 80.0, gaps=gaps), round(END_NS - USUAL_NS))
    assert here.is_broken(DenseFormat(), USUAL_NS) is broken


def test_where_samples_are_missing() -> None:
    samples = replace(decoded(5, 80.0), gaps=[(80, 40)])
    revolution = PartialRevolution(whole=True)
    assert revolution.gaps(samples, 20, 200, revoked=False) == [(100, 40)]
    assert revolution.gaps(samples, 20, 100, revoked=False) == []  # behind its end
    revolution.skipped_behind_carried = 7
    assert revolution.gaps(samples, 20, 200, revoked=False) == [(20, 7), (100, 40)]
    # Without the samples that were carried over, it begins behind that gap.
    assert revolution.gaps(samples, 20, 200, revoked=True) == [(80, 40)]
    assert revolution.gaps(replace(samples, certain=False), 20, 200, revoked=False) is None


def test_how_long_nothing_was_measured_is_known_where_its_beginning_was_read() -> None:
    """What a read brought had been measured meanwhile."""
    packets = Packets(b"....", (Block(1, 4),), ((1, 600), (4, 900)))
    known = PartialRevolution(whole=True, carried_ns=400, begun_ns=500, ended_ns=1200)
    assert known.read_ns == 700
    assert [*known.silences_ns(packets, 60)] == [200 - 60, 300 - 3 * 60, 300]
    # The packets behind the end came with the same read, and fill the time up to it.
    assert [*known.silences_ns(replace(packets, cut=True), 60)] == [140, 120]
    unknown = PartialRevolution(whole=True, carried_ns=400, ended_ns=1200)
    assert (unknown.read_ns, [*unknown.silences_ns(packets, 60)]) == (0, [])
