"""The bytes of the floods: all may come from anybody who can reach the line."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

import numpy as np

from lidario.families.rplidar.simulated.packers import pack_dense, pack_standard

BLOB: Final = 256 * 1024
_FULL_Q6: Final = 360 << 6


def _endless() -> bytes:
    """Packets whose check value holds, of a revolution that never ends."""
    return pack_dense([_FULL_Q6 // 2], [[1000] * 40])


def _short() -> bytes:
    """Revolutions of two packets each."""
    return pack_dense([_FULL_Q6 // 3, _FULL_Q6 // 90], [[1000] * 40] * 2)


def _restarts() -> bytes:
    """Every packet says that the stream begins anew."""
    angles = np.random.default_rng(1).integers(0, _FULL_Q6, 64)
    return pack_dense(angles, [[1000] * 40] * 64, new_stream=True) + pack_dense([0], [[1] * 40], new_stream=True)


def _heads() -> bytes:
    """Noise in which a packet seems to begin at every second byte."""
    return b"\xa0\x50"


def _nodes() -> bytes:
    """Samples each of which begins a revolution."""
    return pack_standard([100.0, 200.0, 5.0], [1000.0] * 3, [10] * 3, [True] * 3)


def _random() -> bytes:
    """Noise."""
    return np.random.default_rng(1).bytes(BLOB)


FLOODS: Final[dict[str, Callable[[], bytes]]] = {
    "endless": _endless,
    "short": _short,
    "restarts": _restarts,
    "heads": _heads,
    "nodes": _nodes,
    "random": _random,
}
MODES: Final = {"nodes": "Standard"}
"""The scan mode in which it is tried, where it is not the usual one."""


def blob(kind: str, size: int = BLOB) -> bytes:
    """So many bytes of a flood, or a little less."""
    part = FLOODS[kind]()
    return part * max(1, size // len(part))
