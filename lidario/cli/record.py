"""``lidario record``: every byte of a session in an MCAP file.

It ends after the time or the number of scans that was asked for, or with Ctrl-C, and in each case the file is
complete. Its name is the only line on stdout.
"""

from __future__ import annotations

import asyncio
import logging
import time
from pathlib import Path
from typing import Any

import click

import lidario
from lidario.basics.words import counted
from lidario.cli.errors import Stopped
from lidario.cli.laserscans import laserscan_options, laserscans_of
from lidario.cli.output import progress
from lidario.cli.parameters import (
    WholeRange,
    as_duration,
    as_size,
    as_time_or_size,
    force_option,
    guard_option,
    mode_option,
    named_by_time,
    reconnect_option,
    recording_option,
    source_argument,
)
from lidario.cli.running import run
from lidario.cli.settings import config_option, only_with, settings_of_file
from lidario.cli.streams import emit, message


class _Told:
    """The recording, for the summary; also of a command that was interrupted."""

    recording: lidario.Recording | None = None
    began: float | None = None

    def filter(self, entry: logging.LogRecord) -> bool:
        """Whether a line of the log is shown: not why the recording ended, which the command tells at its end."""
        error = None if self.recording is None else self.recording.error
        return error is None or error not in (entry.args or ())

    async def follow(
        self, recording: lidario.Recording, stream: lidario.ScanStream, seconds: float | None, count: int | None
    ) -> None:
        """Read until there is as much as was asked for, or the recording has ended."""
        self.began, limit = time.monotonic(), asyncio.timeout(None)
        try:
            async with limit:
                async for _ in stream:
                    if seconds is not None and limit.when() is None:
                        # Not before: until the motor is at its speed, there is nothing to record.
                        self.began = time.monotonic()
                        limit.reschedule(asyncio.get_running_loop().time() + seconds)
                    if recording.error is not None or (count is not None and recording.scans >= count):
                        return
        except TimeoutError:
            if not limit.expired():  # a device that starts no stream, of which `ResponseTimeout` tells
                raise

    def so_far(self) -> str:
        """How much was recorded; empty as long as nothing was."""
        recording = self.recording
        if recording is None or self.began is None:
            return ""
        elapsed = time.monotonic() - self.began
        files = f", {recording.files} files" if recording.files > 1 else ""
        scans = counted(recording.scans, "scan")
        return f"{recording.source}: {elapsed:.0f} s, {scans}, {recording.size / 1e6:.1f} MB{files}"

    def sum_up(self) -> None:
        """Tell how much was recorded, and what is missing in the file."""
        if self.recording is not None and self.began is not None:
            message(self.so_far())
            if lost := self.recording.lost_bytes:
                last = counted(lost, "byte")
                message(f"without the last {last}, and the scans in them, because the file could not be written")


@click.command()
@source_argument
@recording_option
@click.option("-t", "--time", "seconds", type=as_duration, metavar="TIME",
              help="How long from the first scan on: 60s, 5m.")  # fmt: skip
@click.option("-n", "count", type=WholeRange(min=1), metavar="N",
              help="How many scans; of a busy computer a few more.")  # fmt: skip
@config_option
@mode_option
@click.option("--scans", is_flag=True, help="Write each scan too, as LaserScan on the topic /scan.")
@laserscan_options
@force_option
@click.option("--sync/--no-sync", default=True, show_default=True,
              help="Have the disk write once a second: a power cut costs no more than that.")  # fmt: skip
@reconnect_option
@click.option("--split", type=as_time_or_size, metavar="TIME|SIZE",
              help="Begin another file after so much, named by its time: 10min, 1GB.")  # fmt: skip
@click.option("--keep", type=as_size, metavar="SIZE", help="Remove the oldest files of that name above this: 20GB.")
@guard_option
def record(
    source: str,
    output: str | None,
    seconds: float | None,
    count: int | None,
    mode: str | int | None,
    scans: bool,
    force: bool,
    sync: bool,
    reconnect: bool,
    split: tuple[float | None, int | None] | None,
    keep: int | None,
    guard: bool,
    **of_scans: Any,
) -> None:
    """Record a lidar to a file, every byte in both directions.

    Without -t and -n until Ctrl-C. `lidario info FILE` tells what is in it; it is also a SOURCE for every other
    command.
    """
    from lidario.recording.parts import Split

    only_with("--scans", of_scans, scans)
    path = named_by_time("lidar") if output is None else output
    told, (split_s, split_bytes) = _Told(), split or (None, None)
    Split(split_s, split_bytes, keep, ("--split", "--split", "--keep"))
    _check(path, replaces=force or split is not None)
    laserscans_of(of_scans)
    config = settings_of_file()

    async def work() -> None:
        with progress(lambda: told.so_far() or f"opening {source} …"):
            async with lidario.open_lidar(source, guard=guard, reconnect=reconnect, config=config) as lidar:
                messages = laserscans_of(of_scans, lidar.config.frame) if scans else False
                told.recording = lidar.record(
                    path, scans=messages, overwrite=force, sync=sync,
                    split_s=split_s, split_bytes=split_bytes, keep_bytes=keep,
                )  # fmt: skip
                async with told.recording, lidar.scans(mode) as stream:
                    await told.follow(told.recording, stream, seconds, count)

    log = logging.getLogger("lidario")
    log.addFilter(told)
    try:
        run(work)
    except Stopped:
        if seconds is not None or count is not None or told.began is None:
            raise
    finally:
        log.removeFilter(told)
        told.sum_up()
    if told.recording is not None and told.recording.error is not None:
        raise told.recording.error
    emit(f"{path if told.recording is None else told.recording.source}\n")


def _check(path: str, replaces: bool) -> None:
    """Refuse what cannot be the file, or be written, before the lidar is opened."""
    from lidario.recording.export import must_be_writable
    from lidario.recording.files import file_source

    named = file_source(path)
    if named is None or str(named.path) != str(Path(path)):
        raise click.UsageError(f"{path!r} means something else as a SOURCE: give the file another name")
    must_be_writable(Path(path), overwrite=replaces)
