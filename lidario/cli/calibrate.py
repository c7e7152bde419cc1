"""``lidario calibrate``: how two lidars of one robot are mounted to each other, by what both see of a room."""

from __future__ import annotations

import cmath
import math
from pathlib import Path
from typing import TYPE_CHECKING, Final

import click

import lidario
from lidario.cli.errors import need
from lidario.cli.output import progress
from lidario.cli.parameters import WholeRange, as_file, as_place, complete_source
from lidario.cli.plot import scans_of
from lidario.cli.running import run
from lidario.cli.settings import FILE, config_option, settings_of_file
from lidario.cli.streams import emit, message

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    Cloud = NDArray[np.float32]

LEAST_SHARE: Final = 0.5  # of two lidars on one robot, each sees at least half of what the other sees
RIVAL: Final = 0.85
"""Where another direction explains nearly as many points, the room looks alike from several sides; where a place
beside it does, nothing holds the result where it is."""
LOOSE: Final = (
    "the room does not hold B in its place: beside it the points fit nearly as well, as along a corridor, or "
    "around the middle of a round room. Put something into the room, or go where walls stand in several directions"
)
UPSIDE_DOWN: Final = (
    "mirrored, far more points of B lie on those of A: one hangs upside down, and a mount cannot say so. "
    "Turn it over, or place it in the robot description of ROS"
)
FARTHEST_RESIDUAL_M: Final = 0.05


@click.command()
@click.argument("first", metavar="A", shell_complete=complete_source)
@click.argument("second", metavar="B", shell_complete=complete_source)
@click.option("-n", "count", default=20, show_default=True, type=WholeRange(1, 1000), metavar="N",
              help="How many scans of each.")  # fmt: skip
@click.option("--guess", type=as_place, metavar="X,Y,YAW",
              help="About where B is, seen from A: metres forward, metres left, degrees counter-clockwise. Where "
                   "the room looks alike from several sides.")  # fmt: skip
@click.option("--picture", type=as_file(".svg"), metavar="FILE.svg",
              help="Draw both clouds as they lie on each other.")  # fmt: skip
@click.option("--dry-run", is_flag=True, help="Write nothing into the settings.")
@config_option
def calibrate(
    first: str, second: str, count: int, guess: lidario.Mount | None, picture: str | None, dry_run: bool
) -> None:
    """Find how two lidars are mounted to each other.

    Both see the same room. The robot must stand still. A stays where the settings say it is, or is the robot's
    origin; the mount of B is written into the settings, into lidario.toml where no file is named.
    """
    from lidario.cli.chart import COLOUR, clouds_svg
    from lidario.recording.export import must_be_writable, write_whole

    need("small_gicp", "it")
    config = settings_of_file()
    file = Path(config.path or FILE)
    if picture is not None:
        must_be_writable(Path(picture), overwrite=True)
    if not dry_run:
        need("tomlkit", "writing settings")
        must_be_writable(file, overwrite=True)
    (one, ahead), (two, behind) = run(
        lambda: _scans(first, second, count, config, told_apart=not dry_run), "reading both lidars …"
    )
    fixed, moving = _cloud(ahead), _cloud(behind)
    with progress("laying one on the other …"):
        found = lidario.register(fixed, moving, guess=guess)
    if picture is not None:
        title = f"{two.model} {two.serial[:8]} as {one.model} {one.serial[:8]} sees it"
        legend = f"grey: A. Blue: B, {1000 * found.residual:.1f} mm beside it"
        drawn = clouds_svg([(fixed, "#999999"), (_cloud(behind, found.mount), COLOUR)], title, legend)
        with write_whole(Path(picture), overwrite=True) as part:
            part.write_text(drawn, encoding="utf-8")
        message(f"picture: {picture}")
    if doubt := _doubt(fixed, moving, guess, found):
        raise lidario.LidarError(doubt)
    base = config.of(one.serial).mount or lidario.Mount()
    mount = _behind(base, found.mount)
    emit(
        f"x = {mount.x:.4f} m, y = {mount.y:.4f} m, yaw = {math.degrees(mount.yaw):.2f} degrees\n"
        f"residual {1000 * found.residual:.1f} mm, {100 * found.share:.0f} % of the points of B lie on those of A\n"
    )
    if not dry_run:
        lidario.save_config(file, one.serial, mount=base)
        lidario.save_config(file, two.serial, mount=mount)
        message(f"written into {file}")


async def _scans(
    first: str, second: str, count: int, config: lidario.Config, *, told_apart: bool
) -> list[tuple[lidario.DeviceInfo, list[lidario.Scan]]]:
    """What each lidar is and sees, one behind the other: their motors may share one supply."""
    async with lidario.open_lidar(first, config=config) as one, lidario.open_lidar(second, config=config) as two:
        serials = {lidar.info.serial.casefold() for lidar in (one, two)}
        if told_apart and ("" in serials or len(serials) < 2):
            raise lidario.InvalidValue(
                "the two lidars tell no serial numbers that differ, so the settings cannot tell them apart: "
                "--dry-run prints the figures, for --mount or for Mount() in your program"
            )
        return [(lidar.info, await scans_of(lidar, count)) for lidar in (one, two)]


def _cloud(scans: list[lidario.Scan], mount: lidario.Mount | None = None) -> Cloud:
    import numpy as np

    return np.concatenate([np.zeros((0, 2), np.float32), *(scan.points(mount).xy for scan in scans)])


def _doubt(fixed: Cloud, moving: Cloud, guess: lidario.Mount | None, found: lidario.Registration) -> str:
    """Why the result is not to be trusted; empty where it is."""
    # Seen from below, left is right: then a wrong place may be found that explains many points.
    upside_down = lidario.register(fixed, moving * (1.0, -1.0), guess=guess)
    if upside_down.share >= LEAST_SHARE and found.share < RIVAL * upside_down.share:
        return UPSIDE_DOWN
    if found.share < LEAST_SHARE or found.residual > FARTHEST_RESIDUAL_M:
        return (
            f"only {100 * found.share:.0f} % of the points of B lie on those of A: do both see the same room, and "
            "do they stand still? --guess says about where B is"
        )
    if found.rival > RIVAL * found.share:
        return (
            f"the room looks alike from several sides: another direction explains {100 * found.rival:.0f} % of the "
            f"points, and this one {100 * found.share:.0f} %. --guess says about where B is, or put something into "
            "the room"
        )
    return LOOSE if lidario.looseness(fixed, moving, found) > RIVAL else ""


def _behind(base: lidario.Mount, step: lidario.Mount) -> lidario.Mount:
    """The mount of B, where A is at `base` and B at `step` as seen from A."""
    place = complex(base.x, base.y) + complex(step.x, step.y) * cmath.rect(1.0, base.yaw)
    return lidario.Mount(place.real, place.imag, math.remainder(base.yaw + step.yaw, math.tau))
