"""``lidario plot``: scans as a picture in a file, fit for a report.

SVG needs nothing. PNG is drawn by matplotlib, where that is installed.
"""

from __future__ import annotations

import io
import os
import time
from importlib import import_module
from pathlib import Path
from typing import Any

import click

import lidario
from lidario.cli.errors import need
from lidario.cli.parameters import WholeRange, as_file, force_option, mode_option, source_argument
from lidario.cli.running import run
from lidario.cli.settings import config_option, settings_of_file
from lidario.cli.streams import emit, message

_YEAR_0 = 1970


@click.command()
@source_argument
@click.option("-o", "--output", type=as_file(".svg", ".png"), default="scan.svg", show_default=True,
              metavar="FILE", help="Where to: a name that ends with .svg or .png.")  # fmt: skip
@click.option("-n", "count", default=1, show_default=True, type=WholeRange(1, 100), metavar="N",
              help="How many scans, one drawn over the other.")  # fmt: skip
@click.option("--polar", is_flag=True, help="On rings and rays instead of a grid.")
@force_option
@config_option
@mode_option
def plot(source: str, output: str, count: int, polar: bool, force: bool, mode: str | int | None) -> None:
    """Draw scans into a file, to scale: forward is up.

    The name of the file is printed.
    """
    from lidario.cli.chart import svg
    from lidario.recording.export import must_be_writable, write_whole

    path = Path(output)
    must_be_writable(path, overwrite=force)
    is_png = output.casefold().endswith(".png")
    if is_png:
        need("matplotlib", "a PNG", otherwise=", or write an .svg")
    settings = settings_of_file()
    info, scans = run(lambda: _read(source, count, mode, settings), f"waiting for {source} …")
    if not scans:
        raise lidario.RecordingError(f"{source} holds no full revolution")
    title = _title(info, scans)
    drawn = _png(scans, title, polar) if is_png else svg(scans, title, polar=polar).encode()
    with write_whole(path, overwrite=force) as part:
        part.write_bytes(drawn)
    emit(f"{path}\n")
    if not any(scan.valid.any() for scan in scans):
        message("there is nothing on it: no returns in any direction")


async def _read(
    source: str, count: int, mode: str | int | None, config: lidario.Config
) -> tuple[lidario.DeviceInfo, list[lidario.Scan]]:
    async with lidario.open_lidar(source, config=config) as lidar:
        return lidar.info, await scans_of(lidar, count, mode)


async def scans_of(lidar: lidario.Lidar, count: int, mode: str | int | None = None) -> list[lidario.Scan]:
    """So many scans of a lidar; of a recording at most so many."""
    found: list[lidario.Scan] = []
    async with lidar.scans(mode, depth=count) as scans:
        async for scan in scans:
            found.append(scan)
            if len(found) == count:
                break
    return found


def _title(info: lidario.DeviceInfo, scans: list[lidario.Scan]) -> str:
    device = f"{info.model} ({info.serial[:8]})" if info.serial else info.model
    what = f"{len(scans)} scans" if len(scans) > 1 else f"{len(scans[0])} samples"
    at = time.localtime(scans[0].wall_stamp_ns / 1e9)
    # Stamps of bare bytes count from 0.
    when = [time.strftime("%Y-%m-%d %H:%M:%S", at)] if at.tm_year > _YEAR_0 else []
    return ", ".join((device, scans[0].mode, what, *when))


def _png(scans: list[lidario.Scan], title: str, polar: bool) -> bytes:
    from lidario.cli.chart import COLOUR, legend_of, opacities, reach_of

    # Drawn into a file, never on a screen; and without it, matplotlib may look for one.
    os.environ.setdefault("MPLBACKEND", "Agg")
    plt = import_module("matplotlib.pyplot")
    reach = reach_of(scans, polar=polar)
    figure = plt.figure(figsize=(8, 8), dpi=150)
    axes: Any = figure.add_subplot(projection="polar" if polar else None)
    for scan, opacity in zip(scans, opacities(len(scans)), strict=True):
        seen, points = scan.valid, scan.xy()
        across, up = (scan.angles[seen], scan.ranges[seen]) if polar else (points[seen, 1], points[seen, 0])
        axes.plot(across, up, ".", markersize=2.5, color=COLOUR, alpha=opacity)
    if polar:
        axes.set_theta_zero_location("N")
        axes.set_ylim(0, reach)
    else:
        axes.plot(0, 0, "k^")
        axes.set(xlim=(reach, -reach), ylim=(-reach, reach), aspect="equal")
        axes.set(xlabel="y, to the left (m)", ylabel="x, forward (m)")
        axes.grid(color="#dddddd")
    axes.set_title(title)
    figure.text(0.99, 0.01, "\n".join(legend_of(scans, reach, polar=polar)), ha="right", va="bottom")
    file = io.BytesIO()
    figure.savefig(file, format="png")
    plt.close(figure)
    return file.getvalue()
