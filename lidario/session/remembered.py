"""Which lidar was found last behind which USB adapter, so that it is tried first when its port is opened again.

An adapter is known by its name in ``/dev/serial/by-id``, which contains its serial number. Names such as
``/dev/ttyUSB0`` are given anew with each plugging in, so nothing is kept for them.

It is kept in the process, not in a file: a library does not write to a user's folders unasked, a file may be stale
or belong to another user, and what it would save is one round of listening, a second at most, once in a program.
"""

from __future__ import annotations

import os
from pathlib import Path
from typing import Final

__all__ = ["adapter_of", "last_at", "remember"]

BY_ID: Final = Path("/dev/serial/by-id")
_found: dict[str, tuple[str, int]] = {}


def adapter_of(path: str) -> str | None:
    """The lasting name of the adapter behind a port; None where it has none. Reads a folder: under 1 ms."""
    try:
        real = os.path.realpath(path)
        return next((link.name for link in BY_ID.iterdir() if os.path.realpath(link) == real), None)
    except OSError:
        return None


def last_at(adapter: str) -> tuple[str, int] | None:
    """Name of the family and speed of the lidar that was found last behind an adapter."""
    return _found.get(adapter)


def remember(adapter: str, family: str, baudrate: int) -> None:
    """A lidar of that family was found behind an adapter at that speed."""
    _found[adapter] = (family, baudrate)
