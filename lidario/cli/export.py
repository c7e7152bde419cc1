"""``lidario export``: the scans of recordings as NPZ, CSV or MCAP; several files at once, on processes."""

from __future__ import annotations

import os
import signal
import threading
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import BrokenExecutor, Executor, Future
from contextlib import ExitStack, contextmanager, nullcontext, suppress
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import click

import lidario
from lidario.basics.words import counted
from lidario.cli.errors import Stopped
from lidario.cli.laserscans import laserscan_options, laserscans_of
from lidario.cli.output import progress
from lidario.cli.parameters import FiniteRange, WholeRange, as_file, complete_file
from lidario.cli.settings import config_option, only_with, settings_of_file
from lidario.cli.streams import message

if TYPE_CHECKING:
    from multiprocessing.connection import Connection

    from lidario.recording.decode_file import FileDecoder
    from lidario.recording.files import Known

T = TypeVar("T")
_ENDING = [getattr(signal, name) for name in ("SIGTERM", "SIGHUP") if hasattr(signal, name)]  # Windows: not SIGHUP


@click.command()
@click.argument("files", metavar="FILE...", nargs=-1, required=True, shell_complete=complete_file)
@click.argument("out", metavar="OUT", type=as_file(".npz", ".csv", ".mcap"), shell_complete=complete_file)
@click.option("-j", "jobs", type=WholeRange(min=1), default=1, show_default=True, metavar="N",
              help="How many processes. Each takes one of the files.")  # fmt: skip
@click.option("--family", metavar="NAME", help="Of bare bytes, where it cannot be told from them.")
@click.option("--model", metavar="NAME", help="Of bare bytes: the lidar that sent them, as in x4.")
@click.option("--sample-us", type=FiniteRange(min=0, min_open=True), metavar="US",
              help="Of bare bytes: microseconds a sample; by default as the format usually takes.")  # fmt: skip
@laserscan_options
@config_option
@click.option("--force", is_flag=True, help="Replace files that are there already.")
def export(
    files: tuple[str, ...],
    out: str,
    jobs: int,
    family: str | None,
    model: str | None,
    sample_us: float | None,
    force: bool,
    **of_scans: Any,
) -> None:
    """Write the scans of recordings as NPZ, CSV or MCAP.

    The name of OUT ends with .npz, .csv or .mcap. Of several files, it has {} where the name of each one belongs,
    as in scans/{}.npz. NPZ holds the device's own figures: clockwise degrees and millimetres. CSV has a row for
    each sample, as `lidario scan --csv`. MCAP is the recording with each scan on /scan.
    """
    from lidario.recording.files import Known

    if len(files) > 1 and "{}" not in out:
        raise click.BadParameter("of several files, OUT needs {} where each name belongs", param_hint="OUT")
    only_with("an OUT that ends with .mcap", of_scans, out.casefold().endswith(".mcap"))
    laserscans_of(of_scans)
    known, config = Known(family, model, sample_us), settings_of_file()
    tasks = {out.replace("{}", _name_of(file)): file for file in files}
    if len(tasks) < len(files):
        raise click.BadParameter("two of the files have the same name", param_hint="FILE...")
    with progress(f"exporting {counted(len(tasks), 'file')} …"):
        export_to = partial(export_one, known=known, of_scans=of_scans, force=force, config=config)
        failures = _all(tasks, export_to, min(jobs, len(tasks)))
    for failure in failures[1:]:
        message(f"error: {failure}")
    if failures:
        raise failures[0]


def _name_of(file: str) -> str:
    """What stands for the name of a file; of a pattern, what all the names have in common."""
    return Path(file).stem.replace("*", "").strip("-_") or "all"


