"""Where sectors end, where something odd comes: only where the rotor has passed."""

import numpy as np

from lidario.families.rplidar.simulated.packers import pack_dense, pack_standard
from tests.revolution.test_sectors import assert_sum, divided
from tests.support.cases import CASES
from tests.support.numbered import DENSE, numbered

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
