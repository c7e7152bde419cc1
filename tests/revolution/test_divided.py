"""What the pieces of a divided revolution tell together."""

from __future__ import annotations

from math import nan

import pytest

from lidario.revolution.divided import sum_of
from tests.revolution.test_ended import EACH, decoded


def test_its_packets_end_one_after_the_other_and_each_counts_for_the_speed() -> None:
    pieces = [(3, 80.0, 600.0), (5, 80.0, nan), (2, 100.0, 660.0)]
    found = sum_of([decoded(packets, turn, reported_rpm=rpm) for packets, turn, rpm in pieces])
    assert list(found.ends) == list(range(EACH, 10 * EACH + 1, EACH))
    assert found.unbroken == 10
    # 8 of 80 and 2 of 100 parts of a revolution: 0.12 in 10 packets.
    assert found.revolution_packets == pytest.approx(10 / 0.12)
    assert found.revolution_samples == pytest.approx(10 * EACH / 0.12)
    # Of the five packets that tell a speed.
    assert found.reported_rpm == pytest.approx((3 * 600 + 2 * 660) / 5)
