"""Trouble passes, and with it all that it made the host believe (`benchmarks.recovery`)."""

from __future__ import annotations

from itertools import cycle, product

import pytest

from benchmarks.recovery import TROUBLES, seconds_until_right
from benchmarks.truth_forms import FORMATS

LONGEST_S = 1.5
"""The slowest of thousands of runs took half a second."""
FOUND = [
    # Half a step was believed, and so each second packet was told as lost for ever.
    ("0x84 A3", "2 % of the bytes lost", 3),
    # A scan of one packet was the measure of those behind it, which all came too late for it.
    ("4ROS", "2 % of the bytes flipped", 1),
    ("G4", "10 % of the bytes flipped", 1),
    # Two and a half steps were believed, and confirmed by the number of nodes: each revolution seemed to be two.
    ("0x81 S1", "85 % of the packets gone", 47),
]


@pytest.mark.parametrize(("name", "trouble", "seed"), FOUND)
def test_nothing_stays_wrong_for_ever(name: str, trouble: str, seed: int) -> None:
    assert seconds_until_right(FORMATS[name], trouble, seed) <= LONGEST_S


@pytest.mark.exhaustive("seed", sample=[0], full=range(8))
@pytest.mark.exhaustive(
    "what",
    sample=list(zip(cycle(["0x81 S1", "0x85 C1", "4ROS", "LD19"]), TROUBLES, strict=False)),
    full=list(product(FORMATS, TROUBLES)),
)
def test_soon_behind_any_trouble_all_is_right(what: tuple[str, str], seed: int) -> None:
    name, trouble = what
    assert seconds_until_right(FORMATS[name], trouble, seed) <= LONGEST_S
