"""Streams with the vendors' own decoding of them, from ``tests/data``; its README describes the arrays."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

DATA = Path(__file__).resolve().parent.parent / "data"
GRID_Q6 = 1 / 64
"""Degrees: the step of angles that are told in 64ths."""

RPLIDAR_NAMES = (
    *(f"rplidar_{rate}_{response_type:x}" for rate in ("32k", "9k") for response_type in range(0x81, 0x87)),
    *("rplidar_a1_82", "rplidar_a1_84"),
)
YDLIDAR_NAMES = ("ydlidar_4ros_room10", "ydlidar_4ros_room7", "ydlidar_4ros_wrap")
RELATIVE_NAMES = (
    "ydlidar_x4_11hz",
    "ydlidar_g6_12hz",
    "ydlidar_g2_11hz",
    "ydlidar_tmini_10hz",
    "ydlidar_tg15_12hz",
)
LDROBOT_NAMES = (
    "ldrobot_ld19_6hz",
    "ldrobot_ld19_13hz",
    "ldrobot_stl27l_6hz",
    "ldrobot_stl27l_13hz",
    "ldrobot_ld14p_6hz",
    "ldrobot_ld08_5hz",
)
NAMES = RPLIDAR_NAMES + YDLIDAR_NAMES + RELATIVE_NAMES + LDROBOT_NAMES


@dataclass(frozen=True, slots=True, eq=False)
class Golden:
    """One stream and its samples; what a family does not have is None."""

    name: str
    family: Literal["rplidar", "ydlidar", "ldrobot"]
    raw: bytes
    angle_deg: NDArray[np.float32]
    distance_mm: NDArray[np.float32]
    response_type: int | None = None  # RPLIDAR
    sample_us: float | None = None  # not 4ROS
    quality: NDArray[np.generic] | None = None  # where the format carries one
    start: NDArray[np.bool_] | None = None  # RPLIDAR
    scan: NDArray[np.int16] | None = None  # YDLIDAR, LDROBOT


def load(name: str) -> Golden:
    """Load one of `NAMES`."""
    with np.load(DATA / f"{name}.npz") as arrays:
        raw = arrays["raw"].tobytes()
        angle_deg = arrays["angle_deg"]
        distance_mm = arrays["distance_mm"]
        if name in YDLIDAR_NAMES:
            return Golden(name, "ydlidar", raw, angle_deg, distance_mm, scan=arrays["scan"])
        if name in LDROBOT_NAMES + RELATIVE_NAMES:
            return Golden(
                name,
                "ldrobot" if name in LDROBOT_NAMES else "ydlidar",
                raw,
                angle_deg,
                distance_mm,
                sample_us=float(arrays["sample_us"]),
                quality=arrays.get("intensity"),
                scan=arrays["scan"],
            )
        return Golden(
            name,
            "rplidar",
            raw,
            angle_deg,
            distance_mm,
            response_type=int(name[-2:], 16),
            sample_us=float(arrays["sample_us"]),
            quality=arrays["quality"],
            start=arrays["start"],
        )


def angle_errors(stream: Golden, angles: Sequence[float]) -> NDArray[np.float64]:
    """How far the vendor's angles lie past ours, the short way round."""
    difference = stream.angle_deg.astype(np.float64) - np.array(angles)
    shortest: NDArray[np.float64] = (difference + 180.0) % 360.0 - 180.0
    return shortest
