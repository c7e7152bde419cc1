"""``lidario stats``: how well a lidar, its line and this machine do, measured for some seconds.

The verdict is one word, with its reason behind it. It names what costs most first: damage on the line, then a
machine that is too slow, a rotor that turns unevenly, and a sensor that sees nothing.
"""

from __future__ import annotations

import asyncio
import math
import time
from contextlib import suppress
from dataclasses import dataclass, field
from statistics import fmean, pstdev

import click

import lidario
from lidario.basics.words import counted
from lidario.cli.errors import ExitCode, Stopped
from lidario.cli.output import dump, emit_tables, facts, in_both_units, introduced
from lidario.cli.parameters import as_duration, guard_option, json_option, mode_option, source_argument
from lidario.cli.running import run
from lidario.cli.settings import config_option, settings_of_file
from lidario.cli.streams import message
from lidario.web.traffic import Traffic, traffic

TOLERABLE_DAMAGE = 0.005  # one packet in 200; a scan has about 80, so that fewer than every second scan has a gap
UNEVEN = 0.03
"""Share of the revolution's time. Rotors of this kind hold their speed within 1 to 2 %."""
NOTHING_SEEN = 0.995
FULL_LINE = 0.95
_COUNTERS = (
    *("packets", "lost_packets", "missed_scans", "dropped_scans", "skipped_bytes"),
    *("framing_errors", "parity_errors", "overruns", "breaks"),
)
"""Those of `lidario.Stats` that programs are told."""


@dataclass
class Measured:
    """What was read: the number of each scan with the second at which it began, its samples, those with a return.

    `cpu` is the share of one core that this process used; of a simulated lidar too, which is in the same process.
    """

    stamps: list[tuple[int, float]] = field(default_factory=list)
    samples: list[int] = field(default_factory=list)
    returns: list[int] = field(default_factory=list)
    line: Traffic = field(default_factory=Traffic)
    seconds: float = 0.0
    cpu: float = 0.0
    model: str = ""
    serial: str = ""
    mode: str = ""
    simulated: bool = False

    def add(self, scan: lidario.Scan) -> None:
        """Take in a scan."""
        self.stamps.append((scan.seq, scan.stamp_ns / 1e9))
        self.samples.append(len(scan))
        self.returns.append(int(scan.valid.sum()))
        self.mode = scan.mode

    @property
    def periods(self) -> list[float]:
        """Seconds of each revolution that was followed by the next one."""
        pairs = zip(self.stamps, self.stamps[1:], strict=False)
        return [later - earlier for (seq, earlier), (following, later) in pairs if following == seq + 1]

    @property
    def hertz(self) -> float:
        """Revolutions a second; NaN where no two scans followed each other."""
        return 1 / fmean(self.periods) if self.periods else math.nan

    @property
    def jitter(self) -> float:
        """Standard deviation of the time of a revolution, in seconds; NaN as `hertz`."""
        return pstdev(self.periods) if self.periods else math.nan

    @property
    def no_return(self) -> float:
        """Share of the samples without a return; NaN without samples."""
        return 1 - sum(self.returns) / sum(self.samples) if sum(self.samples) else math.nan


@click.command()
@source_argument
@click.option("-t", "--time", "seconds", default="10s", show_default=True, type=as_duration, metavar="TIME",
              help="How long to measure, such as 10s or 2min.")  # fmt: skip
@config_option
@mode_option
@json_option
@guard_option
def stats(source: str, seconds: float, mode: str | int | None, as_json: bool, guard: bool) -> int:
    """Measure rate, damage and load; end with a verdict.

    Also how even the revolutions are, and how many samples have no return. A revolution before the measuring begins
    is not counted. The exit code tells whether it could be measured, and the verdict how good it was.
    """
    measured, settings = Measured(), settings_of_file()
    stopped: Stopped | None = None
    try:
        run(
            lambda: measure(source, seconds, mode, measured, guard=guard, config=settings),
            f"measuring for {seconds:g} s …",
        )
    except Stopped as caught:
        stopped = caught
    if measured.stamps:
        if as_json:
            dump(_record(measured))
        else:
            emit_tables(facts(_figures(measured)))
    else:
        message(
            "nothing was measured: revolutions count from the second one on, and none came. "
            "Measure for longer (-t), or take a longer recording"
        )
    if stopped is not None:
        raise stopped
    return ExitCode.OK if measured.stamps else ExitCode.NO_DATA


async def measure(
    source: str,
    seconds: float,
    mode: str | int | None,
    into: Measured,
    *,
    guard: bool = False,
    config: lidario.Config | None = None,
) -> None:
    """Read scans for so long; what was read until then is in `into` also when it is cancelled."""
    async with lidario.open_lidar(source, guard=guard, config=config) as lidar, lidar.scans(mode) as scans:
        into.model, into.serial = lidar.info.model, lidar.info.serial
        into.simulated = lidar.source.startswith("sim:")
        if await anext(scans, None) is None:
            raise lidario.RecordingError(f"{source} holds no full revolution")
        loop = asyncio.get_running_loop()
        before, began, cpu = lidar.stats, loop.time(), time.process_time()
        try:
            # Only a recording comes to its end.
            with suppress(TimeoutError):
                async with asyncio.timeout(seconds):
                    async for scan in scans:
                        into.add(scan)
        finally:
            into.seconds = loop.time() - began
            into.cpu = (time.process_time() - cpu) / max(into.seconds, 1e-9)
            into.line = traffic(before, lidar.stats, into.seconds, lidar.baudrate)


