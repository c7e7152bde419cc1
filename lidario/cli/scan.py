"""``lidario scan``: scans on stdout, for people or for programs.

People get one line per scan and, after the last one, a picture of the room. The device is stopped before the
picture is drawn, since drawing is slow.

``-n 0`` asks for an endless stream. Ctrl-C (or SIGTERM) is its normal end: a summary is printed, and the exit code
is 0. Where a number of scans was asked for, an interruption before the last one ends the command with 130.
"""

from __future__ import annotations

import sys
import time
from contextlib import ExitStack
from dataclasses import dataclass, field
from functools import partial

import click

import lidario
from lidario.cli.errors import Stopped
from lidario.cli.output import Worker, console, introduced, progress, rendered
from lidario.cli.parameters import WholeRange, guard_option, mode_option, reconnect_option, source_argument
from lidario.cli.running import run
from lidario.cli.settings import config_option, settings_of_file
from lidario.cli.streams import emit, message
from lidario.words import counted


@dataclass
class _Tally:
    """What was read so far; an interrupted command needs it, too."""

    lidar: lidario.Lidar | None = None
    last: lidario.Scan | None = None
    count: int = 0
    began: float = field(default_factory=time.monotonic)


@click.command()
@source_argument
@click.option("-n", "count", default=1, show_default=True, type=WholeRange(min=0), metavar="N",
              help="How many scans; 0: until Ctrl-C.")  # fmt: skip
@config_option
@mode_option
@click.option("--json", "as_json", is_flag=True, help="One JSON object per line and scan.")
@click.option("--csv", "as_csv", is_flag=True, help="One row per sample.")
@click.option("--keep-spinning", is_flag=True, help="Leave the motor on; only the measuring stops.")
@reconnect_option
@guard_option
def scan(
    source: str,
    count: int,
    mode: str | int | None,
    as_json: bool,
    as_csv: bool,
    keep_spinning: bool,
    reconnect: bool,
    guard: bool,
) -> None:
    """Read scans and print them.

    Angles are radians counter-clockwise from forward, ranges metres; null (JSON) or an empty field (CSV) where
    there was no return. At the end laser and motor are off, unless --keep-spinning is given.
    """
    if as_json and as_csv:
        raise click.UsageError("--json and --csv exclude each other")
    from lidario.cli import formats

    for_people, header, as_text = not (as_json or as_csv), formats.ROW_HEADER, formats.as_row
    if as_json:
        header, as_text = "", formats.as_json
    elif as_csv:
        header, as_text = formats.CSV_HEADER, formats.as_csv
    config, tally, writer = settings_of_file(), _Tally(), Worker("lidario: stdout")
    failure: Exception | None = None

    async def work() -> None:
        opening = lidario.open_lidar(
            source, keep_spinning=keep_spinning, reconnect=reconnect, guard=guard, config=config
        )
        with ExitStack() as waiting:
            waiting.enter_context(progress(f"waiting for {source if source != 'auto' else 'the first scan'} …"))
            async with opening as lidar:
                tally.lidar, tally.began = lidar, time.monotonic()
                async with lidar.scans(mode) as stream:
                    async for scan in stream:
                        if not tally.count:
                            waiting.close()
                            if for_people:
                                about = introduced(lidar.info.model, lidar.info.serial)
                                message(f"{about}, mode {scan.mode}")
                            await writer.call(partial(emit, header))
                        await writer.call(partial(emit, as_text(scan)))
                        tally.last, tally.count = scan, tally.count + 1
                        if tally.count == count:
                            return
                    if not tally.count:
                        raise lidario.RecordingError(f"{source} holds no full revolution")

    try:
        run(work)
    except Stopped as stopped:
        failure = stopped if count else None
    except lidario.LidarError as error:
        failure = error
    finally:
        taken = writer.close()
    if tally.last is not None:
        if for_people and failure is None and taken:
            from lidario.cli.picture import picture

            target = console()
            emit("\n" + rendered(target, picture(tally.last, target)))
        if count != 1:
            _sum_up(tally)
    if failure is not None:
        raise failure


def _sum_up(tally: _Tally) -> None:
    """On stderr, since stdout may hold data."""
    assert tally.lidar is not None
    stats = tally.lidar.stats
    took = time.monotonic() - tally.began
    if sys.stderr.isatty():
        message("")  # the terminal has just echoed ^C
    message(
        f"{counted(tally.count, 'scan')} in {took:.1f} s; {counted(stats.lost_packets, 'packet')} lost, "
        f"{counted(stats.skipped_bytes, 'byte')} skipped, {counted(stats.dropped_scans, 'scan')} dropped"
        + (f", {counted(stats.reconnects, 'reconnect')}" if stats.reconnects else "")
    )
