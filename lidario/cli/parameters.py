"""What several verbs take: sources, files, their completion in the shell, durations, numbers, modes, the guard.

The functions `as_…` are types of options: each raises `click.BadParameter` where what was typed means nothing.
"""

from __future__ import annotations

import math
import os
import re
from collections.abc import Callable
from datetime import datetime
from pathlib import Path
from typing import Any, Final

import click
from click.shell_completion import CompletionItem

import lidario
from lidario.basics.system import cause_of

_UNITS: Final = {"ms": 1e-3, "s": 1.0, "m": 60.0, "min": 60.0, "h": 3600.0}
_SIZE: Final = re.compile(r"([0-9]{1,9}(?:\.[0-9]{1,9})?)\s*([KMGT]B)", re.ASCII | re.IGNORECASE)
_MULTIPLES: Final = {"KB": 10**3, "MB": 10**6, "GB": 10**9, "TB": 10**12}
_MODE_DIGITS: Final = 9
_DURATION: Final = re.compile(r"([0-9]{1,9}(?:\.[0-9]*)?|\.[0-9]+)\s*(ms|s|min|m|h)?", re.ASCII)


def as_duration(text: str) -> float:
    """Seconds: ``10s``, ``500ms``, ``2m``, ``1h``; a number without a unit is seconds."""
    match = _DURATION.fullmatch(text.strip())
    seconds = float(match[1]) * _UNITS[match[2] or "s"] if match else 0.0
    if not 0 < seconds < 1e9:
        raise click.BadParameter(f"{text!r} is not a duration above 0, such as 10s, 500ms or 2m")
    return seconds


def as_size(text: str) -> int:
    """Bytes: ``500MB``, ``1.5GB``; a thousand thousand bytes are one MB."""
    match = _SIZE.fullmatch(text.strip())
    if match is None:
        raise click.BadParameter(f"{text!r} is not a size, such as 500MB or 20GB")
    return round(float(match[1]) * _MULTIPLES[match[2].upper()])


def as_time_or_size(text: str) -> tuple[float | None, int | None]:
    """Seconds or bytes, and None for the other: ``10min``, ``1GB``."""
    if _SIZE.fullmatch(text.strip()):
        return None, as_size(text)
    match = _DURATION.fullmatch(text.strip())
    if match is None or match[2] is None:
        raise click.BadParameter(f"{text!r} is neither a time nor a size, such as 10min or 1GB")
    return float(match[1]) * _UNITS[match[2]], None


def as_place(text: str) -> lidario.Mount:
    """A place and a direction: ``0.1,0,90``, metres and degrees."""
    try:
        x, y, yaw = map(float, text.split(","))
    except ValueError:
        x = y = yaw = math.nan
    if not math.isfinite(x + y + yaw):
        raise click.BadParameter(f"{text!r} is not x,y,yaw in metres and degrees, such as 0.1,0,90")
    return lidario.Mount(x, y, math.radians(math.fmod(yaw, 360.0)))


def as_mode(text: str) -> str | int:
    """The name of a scan mode, or its id where it is written in digits."""
    return int(text) if text.isascii() and text.isdigit() and len(text) <= _MODE_DIGITS else text


def as_file(*endings: str) -> Callable[[str], str]:
    """The name of a file that ends in one of these: by it the kind of the file is told."""

    def as_file_of_kind(text: str) -> str:
        if not text.casefold().endswith(endings):
            raise click.BadParameter(f"{text!r} does not end in {', '.join(endings)}")
        return text

    return as_file_of_kind


def as_folder(text: str) -> Path:
    """A folder in which a file can be made, whatever its rights say."""
    from tempfile import TemporaryFile

    try:
        os.stat(text)  # the empty text is none
        TemporaryFile(dir=text).close()
    except OSError as error:
        raise click.BadParameter(f"no file can be made in {text!r}: {cause_of(error)}") from None
    return Path(text)


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


def named_by_time(what: str) -> str:
    """The name of a recording that the user has given none: two programs may begin in one second."""
    return datetime.now().strftime(f"{what}-%Y%m%d-%H%M%S-%f.mcap")


def complete_source(context: click.Context, parameter: click.Parameter, incomplete: str) -> list[CompletionItem]:
    """The sources that begin with `incomplete`: ports that are there, simulated models, and ``auto``.

    Where there is none, it may be the beginning of a recording's name.
    """
    from lidario.families.registry import FAMILIES

    found = [CompletionItem("auto", help="the only lidar that responds")]
    found += [CompletionItem(port.path, help=port.description) for port in lidario.list_serial_ports()]
    found += [CompletionItem(f"sim://{name}", help="simulated") for each in FAMILIES for name in each.simulated]
    fitting = [item for item in found if str(item.value).startswith(incomplete)]
    return fitting or complete_file(context, parameter, incomplete)


def complete_file(_: click.Context, __: click.Parameter, incomplete: str) -> list[CompletionItem]:
    """Has the shell complete the name of a file."""
    return [CompletionItem(incomplete, type="file")]


source_argument: Final = click.argument("source", default="auto", shell_complete=complete_source)
sources_argument: Final = click.argument("sources", metavar="[SOURCE]...", nargs=-1, shell_complete=complete_source)
recording_option: Final = click.option(
    "-o", "--output", type=as_file(".mcap"), metavar="FILE",
    help="The file to make; named after the time where not given.",
)  # fmt: skip
json_option: Final = click.option("--json", "as_json", is_flag=True, help="One object for programs.")
force_option: Final = click.option("--force", is_flag=True, help="Replace a file that is there already.")
reconnect_option: Final = click.option(
    "--reconnect", is_flag=True, help="Go on when the lidar was unplugged or restarted, and is back."
)
mode_option: Final = click.option(
    "--mode", type=as_mode, metavar="MODE", help="Scan mode by name or id, as `lidario info` lists them."
)
guard_option: Final = click.option(
    "--guard", is_flag=True, help="Have laser and motor switched off also when this command is killed (kill -9)."
)
