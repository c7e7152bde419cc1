"""What the judges find of a revolution of which something is missing."""

from typing import Any

import pytest

from lidario.families.rplidar.formats import DenseFormat
from lidario.families.ydlidar.formats import PointCloud
from lidario.revolution.judge import beginning_of, is_broken, least_of
from tests.revolution.test_ordinary import EACH, SAMPLE_NS, decoded, ended, partial

END_NS = 10**12
USUAL_NS = 80 * EACH * SAMPLE_NS


@pytest.mark.parametrize(("packets", "broken"), [(2, True), (3, False), (80, False)])
def test_of_few_packets_whose_angles_are_not_certain_nothing_is_believed(packets: int, broken: bool) -> None:
    samples = decoded(packets, 80.0, certain=False)
    here = ended(partial(packets, END_NS), samples, round(END_NS - packets * EACH * SAMPLE_NS))
    assert is_broken(here, USUAL_NS) is broken


def test_more_than_one_revolution_by_its_angles_is_broken() -> None:
    for lost, behind, broken in ((0, 0, False), (39, 0, False), (41, 0, True), (41, 10, False)):
        samples = decoded(80, 80.0, lost=lost, lost_behind=behind)
        here = ended(partial(80, END_NS), samples, round(END_NS - USUAL_NS))
        assert is_broken(here, USUAL_NS) is broken, lost


def test_how_much_of_a_revolution_must_have_come() -> None:
    def least(packets: int, wire: Any = None, **changes: Any) -> float:
        samples = decoded(packets, 80.0, **changes)
        here = ended(partial(packets, END_NS), samples, END_NS - packets)
        return least_of(wire or DenseFormat(), here, 0.8 * USUAL_NS)

    assert least(41) == least(40) == 0.0
    assert least(39) == pytest.approx(0.5 * USUAL_NS)
    # By the revolutions before, where the angles tell nothing.
    assert least(39, certain=False) == pytest.approx(0.4 * USUAL_NS)
    # A check value keeps false marks away.
    assert least(39, PointCloud()) == least(39, PointCloud(), certain=False) == 0.0


@pytest.mark.parametrize("gap_behind", [False, True])
def test_packets_that_are_missing_behind_the_last_one_belong_to_this_or_to_the_next(gap_behind: bool) -> None:
    samples = decoded(70, 80.0, lost=10, lost_behind=10)
    late_ns = round(0.5 * USUAL_NS)
    # All came with one read that was completed late, so that the beginning is told by the end.
    here = ended(partial(70, END_NS), samples, END_NS - round(70 * EACH * SAMPLE_NS) + late_ns)
    found = beginning_of(
        DenseFormat(),
        here,
        here.partial.runs[0],
        samples,
        gap_behind=gap_behind,
        broken=False,
        number=3,
        packets_before=7,
    )
    assert found.behind == (0 if gap_behind else 10)
    from_end_ns = END_NS - round(70 * EACH * SAMPLE_NS) + gap_behind * 10 * EACH * SAMPLE_NS
    assert found.start_ns == pytest.approx(from_end_ns, abs=1)
    assert (found.lost, found.number, found.packets_before) == (10, 3, 7)
