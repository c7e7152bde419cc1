"""``lidario info``: model, health and scan modes of a device; of a recording, what is in it."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import asdict, dataclass
from datetime import UTC, datetime
from typing import TYPE_CHECKING

import click

import lidario
from lidario.basics.words import counted
from lidario.cli.output import dump, emit_tables, facts, in_both_units, progress, table
from lidario.cli.parameters import json_option, source_argument
from lidario.cli.running import run
from lidario.cli.streams import message

if TYPE_CHECKING:
    from rich.table import Table

    from lidario.recording.files import FileSource

_ABSURD_HZ = 100.0


@dataclass
class _Told:
    source: str
    info: lidario.DeviceInfo
    health: lidario.Health
    modes: tuple[lidario.ScanMode, ...]
    frequency: float | None = None
    limits: tuple[float, float] | None = None


@click.command()
@source_argument
@json_option
def info(source: str, as_json: bool) -> None:
    """Ask a lidar what it is, and how it is.

    Model, firmware, serial number, health and scan modes. Of a recording: which device, how long, and what is in
    it; the whole file is decoded for that.
    """
    from lidario.recording.files import file_source

    file = file_source(source)
    if file is not None:
        _show_summary(file, as_json=as_json)
        return

    told = run(lambda: _ask(source), f"asking {source} …" if source != "auto" else "looking for a lidar …")
    if as_json:
        dump(_record(told))
    else:
        emit_tables(_facts(told), "", _modes(told.modes))


async def _ask(source: str) -> _Told:
    async with lidario.open_lidar(source) as lidar:
        told = _Told(lidar.source, lidar.info, lidar.health, await lidar.get_modes())
        with suppress(lidario.Unsupported):
            told.frequency = await lidar.get_scan_frequency()
        # Of some it is known though they cannot be asked.
        with suppress(lidario.Unsupported):
            told.limits = await lidar.get_scan_frequency_range()
        return told


def _facts(told: _Told) -> Table:
    device, health = told.info, told.health
    code = f" (code {health.code})" if health.code else ""
    code += f": {health.note}" if health.note else ""
    rows = (
        ("source", told.source),
        ("model", f"{device.model} (number {device.model_id})" if device.model_id else device.model),
        ("firmware", device.firmware),
        ("hardware", str(device.hardware) if device.firmware else ""),
        ("serial number", device.serial),
        ("health", health.status.value + code),
        ("scan frequency", _frequency(told.frequency, told.limits)),
    )
    # A device that only talks tells little of itself.
    return facts((name, value) for name, value in rows if value)


def _frequency(hertz: float | None, limits: tuple[float, float] | None) -> str:
    if hertz is None and limits is None:
        return "cannot be set on this device"
    text = "not told" if hertz is None else f"set to {in_both_units(hertz)}"
    # Limits that are merely what fits in the request tell nothing.
    if limits is not None and limits[1] < _ABSURD_HZ:
        text += f", from {limits[0]:g} to {limits[1]:g} Hz"
    return text


def _modes(modes: tuple[lidario.ScanMode, ...]) -> Table:
    figures = ("id", "µs/sample", "samples/s", "max. distance", "response type")
    rows = (
        (
            str(mode.id),
            mode.name,
            f"{mode.sample_us:.2f}" if mode.sample_us else "not told",
            f"{mode.samples_per_second:.0f}" if mode.sample_us else "",
            f"{mode.max_distance:g} m" if mode.max_distance else "not told",
            f"0x{mode.response_type:02X}",
            "yes" if mode.typical else "",
        )
        for mode in modes
    )
    return table((figures[0], "scan mode", *figures[1:], "typical"), rows, right=figures)


def _record(told: _Told) -> dict[str, object]:
    return {
        "source": told.source,
        **asdict(told.info),
        "health": {"status": told.health.status.value, "code": told.health.code},
        "scan_frequency": told.frequency,
        "scan_frequency_range": told.limits,
        "modes": [
            {
                **asdict(mode),
                "sample_us": mode.sample_us or None,
                "samples_per_second": mode.samples_per_second if mode.sample_us else None,
                "max_distance": mode.max_distance or None,
            }
            for mode in told.modes
        ],
    }


def _show_summary(file: FileSource, *, as_json: bool) -> None:
    """Decode a recording and print what it holds."""
    if file.played:
        raise click.BadParameter(
            f"{file.played[0]}= says how a recording is played: here the whole file is told of", param_hint="SOURCE"
        )
    with progress(f"decoding {file.path} …"):
        summary = lidario.summarize(file.path, **file.known._asdict())
    if as_json:
        record = asdict(summary)
        dump({**record, "began_ns": summary.began_ns or None, "damage": summary.damage or None})
    else:
        emit_tables(_facts_of_file(summary))
    if summary.damage:
        message(f"note: {summary.damage}; everything else is there")


def _facts_of_file(summary: lidario.RecordingSummary) -> Table:
    info = summary.info
    rows = [("file", f"{summary.path} ({summary.size / 1e6:.1f} MB)"), ("model", info.model)]
    if info.serial:
        rows += [("serial number", info.serial), ("firmware", info.firmware)]
    if summary.timed:
        began = datetime.fromtimestamp(summary.began_ns * 1e-9, UTC).strftime("%Y-%m-%d %H:%M:%S UTC")
        rows += [("recorded from", summary.source), ("began", began if summary.began_ns else "no scan")]
    samples = f"{counted(summary.samples, 'sample')}, {summary.returns} with a return"
    interruptions = counted(summary.streams - 1, "interruption")
    rows += [
        ("lasts", f"{summary.duration_s:.1f} s" + ("" if summary.timed else ", by the usual rate of its format")),
        ("scan mode", ", ".join(summary.modes)),
        ("scans", f"{summary.scans}: {samples}"),
        ("packets", f"{summary.packets}, and {summary.lost_packets} damaged or lost"),
        ("noise", f"{counted(summary.skipped_bytes, 'byte')} of no packet"),
        ("gaps", f"{counted(summary.missed_scans, 'revolution')} missing, {interruptions}"),
    ]
    away = f"{counted(summary.losses, 'time')}, {summary.away_s:.1f} s: the line to the lidar was lost"
    return facts([*rows, ("away", away)] if summary.losses else rows)
