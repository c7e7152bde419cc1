"""Checks of what users set, the same in every family."""

from __future__ import annotations

from lidario.arguments import finite
from lidario.errors import InvalidValue

__all__ = ["frequency_within"]


def frequency_within(hertz: object, limits: tuple[float, float], whose: str) -> float:
    """The scan frequency in Hz, if the device takes it.

    Raises:
        InvalidValue: Not a finite number, or outside of the `limits` of the model `whose`.
    """
    lowest, highest = limits
    wanted = finite(hertz, "a scan frequency")
    if not lowest <= wanted <= highest:
        raise InvalidValue(f"{wanted:g} Hz is outside of the {whose}'s {lowest:g} to {highest:g} Hz")
    return wanted
