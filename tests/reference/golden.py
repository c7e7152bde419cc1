"""Streams with the vendors' own decoding of them, from ``tests/data``; its README describes the arrays."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

DATA = Path(__file__).resolve().parent.parent / "data"
GRID_Q6 = 1 / 64
"""Degrees: the step of angles that are told in 64ths."""

NAMES = tuple(sorted(path.stem for path in DATA.glob("*.npz")))
"""All of them; each begins with the name of its family."""


def names_of(beginning: str) -> tuple[str, ...]:
    """Those that begin so, such as ``ydlidar_4ros``."""
    return tuple(name for name in NAMES if name.startswith(beginning + "_"))


@dataclass(frozen=True, slots=True, eq=False)
class Golden:
    """One stream and its samples; what a family does not have is None."""

    name: str
    family: str
    raw: bytes
    angle_deg: NDArray[np.float32]
    distance_mm: NDArray[np.float32]
    response_type: int | None = None  # where the name ends with it
    sample_us: float | None = None  # where the device tells or shows it
    quality: NDArray[np.generic] | None = None  # where the format carries one
    start: NDArray[np.bool_] | None = None  # where the vendor marks new turns
    scan: NDArray[np.int16] | None = None  # where the vendor numbers them


def load(name: str) -> Golden:
    """Load one of `NAMES`."""
    with np.load(DATA / f"{name}.npz") as arrays:
        family, _, kind = name.partition("_")
        return Golden(
            name,
            family,
            arrays["raw"].tobytes(),
            arrays["angle_deg"],
            arrays["distance_mm"],
            response_type=int(kind[-2:], 16) if "start" in arrays else None,
            sample_us=float(arrays["sample_us"]) if "sample_us" in arrays else None,
            quality=arrays.get("quality", arrays.get("intensity")),
            start=arrays.get("start"),
            scan=arrays.get("scan"),
        )
