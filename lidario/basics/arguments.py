"""Checks of what users hand over, the same everywhere: a wrong argument raises `InvalidValue`, and nothing else.

Each returns the value, and takes what it is called: with that the message of the error begins.

A session lives long, and its streams start in other tasks than the one that asked. So an argument is checked where
it is given: there the traceback shows the line that is wrong. Numbers of numpy are taken as those of Python; texts
are not taken for numbers.
"""

import math
import operator
import os
import reprlib
from collections.abc import Callable
from contextlib import suppress
from numbers import Real
from pathlib import Path

from lidario.errors import InvalidValue

MODERATE = 1e6
"""More than metres, radians and seconds are; the products of such numbers are finite, also in single precision."""
_MOST_PARTS = 72
"""Sectors of 5 degrees: the narrowest packet of any format is not much narrower."""
_MOST_SHOWN = 80
_MOST_NS = 1 << 62
_short = reprlib.Repr()
_short.maxstring = _short.maxother = _short.maxlong = _MOST_SHOWN


def shown(value: object) -> str:
    """A value as an error text shows it: not all of it where that is long."""
    try:
        return _short.repr(value)
    except ValueError:  # a number of so many digits that Python refuses to write it down
        return f"a very long {type(value).__name__}"


def printable(text: object, most: int | None = None) -> str:
    """What a device, a file or a network says, at `most` so many letters, without what could control a terminal."""
    return "".join(each for each in str(text)[:most] if each.isprintable())


def number(value: object, what: str) -> float:
    """The value as a float, if it is a number; it may be infinite."""
    result = _as_float(value, what)
    if math.isnan(result):
        raise InvalidValue(f"{what} is a number, not {shown(value)}")
    return result


def finite(value: object, what: str) -> float:
    """The value as a float, if it is a finite number."""
    result = _as_float(value, what)
    if not math.isfinite(result):
        raise InvalidValue(f"{what} is a finite number, not {shown(value)}")
    return result


def moderate(value: object, what: str) -> float:
    """The value as a float, if it is a number that can be meant: `MODERATE` at most, whatever its sign."""
    result = finite(value, what)
    if abs(result) > MODERATE:
        raise InvalidValue(f"{what} is a number, at most {MODERATE:g} away from 0, not {shown(value)}")
    return result


def _as_float(value: object, what: str) -> float:
    # True is 1 for Python; given for a number, it is a mistake.
    if isinstance(value, bool) or not isinstance(value, Real):
        raise InvalidValue(f"{what} is a number, not {shown(value)}")
    try:
        return float(value)
    except OverflowError:
        # A whole number that is larger than every float.
        return math.inf if operator.gt(value, 0) else -math.inf


def whole(value: object, what: str) -> int:
    """The value as an int, if it is a whole number."""
    with suppress(TypeError):
        if not isinstance(value, bool):
            return operator.index(value)  # type: ignore[arg-type]
    raise InvalidValue(f"{what} is a whole number, not {shown(value)}")


def nanoseconds(value: object, what: str) -> int:
    """The value as an int, if it is a number of nanoseconds that clocks count; sums of two fit in 64 bits."""
    result = whole(value, what)
    if abs(result) > _MOST_NS:
        raise InvalidValue(f"{what} is a time in nanoseconds, of some decades at most, not {shown(value)}")
    return result


def parts_of(degrees: object) -> int:
    """How many sectors of that size a revolution has, if it has a whole number of them and they have 5 degrees."""
    try:
        parts = 360.0 / finite(degrees, "the size of a sector")
        count = round(parts)
    except (ValueError, ZeroDivisionError, OverflowError):
        count, parts = 0, math.nan
    if not 1 <= count <= _MOST_PARTS or not math.isclose(parts, count, rel_tol=1e-6):
        raise InvalidValue(
            f"a sector has at least {360 // _MOST_PARTS} degrees, and 360 is a multiple of it; "
            f"not so {shown(degrees)}"
        )
    return count


def yes_or_no(value: object, what: str) -> bool:
    """Whether the value is as good as true; a text, such as "no", and an array are neither true nor false.

    Nor is a number that is neither 1 nor 0: it was meant as seconds or degrees, and would be lost.
    """
    with suppress(TypeError, ValueError):
        if not isinstance(value, str) and not (isinstance(value, Real) and value not in (0, 1)):
            return bool(value)
    raise InvalidValue(f"{what} is True or False, not {shown(value)}")


def text_of(value: object, what: str) -> str:
    """The value, if it is a text."""
    if not isinstance(value, str):
        raise InvalidValue(f"{what} is a text, not {shown(value)}")
    return value


def callable_of(value: object, what: str) -> Callable[..., object]:
    """The value, if it can be called."""
    if not callable(value):
        raise InvalidValue(f"{what} is a function, not {shown(value)}")
    return value


def path_of(value: object, what: str) -> Path:
    """The value as a path that a file may have."""
    try:
        name = os.fspath(value)  # type: ignore[call-overload]
        if isinstance(name, str) and "\0" not in name and os.fsencode(name):
            return Path(name)
    except (TypeError, UnicodeError):
        pass
    raise InvalidValue(f"{what} is the name of a file, not {shown(value)}")