def verdict(measured: Measured) -> tuple[str, str]:
    """One word, and its reason with what to do."""
    line = measured.line
    is_damaged = line.missed_scans > 0 or line.damaged > TOLERABLE_DAMAGE
    # What a late read costs is missing in one place: more stretches of damage come from the line.
    if is_damaged and line.late_reads >= max(line.skipped_stretches, 1):
        return "slow", (
            f"{percent(line.damaged)} of the packets lost while this computer was busy: "
            f"{counted(line.late_reads, 'time')} it read when the buffer was full. "
            "Close other programs, or use a mode with fewer samples"
        )
    if is_damaged and line.overruns and not line.framing_errors:
        lost = f"{percent(line.damaged)} of the packets lost, with {line.line_trouble}"
        return "slow", f"{lost}. Close other programs"
    if is_damaged:
        missed = f" and {counted(line.missed_scans, 'revolution')} lost" if line.missed_scans else ""
        cure = "Check the cable, the plug, and the power supply (5 V, 1.5 A)"
        if line.line_trouble:
            cure = f"The driver counted {line.line_trouble}"
        elif measured.simulated:
            cure = "Its simulated faults do that, or this computer is too busy; a real one has a cable to check"
        return "damaged", f"{percent(line.damaged)} of the packets damaged{missed}. {cure}"
    if line.discarded_bytes:
        return "slow", f"this machine was too busy to read: it threw {counted(line.discarded_bytes, 'byte')} away"
    if line.dropped_scans:
        return "slow", f"this program was too slow for {counted(line.dropped_scans, 'scan')}"
    if line.load is not None and line.load > FULL_LINE:
        return "full", f"the line carries {percent(line.load)} of what it can; a mode with fewer samples is safer"
    if not measured.periods:
        return "short", "no two scans followed each other: measure for longer"
    if measured.jitter * measured.hertz > UNEVEN:
        return "uneven", (
            f"the time of a revolution varies by {percent(measured.jitter * measured.hertz)}. "
            "Check the power supply and that the rotor turns freely"
        )
    if measured.no_return > NOTHING_SEEN:
        return "blind", "no returns: is the cover off, is the window clean, is anything in range?"
    few = f"{percent(line.damaged)} of the packets damaged, few enough"
    return "good", few if line.lost_packets else "nothing lost, and an even revolution"


def percent(share: float) -> str:
    """A share for people, with at least two digits that say something."""
    value = 100 * share
    return f"{value:.0f} %" if value >= 9.95 or value == 0 else f"{value:.1f} %" if value >= 0.1 else "under 0.1 %"


def _figures(measured: Measured) -> list[tuple[str, str]]:
    line = measured.line
    word, reason = verdict(measured)
    load = f", {percent(line.load)} of the line" if line.load is not None else ""
    lost = f"{counted(line.missed_scans, 'revolution')} on the line"
    rows = [
        ("lidar", f"{introduced(measured.model, measured.serial)}, mode {measured.mode}"),
        ("measured", f"{counted(len(measured.samples), 'scan')} in {measured.seconds:.1f} s"),
        ("rate", in_both_units(measured.hertz) if measured.periods else "not known"),
        ("jitter", f"{1000 * measured.jitter:.2f} ms a revolution" if measured.periods else "not known"),
        ("samples", f"{fmean(measured.samples):.0f} a scan, {percent(measured.no_return)} without a return"),
        ("damage", f"{line.lost_packets} of {line.packets + line.lost_packets} packets ({percent(line.damaged)})"),
        ("lost", f"{lost}, {counted(line.dropped_scans, 'scan')} in this program"),
        ("driver", line.line_trouble and f"counted {line.line_trouble}"),
        ("link", f"{line.bytes_a_second / 1000:.1f} kB/s{load}"),
        ("CPU", f"{percent(measured.cpu)} of a core"),
        ("verdict", f"{word}: {reason}"),
    ]
    return [(name, value) for name, value in rows if value]


def _record(measured: Measured) -> dict[str, object]:
    line = measured.line
    word, reason = verdict(measured)
    return {
        "model": measured.model,
        "serial": measured.serial,
        "mode": measured.mode,
        "seconds": round(measured.seconds, 3),
        "scans": len(measured.samples),
        "hertz": _finite(measured.hertz, 4),
        "jitter_ms": _finite(1000 * measured.jitter, 4),
        "samples": _finite(fmean(measured.samples), 1),
        "no_return": _finite(measured.no_return, 5),
        **{name: getattr(line, name) for name in _COUNTERS},
        "damaged": round(line.damaged, 6),
        "bytes_per_second": round(line.bytes_a_second, 1),
        "link_load": None if line.load is None else round(line.load, 4),
        "cpu": round(measured.cpu, 4),
        "verdict": word,
        "reason": reason,
    }


def _finite(value: float, digits: int) -> float | None:
    return round(value, digits) if math.isfinite(value) else None
