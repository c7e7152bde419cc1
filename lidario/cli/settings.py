"""What a verb knows of the command line: how errors are shown, the file of settings, and what was given.

The file is the one that ``--config`` names, else the one of the variable ``LIDARIO_CONFIG``, else ``lidario.toml``
of the current folder, where there is one; then a line on stderr says so. ``--config /dev/null`` takes none.
"""

from __future__ import annotations

import os
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Final

import click
from click.core import ParameterSource

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
    "--config", metavar="FILE", expose_value=False, callback=_take_config,
    help=f"Mounts, filters, speeds, modes and frames of lidars.  [{FILE}, if there is one]",
)  # fmt: skip


def config_file() -> str | None:
    """The file of settings of this command, None for none."""
    said = click.get_current_context().ensure_object(Settings).config
    named = os.environ.get(VARIABLE) or None if said is None else said
    if named is not None or not os.path.isfile(FILE):
        return named
    message(f"settings of {FILE}")
    return FILE


def settings_of_file() -> lidario.Config:
    """What is in it; empty settings where there is none. Raises as `lidario.read_config`."""
    name = config_file()
    return lidario.Config() if name is None else lidario.read_config(name)


def is_given(name: str) -> bool:
    """Whether the user has given this option of the verb that runs."""
    return click.get_current_context().get_parameter_source(name) is ParameterSource.COMMANDLINE


def only_with(what: str, names: Iterable[str], is_so: bool) -> None:
    """Refuse options of these names where they were given and mean nothing, because `what` was not."""
    given = [name for name in names if is_given(name)]
    if given and not is_so:
        context = click.get_current_context()
        option = next(each for each in context.command.params if each.name == given[0])
        raise click.UsageError(f"{max(option.opts, key=len)} belongs to {what}", context)
