"""``lidario devices``: the ports of this machine and the lidars that respond on them, or those on the network.

Unless the user names ports, only those are asked whose USB adapter is a kind that lidars are sold with: an
unexpected byte can reset another device, such as an Arduino. The others are listed as not asked.
"""

from __future__ import annotations

import re

import click

import lidario
import lidario.ros
from lidario.cli.errors import ExitCode, exit_code_of
from lidario.cli.output import dump, emit_tables, table
from lidario.cli.publish import ROUTER
from lidario.cli.running import run
from lidario.cli.settings import only_with
from lidario.cli.streams import emit, message


@click.command()
@click.argument("ports", metavar="[PORT]...", nargs=-1)
@click.option("--json", "as_json", is_flag=True, help="A list for programs.")
@click.option("--zenoh", "network", is_flag=True, help="The lidars on the network, instead of the ports.")
@click.option("--router", default=ROUTER, show_default=True, metavar="ADDRESS",
              help="With --zenoh: a zenoh router.")  # fmt: skip
def devices(ports: tuple[str, ...], as_json: bool, network: bool, router: str) -> int:
    """List the ports and the lidars that respond on them.

    Ports that are named are asked, whatever adapter they have. Asking a device that scans stops it. The exit code
    is 3 when no lidar responds; where ports are named, the one that `lidario scan` ends with on the first of them.
    """
    from lidario.recording.files import file_source

    only_with("--zenoh", ("router",), network)
    for port in ports:
        if re.match("(sim|tcp|socket|udp|id|zenoh):", port) or file_source(port) is not None:
            raise click.UsageError(f"{port!r} is no port: `lidario info {port}` tells what it is")
    if network:
        if ports:
            raise click.UsageError("--zenoh asks no ports")
        return _show_fleet(router, as_json=as_json)
    return show(ports, as_json=as_json)


def show(ports: tuple[str, ...], *, as_json: bool, next_steps: bool = False) -> int:
    """Ask the ports and print the result; returns the exit code."""
    found = run(lambda: lidario.list_lidars(ports), "asking the ports …")
    asked = {each.port.path for each in found}
    others = [] if ports else [port for port in lidario.list_serial_ports() if port.path not in asked]
    responding = [each for each in found if each.info is not None]
    if as_json:
        dump([_record(each.port, each) for each in found] + [_record(port) for port in others])
    else:
        _print(found, others)
    if next_steps:
        _tell_next([each.port.path for each in responding])
    if responding:
        return ExitCode.OK
    reason = found[0].reason if ports else ""
    return exit_code_of(reason) if reason else ExitCode.NO_DEVICE


def _print(found: list[lidario.Found], others: list[lidario.PortInfo]) -> None:
    rows = [
        (each.port.path, each.info.model, each.info.serial, each.info.firmware,
         str(each.baudrate) if each.baudrate else "", each.port.adapter or each.port.description)
        for each in found
        if each.info is not None
    ]  # fmt: skip
    if rows:
        titles = ("port", "model", "serial number", "firmware", "baud", "adapter")
        emit_tables(table(titles, rows, right=("baud",)))
    elif not found:
        message("no lidar found: no port has an adapter that lidars are sold with. Is it plugged in?")
    for each in found:
        if each.info is None:
            # Most errors name the port already.
            error = each.error if each.port.path in each.error else f"{each.port.path}: {each.error}"
            emit(error.replace("\n", "\n    ") + "\n")
    if others:
        emit(f"not asked, because lidars are not sold with such an adapter: {', '.join(p.path for p in others)}\n")
        message(f"`lidario devices {others[0].path}` asks it anyway")


def _tell_next(responding: list[str]) -> None:
    """Write to stderr what a new user may want to type next."""
    from lidario.families.registry import FAMILIES

    if responding:
        source = "" if len(responding) == 1 else f" {responding[0]}"
        tips = [
            (f"lidario info{source}", "model, health and scan modes"),
            (f"lidario scan{source}", "a picture"),
            (f"lidario view{source}", "live in the browser"),
        ]
    else:
        model = FAMILIES[0].simulated[0]
        tips = [
            ("lidario doctor", "what may be wrong"),
            ("lidario devices PORT", "ask a port that was not asked"),
            (f"lidario scan sim://{model}", "without a lidar: a simulated one"),
            ("lidario sim", "a simulated one for another program"),
        ]
    tips.append(("lidario --help", "all commands"))
    width = max(len(command) for command, _ in tips)
    message("\nnext:")
    for command, purpose in tips:
        message(f"  {command:<{width}}   {purpose}")


def _record(port: lidario.PortInfo, found: lidario.Found | None = None) -> dict[str, object]:
    """A port that was asked, with what was found there, or one that was not."""
    names = ("family", "model", "model_id", "firmware", "hardware", "serial")
    return {
        "port": port.path,
        "by_id": port.by_id or None,
        "adapter": port.adapter or None,
        "description": port.description or None,
        "asked": found is not None,
        "baudrate": (found and found.baudrate) or None,
        **{name: found and found.info and getattr(found.info, name) for name in names},
        "error": (found and found.error) or None,
    }


def _show_fleet(router: str, *, as_json: bool) -> int:
    """Ask the router and print the result; returns the exit code, 3 where there is none."""
    found = run(lambda: lidario.ros.list_remote_lidars(router), "asking the network …")
    if as_json:
        dump([_record_of(each) for each in found])
    elif found:
        titles = ("source", "robot", "model", "serial number", "health", "scans/s")
        emit_tables(table(titles, map(_row_of, found), right=("scans/s",)))
    else:
        message(f"no lidar is published; `lidario publish --zenoh KEY --router {router}` publishes one")
    return ExitCode.OK if found else ExitCode.NO_DEVICE


def _row_of(lidar: lidario.ros.RemoteLidar) -> tuple[str, ...]:
    told, rate = ("", "") if lidar.health is None else (lidar.health.status.value, f"{lidar.rate:.1f}")
    return lidar.source, lidar.robot, lidar.model, lidar.serial, "away" if lidar.lost else told, rate


def _record_of(lidar: lidario.ros.RemoteLidar) -> dict[str, object]:
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
