"""The options of the LaserScan messages that a verb publishes or writes: the same ones in each."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, Final, TypeVar

import click

import lidario
from lidario.cli.parameters import WholeRange

_Command = TypeVar("_Command", bound=Callable[..., Any])

FRAME: Final = "laser"
_OPTIONS = (
    click.option("--frame", metavar="NAME", help=f"Coordinate frame.  [that of the settings, else {FRAME}]"),
    click.option("--beams", type=WholeRange(1, 65536), metavar="N",
                 help="Beams of each scan.  [as many as a revolution has samples]"),
    click.option("--order", default="counter-clockwise", show_default=True,
                 type=click.Choice(["counter-clockwise", "measured"]),
                 help="Order of the beams; measured for readers that expect time to rise (cartographer)."),
    click.option("--preset", default="rep103", show_default=True, type=click.Choice(["rep103", "vendor"]),
                 help="Where the angle 0 is: ahead, or behind as with the vendors' drivers."),
    click.option("--mount-yaw", default=0.0, metavar="DEGREES",
                 help="Direction of the lidar in its frame, counter-clockwise."),
    click.option("--filtered", default="nan", show_default=True, type=click.Choice(["nan", "inf", "zero"]),
                 help="What a beam is that the filters of the settings took out; inf: the way is free there."),
)  # fmt: skip


def laserscan_options(command: _Command) -> _Command:
    """Give a verb these options."""
    for option in reversed(_OPTIONS):
        command = option(command)
    return command


def arguments_of(options: dict[str, Any], frame: str | None) -> dict[str, Any]:
    """The options as `LaserScans` takes them, others among them as they are; `frame` is what the settings say."""
    made = dict(options)
    named = made.pop("frame")
    made["frame_id"] = (frame or FRAME) if named is None else named
    made["mount_yaw"] = math.radians(made["mount_yaw"])
    return made


def laserscans_of(options: dict[str, Any], frame: str | None = None) -> lidario.LaserScans:
    """How the messages are made by these options and the `frame` of the settings."""
    return lidario.LaserScans(**arguments_of(options, frame))
