"""``lidario report``: what a lidar does and does not, as a page and as one file to attach to an issue.

The file is written at the end, and also when the report is interrupted or the device is lost meanwhile: what was
seen by then is in it. No file is made where nothing could be opened.
"""

from __future__ import annotations

import logging
from dataclasses import asdict
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING

import click

from lidario.cli.errors import ExitCode
from lidario.cli.machine import Machine
from lidario.cli.output import console, dump, facts, introduced, progress, rendered
from lidario.cli.parameters import complete_source
from lidario.cli.streams import emit, message

if TYPE_CHECKING:
    from collections.abc import Callable

    from rich.table import Table

    from lidario.conformance import Report, Reporter, Rule

__all__ = ["report_lidar"]

HOLDS = (
    "The report will hold every byte between this computer and the lidar, the kind of this computer and of the "
    "adapter, and a verdict for each rule. The serial number is hashed; no name or address is in it. The lidar is "
    "started, stopped and restarted often for a minute or two; let it stand in a room, its rotor free."
)
"""Said before anything is opened."""


class _Begun:
    """The report, also of a verb that was interrupted."""

    reporter: Reporter | None = None


@click.command("report")
@click.argument("source", default="auto", shell_complete=complete_source)
@click.option("-o", "--output", metavar="FILE", help="The file to make; named after the time where not given.")
@click.option("--force", is_flag=True, help="Replace a file that is there already.")
@click.option("--check", is_flag=True, help="SOURCE is a report: read it, and say what is new in it.")
@click.option("--json", "as_json", is_flag=True, help="The page as an object for programs.")
def report_lidar(source: str, output: str | None, force: bool, check: bool, as_json: bool) -> int:
    """Try a lidar against thirty rules, and write a report.

    It takes one to two minutes; Ctrl-C ends it, and what was tried by then is written. Its file is a recording,
    which every other command reads.
    """
    from lidario.cli.running import run
    from lidario.conformance import RULES

    if check:
        return _check(Path(source), as_json)
    path = Path(datetime.now().strftime("report-%Y%m%d-%H%M%S.mcap") if output is None else output)
    if path.suffix.casefold() != ".mcap":
        raise click.BadParameter(f"{str(path)!r} does not end in .mcap", param_hint="-o")
    if path.exists() and not force:
        # Not only at the end, behind two minutes.
        raise click.BadParameter(f"{path} exists already; --force replaces it", param_hint="-o")
    message(HOLDS)
    begun = _Begun()
    try:
        with progress(f"opening {source} …") as show:
            run(lambda: _try(begun, source, RULES, show))
    finally:
        if begun.reporter is not None:
            written = begun.reporter.write(path, overwrite=force)
            _show(written, [], as_json)
            message(f"wrote {path} ({path.stat().st_size / 1e6:.1f} MB); attach it zipped to an issue of lidario")
    return ExitCode.OK


async def _try(begun: _Begun, source: str, rules: tuple[Rule, ...], show: Callable[[str], None]) -> None:
    from lidario.conformance import Reporter, open_bench

    async with await open_bench(source) as bench:
        begun.reporter = Reporter(bench, _of_adapter(bench.lidar.source))
        numbers = {rule.name: number for number, rule in enumerate(rules, 1)}
        await begun.reporter.run(
            rules, on_begin=lambda rule: show(f"{numbers[rule.name]} of {len(rules)}: {rule.sentence}")
        )


def _of_adapter(source: str) -> dict[str, str]:
    """What is behind a port, but for what tells one computer or adapter from the others."""
    from lidario import list_serial_ports

    path = source.removeprefix("serial://").partition("?")[0]
    machine = Machine()
    ports = {port.path: port for port in list_serial_ports()}
    found, usb = dict[str, str](), machine.usb(path)
    if path.startswith("/dev/pts/"):
        found["adapter"] = "none: a pseudo-terminal"
    if usb is not None:
        name = ports[path].adapter if path in ports else ""
        found["adapter"] = f"{name or 'unknown'} ({usb.vendor}:{usb.product})"
        found["driver"] = machine.driver(path)
        found["supply"] = "it may sleep while it is not open" if usb.sleeps else "it is kept awake"
        if usb.latency_ms is not None:
            found["latency"] = f"it gathers bytes for {usb.latency_ms} ms while it is open"
    return found


def _check(path: Path, as_json: bool) -> int:
    from lidario.cli.running import run
    from lidario.conformance import news_of, read_report
    from lidario.conformance.news import known_of

    report = read_report(path)
    # What simulated devices say of themselves is not of interest here.
    logging.getLogger("lidario").setLevel(logging.CRITICAL)
    with progress(f"comparing {path} with what is known …"):
        known = run(lambda: known_of(report.about.info.family))
    news = news_of(report, known)
    if report.is_simulated:
        message("note: it is of a simulated device, which tells nothing of real ones")
    if not report.is_complete:
        message("note: it was ended before all rules had their turn")
    _show(report, news or ["nothing: all of it is known, and every rule that was tried is held"], as_json)
    return ExitCode.OK


def _show(report: Report, news: list[str], as_json: bool) -> None:
    if as_json:
        tried = [{**each._asdict(), "outcome": each.outcome.value} for each in report.tried]
        modes = [asdict(mode) for mode in report.modes]
        dump(
            {"info": asdict(report.about.info), "facts": report.facts, "modes": modes, "tried": tried, "news": news}
        )
        return
    info = report.about.info
    rows = [("lidar", introduced(info.model, info.serial and f"{info.serial} (hashed)", info.firmware))]
    rows += [("modes", ", ".join(mode.name for mode in report.modes)), *report.facts.items()]
    rows += [("new" if not at else "", line) for at, line in enumerate(news)]
    target = console()
    emit(rendered(target, facts(rows), "", _verdicts(report)))


def _verdicts(report: Report) -> Table:
    from rich.table import Table
    from rich.text import Text

    from lidario.conformance import RULES, Outcome

    colours = {Outcome.HELD: "green", Outcome.BROKEN: "bold red", Outcome.NOT_TRIED: "dim"}
    rules = {rule.name: rule for rule in RULES}
    table = Table.grid(padding=(0, 2))
    for _ in range(2):
        table.add_column(no_wrap=True)
    table.add_column(overflow="fold")
    for each in report.tried:
        table.add_row(Text(each.outcome.value, colours[each.outcome]), each.rule, each.text)
        rule = rules.get(each.rule)
        if each.outcome is Outcome.BROKEN and rule is not None:
            table.add_row("", "", Text(f"→ {rule.sentence} ({rule.origin.value}: {rule.known_from})"))
    counts = ", ".join(f"{len(report.with_outcome(outcome))} {outcome.value}" for outcome in Outcome)
    table.add_row("", "", "")
    table.add_row("", "", Text(counts, "bold"))
    return table
