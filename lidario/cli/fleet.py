"""``lidario devices --zenoh``: every lidar that is alive anywhere on the network."""

from __future__ import annotations

from typing import TYPE_CHECKING

from lidario.cli.errors import ExitCode
from lidario.cli.output import console, dump, progress, rendered, table
from lidario.cli.streams import emit, message

if TYPE_CHECKING:
    from lidario.ros import RemoteLidar

__all__ = ["show_fleet"]


def show_fleet(router: str, *, as_json: bool) -> int:
    """Ask the router and print the result; returns the exit code, 3 where there is none."""
    from lidario.cli.running import run
    from lidario.ros import list_remote_lidars

    with progress("asking the network …"):
        found = run(lambda: list_remote_lidars(router))
    if as_json:
        dump([_record(each) for each in found])
    elif found:
        titles = ("source", "robot", "model", "serial number", "health", "scans/s")
        emit(rendered(console(), table(titles, map(_row, found), right=("scans/s",))))
    else:
        message(f"no lidar is published through {router}; `lidario publish --zenoh KEY` publishes one")
    return ExitCode.OK if found else ExitCode.NO_DEVICE


def _row(lidar: RemoteLidar) -> tuple[str, ...]:
    rate = f"{lidar.rate:.1f}" if lidar.health is not None else ""
    return lidar.source, lidar.robot, lidar.model, lidar.serial, _health(lidar), rate


def _health(lidar: RemoteLidar) -> str:
    if lidar.lost:
        return "away"
    return lidar.health.status.value if lidar.health is not None else ""


def _record(lidar: RemoteLidar) -> dict[str, object]:
    health = lidar.health
    return {
        "source": lidar.source,
        "form": lidar.form,
        "robot": lidar.robot,
        "model": lidar.model or None,
        "serial": lidar.serial or None,
        "health": None if health is None else health.status.value,
        "health_code": None if health is None else health.code,
        "scans_per_second": None if health is None else round(lidar.rate, 2),
        "lost": lidar.lost or None,
    }
