"""The measurement streams of every family behind one record.

Whatever holds for one format is tested over all of them with the same code: a test takes a `Case`, one per
golden file, and learns from it how its stream is announced, cut, decoded, and what the truth is.
"""

from collections.abc import Sequence

import pytest

from tests.families.ydlidar.about import LAYOUTS
from tests.reference.samples import Sample
from tests.support.case import Case
from tests.support.families import ABOUT

__all__ = ["ALL", "CASES", "EVEN", "KINDS", "LAYOUTS", "Case", "Sample", "most_or_all", "named"]

ALL: tuple[Case, ...] = tuple(case for about in ABOUT.values() for case in about.CASES)
"""Every golden stream."""
CASES = tuple(case for case in ALL if case.name not in ABOUT[case.truth.family].OF_GOLDEN_ALONE)
"""Those of them that every property is tried on: the others would tell nothing more."""
EVEN = tuple(case for case in CASES if case.even)
"""Those whose samples each take the same time."""
KINDS = tuple(case for about in ABOUT.values() for name in about.KINDS for case in about.CASES if case.name == name)
"""One stream of each of the formats."""


def named(case: Case) -> str:
    """For `pytest.mark.parametrize(…, ids=named)`."""
    return case.name


def most_or_all(cases: Sequence[Case]) -> pytest.MarkDecorator:
    """Marks a test that takes a `case`: of each format the shortest, and with ``--exhaustive`` all of these."""
    shortest: dict[tuple[str, int], Case] = {}
    for case in sorted(cases, key=lambda case: len(case.raw)):
        shortest.setdefault((case.truth.family, case.response_type), case)
    return pytest.mark.exhaustive("case", sample=list(shortest.values()), full=cases)
