"""A second object that goes on from where the first one stands."""

from __future__ import annotations

from typing import TypeVar

_T = TypeVar("_T")


def copy_of(original: _T) -> _T:
    """As `copy.copy`, but much faster where it is done once a revolution; of an object without slots."""
    twin = object.__new__(type(original))
    vars(twin).update(vars(original))
    return twin
