"""What the pieces of a divided revolution tell together."""

from __future__ import annotations

from math import nan

import numpy as np
import pytest

from lidario.families.base import Samples
from lidario.revolution.divided import sum_of

EACH = 40
NOTHING = np.empty(0, np.float32)


def piece(packets: int, revolution_packets: float, rpm: float) -> Samples:
    return Samples(
        NOTHING,
        NOTHING,
        None,
        before_seam=packets * EACH,
        ends=range(EACH, packets * EACH + 1, EACH),
        lost=0,
        unbroken=packets,
        revolution_packets=revolution_packets,
        revolution_samples=revolution_packets * EACH,
        reported_rpm=rpm,
    )


def test_its_packets_end_one_after_the_other_and_each_counts_for_the_speed() -> None:
    found = sum_of([piece(3, 80.0, 600.0), piece(5, 80.0, nan), piece(2, 100.0, 660.0)])
    assert list(found.ends) == list(range(EACH, 10 * EACH + 1, EACH))
    assert found.unbroken == 10
    # 8 of 80 and 2 of 100 parts of a revolution: 0.12 in 10 packets.
    assert found.revolution_packets == pytest.approx(10 / 0.12)
    assert found.revolution_samples == pytest.approx(10 * EACH / 0.12)
    # Of the five packets that tell a speed.
    assert found.reported_rpm == pytest.approx((3 * 600 + 2 * 660) / 5)
