"""What filters look like on the page."""

from __future__ import annotations

from collections.abc import Sequence

from lidario.filters import AngularBoundsFilter, BoxFilter

__all__ = ["shapes_of"]


def shapes_of(filters: Sequence[object]) -> list[list[float]]:
    """Among filters, the boxes (four sides, metres of the robot) and left-out sectors (two angles, radians)."""
    shapes: list[list[float]] = []
    for each in filters:
        if isinstance(each, BoxFilter) and not each.invert:
            shapes.append([each.min_x, each.max_x, each.min_y, each.max_y])
        elif isinstance(each, AngularBoundsFilter) and each.invert:
            shapes += [[begin, end] for begin, end in each.windows]
    return shapes
