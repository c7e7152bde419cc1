"""Checks of what users hand to a device, the same in every family: nothing foreign leaves for a wrong argument."""

from __future__ import annotations

import math
from numbers import Real

from lidario.errors import InvalidValue

__all__ = ["finite", "frequency_within"]


def finite(value: object, what: str) -> float:
    """The value as a float, if it is a finite number; texts are not taken for numbers.

    Raises:
        InvalidValue: It is not; the message begins with `what`.
    """
    if not isinstance(value, Real):
        raise InvalidValue(f"{what} is a number, not {value!r}")
    try:
        number = float(value)
    except OverflowError:
        number = math.inf
    if not math.isfinite(number):
        raise InvalidValue(f"{what} is a finite number, not {value!r}")
    return number


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
