"""Sectors: their numbers and times, whatever passed unseen before them; they end where the rotor has passed."""

import numpy as np
import pytest

from lidario.families.rplidar.simulated.packers import pack_dense, pack_standard
from tests.revolution.test_sectors import assert_sum, divided, without
from tests.support.cases import CASES
from tests.support.numbered import DENSE, numbered
from tests.support.streams import assembled


@pytest.mark.exhaustive(
    ("name", "lost"),
    sample=[
        (name, lost)
        for name in ("rplidar_9k_85", "ydlidar_4ros_room10", "hlds_lds01_5hz")
        for lost in (False, True)
    ],
)
def test_where_the_clock_stands_makes_no_difference(name: str, lost: bool) -> None:
    """A recording, or another machine, may count from any moment, also one that is to come."""
    case = next(each for each in CASES if each.name == name)
    raw, times, _ = without(case, range(20, len(case.packets), 40) if lost else ())

    def told(begin_ns: int) -> list[tuple[int, int, int]]:
        found = divided(case, raw, (8,), 64, lambda offset: times(offset) + begin_ns)
        return [(each.seq, each.stamp_ns - begin_ns, each.duration_ns) for each in found.order]

    assert told(10**12) == told(-(10**12)) != []


@pytest.mark.parametrize("turn", [0, 2])
@pytest.mark.exhaustive("name", sample=["rplidar_9k_82", "rplidar_9k_85", "ydlidar_4ros_room10", "ydlidar_x4_11hz"])
def test_what_passes_unseen_is_counted_once(name: str, turn: int) -> None:
    """Whether the first sector behind it tells it or, as behind the first revolution, the scan."""
    case = next(each for each in CASES if each.name == name)
    begins = [samples[0].packet for samples in case.turns]
    raw, times, _ = without(case, range((begins[turn] + begins[turn + 1]) // 2, begins[turn + 5] - 2))
    plain, found = assembled(case, raw, 64, times), divided(case, raw, (8,), 64, times)
    assert plain.stats.missed_scans > 1
    assert found.stats == plain.stats
    # Behind the first revolution no speed is sure: the first sector keeps the number that it was given.
    begin = 1 if turn == 0 else 0
    assert [scan.seq for scan in found.scans[begin:]] == [scan.seq for scan in plain.scans[begin:]]
    assert found.scans[begin:]


NODES = next(case for case in CASES if case.response_type == 0x81)


def nodes(degrees: np.ndarray, marks: np.ndarray) -> bytes:
    return pack_standard(np.rint(64 * degrees), np.full(len(degrees), 4000), 47, marks)


def test_a_reading_that_trembles_back_over_the_seam_ends_none() -> None:
    """It seems to be almost a revolution ahead: of nodes of a degree, the second one of each revolution."""
    degrees = np.tile([0.5, 359.9, *range(2, 360)], 5)
    found = divided(NODES, nodes(degrees, degrees == 0.5), (8,), 50)
    assert {len(sector) for sector in found.sectors[8]} == {45}
    assert_sum(found, 8, stamps_ns=0)


def test_a_device_that_starts_anew_in_mid_revolution_ends_none() -> None:
    """Packets of 15 degrees: ten of the third revolution came, and the next one is the first of another stream."""
    begins_anew = pack_dense(np.array([200 * 64]), np.full((1, 40), 1000), new_stream=True)
    raw = b"".join([*numbered(2 * 24 + 10, 960), begins_anew, *numbered(2 * 24, 960, 215 * 64)])
    found = divided(DENSE, raw, (8,), 84)
    assert [sector.index for sector in found.sectors[8]] == [*range(8), *range(3), *range(8), *range(4)]
    assert found.stats.broken_scans == 1


def test_a_mark_elsewhere_ends_none() -> None:
    """It stands at 200 degrees from then on; the first time it is taken for damage, the second time believed."""
    turned = np.arange(6 * 360)
    found = divided(NODES, nodes(turned % 360, np.isin(turned, [0, 360, 720, 1280, 1640, 2000])), (8,), 50)
    assert [sector.index for sector in found.sectors[8]] == [*range(8)] * 3 + [*range(4)] + [*range(3)]
    assert (found.stats.lost_packets, found.stats.broken_scans) == (1, 1)
