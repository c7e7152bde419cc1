"""``lidario devices --zenoh``: every lidar that is alive anywhere on the network."""

from __future__ import annotations

from typing import TYPE_CHECKING

from lidario.cli.errors import ExitCode
from lidario.cli.output import console, dump, progress, rendered
from lidario.cli.streams import emit, message

if TYPE_CHECKING:
    from rich.table import Table

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
        emit(rendered(console(), _table(found)))
    else:
        message(f"no lidar is published through {router}; `lidario publish --zenoh KEY` publishes one")
    return ExitCode.OK if found else ExitCode.NO_DEVICE


def _table(found: list[RemoteLidar]) -> Table:
    from rich import box
    from rich.table import Table

    table = Table(box=box.SIMPLE_HEAD, pad_edge=False, header_style="bold")
    # Never folded: it is to be copied.
    table.add_column("source", no_wrap=True)
    for title in ("robot", "model", "serial number", "health", "scans/s"):
        table.add_column(title, overflow="fold", justify="right" if title == "scans/s" else "left")
    for each in found:
        table.add_row(
            each.source,
            each.robot,
            each.model,
            each.serial,
            _health(each),
            f"{each.rate:.1f}" if each.health is not None else "",
        )
    return table


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
