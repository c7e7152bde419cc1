"""What the device tells of its field in response to ``PP``, which packets do not repeat.

Names are those of the SCIP 2.0 specification. What a device claims is bounded before it decides any size.
"""

from collections.abc import Mapping
from typing import Final, NamedTuple

MOST_STEP: Final = 9999  # the last step that four digits of a request can name
_MOST_MM: Final = 0x3FFFF  # the longest distance that three characters of six bits can tell
_LIMITS: Final = {
    "AMIN": (0, MOST_STEP),
    "AMAX": (0, MOST_STEP),
    "AFRT": (0, MOST_STEP),
    "ARES": (4, 16_384),
    "DMIN": (0, _MOST_MM),
    "DMAX": (1, _MOST_MM),
    "SCAN": (60, 60_000),
}


class Geometry(NamedTuple):
    """Where the device looks. A step is a direction; steps count counter-clockwise."""

    first: int  # the first step that it measures (AMIN)
    last: int  # the last one (AMAX)
    front: int  # the step straight ahead (AFRT)
    turn: int  # steps of 360 degrees (ARES)
    nearest: int  # shortest distance, mm (DMIN); numbers below it are codes of errors
    farthest: int  # longest distance, mm (DMAX)
    rpm: int  # revolutions a minute (SCAN)

    @property
    def steps(self) -> int:
        """Samples of a whole scan."""
        return self.last - self.first + 1

    @property
    def sample_us(self) -> float:
        """Microseconds from step to step."""
        return 60e6 / (self.rpm * self.turn)

    @property
    def text(self) -> str:
        """All of it, as `geometry_of` reads it again."""
        return ";".join(f"{name}:{value}" for name, value in zip(_LIMITS, self, strict=True))


def geometry_of(told: Mapping[str, str]) -> Geometry | None:
    """What the lines of a response tell, by their names; None where something is missing or cannot be."""
    values: list[int] = []
    for name, (least, most) in _LIMITS.items():
        word = told.get(name, "")
        if not (word.isascii() and word.isdigit() and len(word) <= 6 and least <= int(word) <= most):
            return None
        values.append(int(word))
    found = Geometry(*values)
    can_be = found.first <= found.last < found.first + found.turn and found.nearest < found.farthest
    return found if can_be else None
