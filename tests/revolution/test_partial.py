"""The revolution in the making: what is carried into it, and where its samples are missing."""

from dataclasses import replace

import numpy as np
import pytest

from lidario.families.base import Samples
from lidario.revolution.partial import PartialRevolution, SampleArrays

NOTHING = np.empty(0, np.float32)
SOME = SampleArrays(np.zeros(20, np.float32), np.zeros(20, np.float32), None)
DECODED = Samples(NOTHING, NOTHING, None, 200, range(40, 201, 40), 1, 2, gaps=[(80, 40)])


@pytest.mark.parametrize(("known", "found", "missing"), [(80, 80, 0), (80, 90, 0), (40, 80, 1), (20.2, 80, 3)])
def test_a_packet_that_was_stretched_over_a_gap_is_dropped(known: float, found: float, missing: int) -> None:
    """It was taken to cover as much as `known` packets make a revolution; now it is known how many do."""
    partial = PartialRevolution(whole=True, carried=SOME, first_packets=known)
    assert partial.revoke_carried(found) == missing
    assert (partial.carried is None) is bool(missing)


def test_a_packet_that_was_certain_is_not_dropped() -> None:
    partial = PartialRevolution(whole=True)
    partial.carry(SOME, 7, replace(DECODED, revolution_packets=40.0))
    assert partial.revoke_carried(80) == 0
    assert partial.carried is SOME
    partial.carry(SOME, 7, replace(DECODED, revolution_packets=40.0, certain=False))
    assert partial.revoke_carried(80) == 1
    assert partial.revoke_carried(80) == 0


def test_where_samples_are_missing() -> None:
    partial = PartialRevolution(whole=True, carried=SOME)
    assert partial.gaps(DECODED, 20, 200, revoked=False) == [(100, 40)]
    assert partial.gaps(DECODED, 20, 100, revoked=False) == []  # behind its end
    partial.skipped_behind_carried = 7
    assert partial.gaps(DECODED, 20, 200, revoked=False) == [(20, 7), (100, 40)]
    # Without the samples that were carried over, it begins behind that gap.
    assert partial.gaps(DECODED, 20, 200, revoked=True) == [(80, 40)]
    assert partial.gaps(replace(DECODED, certain=False), 20, 200, revoked=False) is None
