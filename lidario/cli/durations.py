"""Durations as they are typed: ``10s``, ``500ms``, ``2m``, ``1h``."""

from __future__ import annotations

import re

import click

__all__ = ["Duration"]

_UNITS = {"ms": 1e-3, "s": 1.0, "m": 60.0, "min": 60.0, "h": 3600.0}
_FORM = re.compile(r"([0-9]+(?:\.[0-9]+)?)(ms|s|min|m|h)?", re.ASCII)


class Duration(click.ParamType[float]):
    """A click type that gives seconds; a number without a unit is seconds."""

    name = "duration"

    def convert(self, value: object, param: click.Parameter | None, ctx: click.Context | None) -> float:
        """As `click.ParamType.convert`."""
        if isinstance(value, int | float):
            return float(value)
        match = _FORM.fullmatch(str(value).strip())
        seconds = float(match[1]) * _UNITS[match[2] or "s"] if match else 0.0
        if not 0 < seconds < 1e9:
            self.fail(f"{value!r} is no duration such as 10s, 500ms, 2m or 1h", param, ctx)
        return seconds
