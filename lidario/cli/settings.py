"""What every verb knows of the command line: whether errors show where they come from, and the file of settings.

The file is the one that ``--config`` names, else the one of the variable ``LIDARIO_CONFIG``, else ``lidario.toml``
of the current folder, where there is one; then a line on stderr says so. ``--config /dev/null`` takes none.
"""

from __future__ import annotations

import os
from dataclasses import dataclass
from typing import Final

import click

import lidario
from lidario.cli.streams import message

FILE: Final = "lidario.toml"
VARIABLE: Final = "LIDARIO_CONFIG"


@dataclass
class Settings:
    """Options of every verb."""

    traceback: bool = False
    config: str | None = None


def _take_config(context: click.Context, _: click.Parameter, value: str | None) -> None:
    if value is not None:
        context.ensure_object(Settings).config = value


config_option: Final = click.option(
    "--config",
    metavar="FILE",
    expose_value=False,
    callback=_take_config,
    help=f"Mounts, filters, speeds, modes and frames of lidars.  [{FILE}, if there is one]",
)


def config_file() -> str | None:
    """The file of settings of this command, None for none."""
    named = click.get_current_context().ensure_object(Settings).config or os.environ.get(VARIABLE)
    if named:
        return named
    if not os.path.isfile(FILE):
        return None
    message(f"settings of {FILE}")
    return FILE


def settings_of_file() -> lidario.Config:
    """What is in it; empty settings where there is none. Raises as `lidario.read_config`."""
    name = config_file()
    return lidario.Config() if name is None else lidario.read_config(name)