def _all(tasks: dict[str, str], export_to: Callable[[str, str], tuple[int, str]], jobs: int) -> list[Exception]:
    """Export to each of the targets; what fails does not keep the others from being exported."""
    failures: list[Exception] = []
    with processes(jobs) if jobs > 1 else nullcontext() as pool:
        running: list[Callable[[], tuple[int, str]]]
        running = [partial(export_to, file, target) for target, file in tasks.items()]
        if pool is not None:
            running = [each.result for each in begun(pool, running)]
        for (target, file), done in zip(tasks.items(), running, strict=True):
            try:
                scans, damage = done()
            except lidario.LidarError as error:
                failures.append(error)
                continue
            except BrokenExecutor:
                why = "a process was killed: is memory short?"
                failures.append(lidario.CannotRecord(f"{target} is not written: {why}"))
                continue
            message(f"{target}: {counted(scans, 'scan')}")
            if damage:
                message(f"note: {file}: {damage}; everything else is exported")
    return failures


@contextmanager
def processes(count: int) -> Iterator[Executor]:
    """So many processes, which end when this one is killed.

    Where the block raises, as by Ctrl-C, they end in the midst of what they do. SIGTERM and SIGHUP raise `Stopped`
    there: a process that ends without its pool leaves semaphores, and Python tells so.
    """
    # Only here: loading them takes long.
    from concurrent.futures import ProcessPoolExecutor
    from multiprocessing import get_context

    # Not forked: a process that has threads, or a terminal in use, must not be copied.
    context = get_context("spawn")
    theirs, ours = context.Pipe(duplex=False)
    with _raised_signals(), theirs, ours, ProcessPoolExecutor(count, context, _end_with_parent, (theirs,)) as pool:
        try:
            yield pool
        except BaseException:
            ours.close()
            raise


@contextmanager
def _raised_signals() -> Iterator[None]:
    def stop(number: int, _: object) -> None:
        signal.signal(number, signal.SIG_DFL)
        raise Stopped(number)

    with ExitStack() as given_back:
        for number in _ENDING:
            # One that is ignored, as under nohup, stays so.
            if signal.getsignal(number) is signal.SIG_DFL:
                given_back.callback(signal.signal, number, signal.SIG_DFL)
                signal.signal(number, stop)
        yield


def begun(pool: Executor, works: Iterable[Callable[[], T]]) -> list[Future[T]]:
    """Have the processes of a pool call each of these, none of which meets Ctrl-C.

    A terminal sends it to them, too, and a process that is just being started would end with a traceback. So would
    a process whose parent is ended before it has sent what is to be done.
    """
    if not hasattr(signal, "pthread_sigmask"):
        return [pool.submit(work) for work in works]
    # What is blocked here stays blocked in processes that are started meanwhile.
    before = signal.pthread_sigmask(signal.SIG_BLOCK, [signal.SIGINT, *_ENDING])
    try:
        return [pool.submit(work) for work in works]
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _end_with_parent(lifeline: Connection) -> None:
    def wait() -> None:
        # The other end is closed, by the parent or with it.
        with suppress(EOFError, OSError):
            lifeline.recv_bytes()
        os._exit(1)

    threading.Thread(target=wait, daemon=True).start()
    if hasattr(signal, "pthread_sigmask"):
        signal.pthread_sigmask(signal.SIG_UNBLOCK, _ENDING)


def export_one(
    file: str, out: str, known: Known, of_scans: dict[str, Any], force: bool, config: lidario.Config
) -> tuple[int, str]:
    """Export one file; returns how many scans, and why it could not be read to its end. Runs in any process."""
    from lidario.recording.decode_file import FileDecoder
    from lidario.recording.export import export_mcap, export_npz

    decoder = FileDecoder(file, known)
    own = config.of(decoder.recording.about.info.serial)
    decoder.filters = own.filters
    if out.casefold().endswith(".mcap"):
        count = export_mcap(decoder, Path(out), laserscans_of(of_scans, own.frame), overwrite=force)
    else:
        write = export_npz if out.casefold().endswith(".npz") else _export_csv
        count = write(decoder, Path(out), overwrite=force)
    return count, decoder.recording.damage


def _export_csv(decoder: FileDecoder, path: Path, *, overwrite: bool) -> int:
    from lidario.cli.formats import CSV_HEADER, as_csv
    from lidario.recording.export import write_whole

    count = 0
    with write_whole(path, overwrite=overwrite) as part, open(part, "w", encoding="ascii", newline="") as file:
        file.write(CSV_HEADER)
        for scan in decoder:
            count += 1
            file.write(as_csv(scan))
    return count
