"""``lidario scan``: scans on stdout, for people or for programs.

People get one line per scan and, after the last one, a picture of the room. The device is stopped before the
picture is drawn, since drawing is slow.

``-n 0`` asks for an endless stream. Ctrl-C (or SIGTERM) is its normal end: a summary is printed, and the exit code
is 0. Where a number of scans was asked for, an interruption before the last one ends the command with 130.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass, field
from functools import partial

import click

import lidario
from lidario.basics.words import counted
from lidario.cli.errors import Stopped
from lidario.cli.output import Worker, console, introduced, progress, rendered
from lidario.cli.parameters import WholeRange, guard_option, mode_option, reconnect_option, source_argument
from lidario.cli.running import run
from lidario.cli.settings import config_option, settings_of_file
from lidario.cli.streams import emit, message


@dataclass
class _Reading:
    """Reads scans and writes them, and knows how far it is: an interrupted command tells that, too."""

    for_people: bool
    header: str  # what stands before the first one
    as_text: Callable[[lidario.Scan], str]
    writer: Worker = field(default_factory=lambda: Worker("lidario: stdout"))
    lidar: lidario.Lidar | None = None
    last: lidario.Scan | None = None
    count: int = 0
    began: float = field(default_factory=time.monotonic)

    async def read(
        self, lidar: lidario.Lidar, mode: str | int | None, count: int, begun: Callable[[], None]
    ) -> None:
        """Read and write so many scans, 0 for all that come; calls `begun` before the first one."""
        self.lidar, self.began = lidar, time.monotonic()
        async with lidar.scans(mode) as stream:
            async for scan in stream:
                if self.last is None:
                    begun()
                    if self.for_people:
                        message(f"{introduced(lidar.info.model, lidar.info.serial)}, mode {scan.mode}")
                    await self.writer.call(partial(emit, self.header))
                await self.writer.call(partial(emit, self.as_text(scan)))
                self.last, self.count = scan, self.count + 1
                if self.count == count:
                    return
        if self.last is None:
            raise lidario.RecordingError(f"{lidar.source} holds no full revolution")

    def sum_up(self) -> None:
        """On stderr, since stdout may hold data."""
        assert self.lidar is not None
        stats = self.lidar.stats
        took = time.monotonic() - self.began
        if sys.stderr.isatty():
            message("")  # the terminal has just echoed ^C
        message(
            f"{counted(self.count, 'scan')} in {took:.1f} s; {counted(stats.lost_packets, 'packet')} lost, "
            f"{counted(stats.skipped_bytes, 'byte')} skipped, {counted(stats.dropped_scans, 'scan')} dropped"
            + (f", {counted(stats.reconnects, 'reconnect')}" if stats.reconnects else "")
        )


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

    config = settings_of_file()
    if as_json:
        reading = _Reading(False, "", formats.as_json)
    elif as_csv:
        reading = _Reading(False, formats.CSV_HEADER, formats.as_csv)
    else:
        reading = _Reading(True, formats.ROW_HEADER, formats.as_row)
    failure: Exception | None = None

    async def work() -> None:
        opening = lidario.open_lidar(
            source, keep_spinning=keep_spinning, reconnect=reconnect, guard=guard, config=config
        )
        with ExitStack() as waiting:
            waiting.enter_context(progress(f"waiting for {source if source != 'auto' else 'the first scan'} …"))
            async with opening as lidar:
                await reading.read(lidar, mode, count, waiting.close)

    try:
        run(work)
    except Stopped as stopped:
        failure = stopped if count else None
    except lidario.LidarError as error:
        failure = error
    finally:
        taken = reading.writer.close()
    if reading.last is not None:
        if reading.for_people and failure is None and taken:
            from lidario.cli.picture import picture

            target = console()
            emit("\n" + rendered(target, picture(reading.last, target)))
        if count != 1:
            reading.sum_up()
    if failure is not None:
        raise failure
