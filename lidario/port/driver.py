"""What the driver of a serial adapter tells of it: for how long it gathers bytes."""

from __future__ import annotations

import os
from pathlib import Path

__all__ = ["latency_ms"]

ROOT = Path("/")


def latency_ms(port: str, root: Path = ROOT) -> int | None:
    """For how many milliseconds the adapter of `port` gathers bytes; None where its driver has no such timer.

    Only Linux' driver of FTDI adapters has one. It tells 1 while low latency is set.

    Args:
        port: As in ``/dev/ttyUSB0``.
        root: The folder in which ``sys`` stands.
    """
    name = os.path.basename(os.path.realpath(port))
    try:
        told = (root / "sys/class/tty" / name / "device/latency_timer").read_text(encoding="ascii").strip()
    except (OSError, ValueError):
        return None
    return int(told) if told.isdecimal() else None
