"""What several verbs take: sources, files, their completion in the shell, durations, numbers, modes, the guard."""

from __future__ import annotations

import math
import re
from typing import Any, Final

import click
from click.shell_completion import CompletionItem

__all__ = [
    "Duration",
    "FiniteRange",
    "Place",
    "Size",
    "TimeOrSize",
    "WholeRange",
    "complete_file",
    "complete_source",
    "guard_option",
    "mode_option",
]

_UNITS: Final = {"ms": 1e-3, "s": 1.0, "m": 60.0, "min": 60.0, "h": 3600.0}
_SIZE: Final = re.compile(r"([0-9]{1,9}(?:\.[0-9]{1,9})?)\s*([KMGT]B)", re.ASCII | re.IGNORECASE)
_MULTIPLES: Final = {"KB": 10**3, "MB": 10**6, "GB": 10**9, "TB": 10**12}
_MODE_DIGITS: Final = 9
_DURATION: Final = re.compile(r"([0-9]{1,9}(?:\.[0-9]*)?|\.[0-9]+)\s*(ms|s|min|m|h)?", re.ASCII)


class Duration(click.ParamType[float]):
    """A click type that gives seconds: ``10s``, ``500ms``, ``2m``, ``1h``; a number without a unit is seconds."""

    name = "duration"

    def convert(self, value: object, param: click.Parameter | None, ctx: click.Context | None) -> float:
        """What the text means; raises `click.BadParameter` where it means nothing."""
        if isinstance(value, int | float):
            return float(value)
        match = _DURATION.fullmatch(str(value).strip())
        seconds = float(match[1]) * _UNITS[match[2] or "s"] if match else 0.0
        if not 0 < seconds < 1e9:
            self.fail(f"{value!r} is not a duration above 0, such as 10s, 500ms or 2m", param, ctx)
        return seconds


class Size(click.ParamType[int]):
    """A click type that gives bytes: ``500MB``, ``1.5GB``; a thousand thousand bytes are one MB."""

    name = "size"

    def convert(self, value: object, param: click.Parameter | None, ctx: click.Context | None) -> int:
        """What the text means; raises `click.BadParameter` where it means nothing."""
        found = _size_in(str(value))
        if found is None:
            self.fail(f"{value!r} is not a size, such as 500MB or 20GB", param, ctx)
        return found


class TimeOrSize(click.ParamType["tuple[float | None, int | None]"]):
    """A click type that gives seconds or bytes, and None for the other: ``10min``, ``1GB``."""

    name = "time or size"

    def convert(
        self, value: Any, param: click.Parameter | None, ctx: click.Context | None
    ) -> tuple[float | None, int | None]:
        """What the text means; raises `click.BadParameter` where it means nothing."""
        size = _size_in(str(value))
        match = _DURATION.fullmatch(str(value).strip())
        if size is not None:
            return None, size
        if match is None or match[2] is None:
            self.fail(f"{value!r} is neither a time nor a size, such as 10min or 1GB", param, ctx)
        return float(match[1]) * _UNITS[match[2]], None


def _size_in(text: str) -> int | None:
    match = _SIZE.fullmatch(text.strip())
    return None if match is None else round(float(match[1]) * _MULTIPLES[match[2].upper()])


class Place(click.ParamType["tuple[float, float, float]"]):
    """A click type for a place and a direction: ``0.1,0,90``, metres and degrees."""

    name = "place"

    def convert(
        self, value: Any, param: click.Parameter | None, ctx: click.Context | None
    ) -> tuple[float, float, float]:
        """What the text means; raises `click.BadParameter` where it means nothing."""
        try:
            x, y, yaw = map(float, str(value).split(","))
        except ValueError:
            x = y = yaw = math.nan
        if not math.isfinite(x + y + yaw):
            self.fail(f"{value!r} is not x,y,yaw in metres and degrees, such as 0.1,0,90", param, ctx)
        return x, y, yaw


class WholeRange(click.IntRange):
    """As `click.IntRange`, whose errors speak of "a valid integer range"."""

    name = "whole number"


class FiniteRange(click.FloatRange):
    """As `click.FloatRange`, which takes ``nan`` for a number of every range."""

    name = "number"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> float:
        """What the text means; raises `click.BadParameter` where it means nothing."""
        number: float = super().convert(value, param, ctx)
        if not math.isfinite(number):
            self.fail(f"{value!r} is not a finite number", param, ctx)
        return number


def complete_source(context: click.Context, parameter: click.Parameter, incomplete: str) -> list[CompletionItem]:
    """The sources that begin with `incomplete`: ports that are there, simulated models, and ``auto``.

    Where there is none, it may be the beginning of a recording's name.
    """
    from lidario import list_serial_ports
    from lidario.families.registry import FAMILIES

    found = [CompletionItem("auto", help="the only lidar that responds")]
    found += [CompletionItem(port.path, help=port.description) for port in list_serial_ports()]
    found += [CompletionItem(f"sim://{name}", help="simulated") for each in FAMILIES for name in each.simulated]
    fitting = [item for item in found if str(item.value).startswith(incomplete)]
    return fitting or complete_file(context, parameter, incomplete)


def complete_file(_: click.Context, __: click.Parameter, incomplete: str) -> list[CompletionItem]:
    """Has the shell complete the name of a file."""
    return [CompletionItem(incomplete, type="file")]


class _ModeType(click.ParamType["str | int"]):
    """A click type that gives the name of a scan mode, or its id where it is written in digits."""

    name = "mode"

    def convert(
        self,
        value: Any,
        param: click.Parameter | None,  # noqa: ARG002
        ctx: click.Context | None,  # noqa: ARG002
    ) -> str | int:
        text = str(value)
        return int(text) if text.isascii() and text.isdigit() and len(text) <= _MODE_DIGITS else text


mode_option: Final = click.option(
    "--mode", type=_ModeType(), metavar="MODE", help="Scan mode by name or id, as `lidario info` lists them."
)
guard_option: Final = click.option(
    "--guard", is_flag=True, help="Have laser and motor switched off also when this command is killed (kill -9)."
)
