"""One error, raised in several tasks."""

from __future__ import annotations

import copy
from typing import TypeVar

from lidario.errors import LidarError

__all__ = ["twin_of"]

ErrorT = TypeVar("ErrorT", bound=LidarError)


def twin_of(error: ErrorT) -> ErrorT:
    """A copy of `error`, caused by it: each task that raises it gets a traceback of its own."""
    twin = copy.copy(error)
    twin.__cause__ = error
    return twin
