"""``lidario report``: what a lidar does and does not, as a page and as one file to attach to an issue.

No file is made where nothing can be opened, or nothing comes.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING

import click

import lidario
from lidario.cli.machine import Machine
from lidario.cli.output import dump, emit_tables, facts, introduced, judged
from lidario.cli.parameters import force_option, named_by_time, recording_option, source_argument
from lidario.cli.running import nothing_logged, run
from lidario.cli.settings import only_with
from lidario.cli.streams import message

if TYPE_CHECKING:
    from lidario.conformance import Report, Reporter, Rule

HOLDS = (
    "The report will hold every byte between this computer and the lidar, the kind of this computer and of the "
    "adapter, and a verdict for each rule. The serial number is hashed; no name or address is in it. Where the "
    "lidar responds in no way known to lidario, nobody can tell where its number stands, so then it is not hashed. "
    "The lidar is started, stopped and restarted often for a minute or two; let it stand in a room, its rotor free."
)
"""Said before anything is opened."""


class _Begun:
    """The report, also of a verb that was interrupted."""

    doing: str = ""
    reporter: Reporter | None = None
    unknown: bool = False


@click.command("report")
@source_argument
@recording_option
@force_option
@click.option("--check", is_flag=True, help="SOURCE is a report: read it, and say what is new in it.")
@click.option("--json", "as_json", is_flag=True, help="The page as an object for programs.")
def report_lidar(source: str, output: str | None, force: bool, check: bool, as_json: bool) -> None:
    """Try a lidar against thirty rules, and write a report.

    It takes half a minute to two minutes; Ctrl-C ends it. Its file is a recording, which every other command
    reads. It is written as the report goes on. Of a device that responds in no known way it holds every byte at
    each speed.
    """
    from lidario.recording.export import must_be_writable

    only_with("a report that is made", ("output", "force"), not check)
    if check and source == "auto":
        raise click.UsageError("--check reads the report that SOURCE names")
    if check:
        _check(Path(source), as_json)
        return
    path = Path(named_by_time("report") if output is None else output)
    # Not only at the end, behind two minutes.
    must_be_writable(path, overwrite=force)
    message(HOLDS)
    begun = _Begun()
    begun.doing = f"opening {source} …"
    adapters = _Adapters(source)
    try:
        run(lambda: _try(begun, adapters, source, path, force), lambda: begun.doing)
    finally:
        if begun.reporter is not None:
            _show(begun.reporter.report(), [], as_json)
        if begun.reporter is not None or begun.unknown:
            with suppress(OSError):  # somebody has taken it away
                message(
                    f"wrote {path} ({path.stat().st_size / 1e6:.1f} MB); attach it zipped to an issue of lidario"
                )


async def _try(begun: _Begun, adapters: _Adapters, source: str, path: Path, force: bool) -> None:
    from lidario.conformance import RULES, Reporter, open_bench
    from lidario.conformance.unknown import Unknown

    unknown = Unknown()
    try:
        try:
            bench = await open_bench(source, on_port=unknown.attach)
        except lidario.ConnectFailed:
            # What came back while all ports were asked was kept nowhere.
            if source != "auto" or adapters.only is None:
                raise
            source = adapters.only
            bench = await open_bench(source, on_port=unknown.attach)
    except lidario.ConnectFailed as error:
        if error.reason == "silent":
            begun.doing = f"nothing responds in a known way: listening to {source} at each speed …"
            begun.unknown = await unknown.kept(source, path, adapters.facts(source), overwrite=force)
        raise
    unknown.forget()
    async with bench:
        reporter = Reporter(bench, path, adapters.facts(bench.lidar.source), overwrite=force)
        async with reporter:
            begun.reporter = reporter
            numbers = {rule.name: number for number, rule in enumerate(RULES, 1)}

            def shown(rule: Rule) -> None:
                begun.doing = f"{numbers[rule.name]} of {len(RULES)}: {rule.sentence}"

            await reporter.run(RULES, on_begin=shown)


class _Adapters:
    """What is behind the ports of this computer, but for what tells one of them from others of its kind.

    It is made before a port is opened, since what the system says of some changes then. `only` is the port with an
    adapter that lidars come with, where there is one of them.
    """

    def __init__(self, source: str) -> None:
        self._machine = Machine()
        self._ports = {port.path: port for port in lidario.list_serial_ports()}
        named = [port.path for port in self._ports.values() if port.adapter]
        self.only: str | None = named[0] if len(named) == 1 else None
        self._latencies = {path: self._machine.latency_ms(path) for path in (*self._ports, _path_of(source))}

    def facts(self, source: str) -> dict[str, str]:
        """What a report says of the one that is open."""
        path, machine = _path_of(source), self._machine
        found, usb = dict[str, str](), machine.usb(path)
        if path.startswith("/dev/pts/"):
            found["adapter"] = "none: a pseudo-terminal"
        if path.startswith("/") and (access := machine.access(path)):
            found["access"] = access
        if usb is not None:
            name = self._ports[path].adapter if path in self._ports else ""
            found["adapter"] = f"{name or 'unknown'} ({usb.vendor}:{usb.product})"
            found["driver"] = machine.driver(path)
            found["supply"] = "it may sleep while it is not open" if usb.sleeps else "it is kept awake"
            before = self._latencies.get(path)
            if usb.latency_ms is not None:
                found["latency"] = f"it gathers bytes for {usb.latency_ms} ms while it is open"
                found["latency"] += f", else for {before} ms" if before is not None else ""
        return found


def _path_of(source: str) -> str:
    return source.removeprefix("serial://").partition("?")[0]


def _check(path: Path, as_json: bool) -> None:
    from lidario.conformance import news_of, read_report
    from lidario.conformance.news import known_of

    report = read_report(path)
    family = report.about.info.family
    # What simulated devices say of themselves is not of interest here.
    with nothing_logged():
        known = run(lambda: known_of(family), f"comparing {path} with what is known …") if family else ()
    news = news_of(report, known)
    if report.is_simulated:
        message("note: it is of a simulated device, which tells nothing of real ones")
    if family and not report.is_complete:
        message("note: it was ended before all rules had their turn")
    _show(report, news or ["nothing: all of it is known, and every rule that was tried is held"], as_json)


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
    rows += [("modes", ", ".join(mode.name for mode in report.modes))] if report.modes else []
    rows += report.facts.items()
    rows += [("new" if not at else "", line) for at, line in enumerate(news)]
    figures = [(each.name, str(each)) for one in report.tried for each in one.figures]
    parts = [facts(rows), *(["", facts(figures)] if figures else ())]
    emit_tables(*parts, *(["", judged(_verdicts(report))] if report.tried else ()))


def _verdicts(report: Report) -> Iterator[tuple[str, str, str, str]]:
    from lidario.conformance import RULES, Outcome

    colours = {Outcome.HELD: "green", Outcome.BROKEN: "bold red", Outcome.NOT_TRIED: "dim"}
    rules = {rule.name: rule for rule in RULES}
    for each in report.tried:
        yield colours[each.outcome], each.outcome.value, each.rule, each.text
        rule = rules.get(each.rule)
        if each.outcome is Outcome.BROKEN and rule is not None:
            yield "", "", "", f"→ {rule.sentence} ({rule.origin.value}: {rule.known_from})"
    counts = ", ".join(f"{len(report.with_outcome(outcome))} {outcome.value}" for outcome in Outcome)
    yield "", "", "", ""
    yield "bold", "", "", counts
