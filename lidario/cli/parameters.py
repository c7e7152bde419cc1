"""What several verbs take: a source or a file, with their completion in the shell, and a duration."""

from __future__ import annotations

import re
from typing import Final

import click
from click.shell_completion import CompletionItem

__all__ = ["complete_file", "complete_source", "seconds_of"]

_UNITS: Final = {"ms": 1e-3, "s": 1.0, "": 1.0, "min": 60.0, "h": 3600.0}


def seconds_of(context: click.Context, parameter: click.Parameter, value: str) -> float:
    """The seconds that a duration means, such as ``10s``, ``500ms``, ``2min``, or plain seconds; for `callback`."""
    match = re.fullmatch(r"(\d{1,9}(?:\.\d*)?|\.\d+)\s*([a-z]*)", value.strip())
    seconds = float(match[1]) * _UNITS[match[2]] if match and match[2] in _UNITS else 0.0
    if not seconds > 0:
        raise click.BadParameter(
            f"{value!r} is not a duration above 0, such as 10s, 500ms or 2min", context, parameter
        )
    return seconds


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
