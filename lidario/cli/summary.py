"""``lidario info FILE``: what a recording holds."""

from __future__ import annotations

from dataclasses import asdict
from datetime import UTC, datetime
from typing import TYPE_CHECKING

from lidario.cli.errors import ExitCode
from lidario.cli.output import console, dump, facts, progress, rendered
from lidario.cli.streams import emit, message

if TYPE_CHECKING:
    from rich.table import Table

    from lidario import RecordingSummary
    from lidario.recording.files import FileSource

__all__ = ["show_summary"]


def show_summary(file: FileSource, *, as_json: bool) -> int:
    """Decode a recording and print what it holds; returns the exit code."""
    from lidario import summarize

    with progress(f"decoding {file.path} …"):
        summary = summarize(file.path, **file.known._asdict())
    if as_json:
        record = asdict(summary)
        dump({**record, "began_ns": summary.began_ns or None, "damage": summary.damage or None})
    else:
        emit(rendered(console(), _facts(summary)))
    if summary.damage:
        message(f"note: {summary.damage}; everything else is there")
    return ExitCode.OK


def _facts(summary: RecordingSummary) -> Table:
    info = summary.info
    rows = [("file", f"{summary.path} ({summary.size / 1e6:.1f} MB)"), ("model", info.model)]
    if info.serial:
        rows += [("serial number", info.serial), ("firmware", info.firmware)]
    if summary.timed:
        began = datetime.fromtimestamp(summary.began_ns * 1e-9, UTC).strftime("%Y-%m-%d %H:%M:%S UTC")
        rows += [("recorded from", summary.source), ("began", began if summary.began_ns else "no scan")]
    samples = f"{summary.samples} samples, {summary.returns} with a return"
    rows += [
        ("lasts", f"{summary.duration_s:.1f} s" + ("" if summary.timed else ", by the usual rate of its format")),
        ("scan mode", ", ".join(summary.modes)),
        ("scans", f"{summary.scans}: {samples}"),
        ("packets", f"{summary.packets}, and {summary.lost_packets} damaged or lost"),
        ("noise", f"{summary.skipped_bytes} bytes that belong to no packet"),
        ("gaps", f"{summary.missed_scans} revolutions missing, {summary.streams - 1} interruptions"),
    ]
    if summary.losses:
        rows.append(("away", f"{summary.losses} times, {summary.away_s:.1f} s: the line to the lidar was lost"))
    return facts(rows)
