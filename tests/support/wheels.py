"""Heads of packets, and what a model of the rotor tells of them, in few words."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lidario.families.spans import Arcs, Heads

TURN = 23040
"""A whole turn, in units of the headings."""


def heads(
    first: Sequence[int] | NDArray[Any], following: int | None, counts: int = 1, way: NDArray[Any] | None = None
) -> Heads:
    """Those of packets that begin at these angles."""
    told = None if way is None else way.astype(np.int32)
    return Heads(np.asarray(first, np.int32), following, counts, told)


def turning(*spans: int) -> tuple[NDArray[np.int32], int]:
    """Where packets stand from which the next one is so far ahead, and where the one behind them stands."""
    *first, following = np.cumsum([0, *spans]) % TURN
    return np.array(first, np.int32), int(following)


def missing(arcs: Arcs) -> list[int]:
    """How many samples are missing behind each packet; of packets of one sample, how many packets."""
    return [0] * len(arcs.arc) if arcs.skipped is None else arcs.skipped.tolist()


def lost(arcs: Arcs) -> int:
    """How many of them are missing altogether."""
    return sum(missing(arcs))
