"""A report: what was tried on one device, with what came of it, in one file that its owner can send to anybody.

The file is a recording, which every reader of recordings reads, with sets of texts more (`REPORT`): computer, line
and adapter, the modes, which rules are tried, and a verdict behind each rule, as soon as there is one. It may come
from anybody and from any version, and it may be cut, so whatever is there is read, and what cannot be right is left
out.
"""

import json
import platform
from collections.abc import Iterable
from dataclasses import asdict, dataclass
from functools import partial
from math import isfinite
from pathlib import Path
from typing import Any, Final, NamedTuple

from lidario.basics.arguments import printable
from lidario.basics.entered import Entered
from lidario.basics.model import ScanMode
from lidario.conformance.bench import Bench
from lidario.conformance.kept import Kept
from lidario.conformance.rule import Figure, Outcome, Rule, Verdict
from lidario.errors import RecordingError
from lidario.recording.about import NAME, About
from lidario.recording.chronicle import mode_of
from lidario.recording.mcap_records import Metadata, read_records
from lidario.recording.opened import StoredFile
from lidario.version import __version__

REPORT: Final = "lidario-report"
SIMULATED: Final = "simulated"
"""What a report says of the source of a simulated device."""
MOST_TRIED: Final = 200
MOST_MODES: Final = 64
MOST_FIGURES: Final = 64
LONGEST_TEXT: Final = 400
MOST_FACTS: Final = 40
MOST_S: Final = 1e6
MOST_LETTERS: Final = 1 << 20
_FACT: Final = "fact: "
_INTERRUPTED: Final = "the report was ended before"
_short: Final = partial(printable, most=LONGEST_TEXT)


class Tried(NamedTuple):
    """A `Verdict` as a file has it, by the name of its rule, which may be one of another version."""

    rule: str
    outcome: Outcome
    text: str
    seconds: float
    figures: tuple[Figure, ...] = ()

    def as_text(self) -> str:
        """One line of the file."""
        return json.dumps([self.rule, self.outcome.value, self.text, self.seconds, self.figures])


@dataclass(frozen=True, slots=True)
class Report:
    """What was tried on one device.

    Attributes:
        about: The device, as at the beginning of every recording; its serial number is hashed.
        facts: Computer, line and adapter: names and texts.
        modes: The modes that it lists.
        tried: A verdict for each rule.
    """

    about: About
    facts: dict[str, str]
    modes: tuple[ScanMode, ...]
    tried: tuple[Tried, ...]

    @property
    def is_complete(self) -> bool:
        """Whether all rules had their turn."""
        return bool(self.tried) and all(each.text != _INTERRUPTED for each in self.tried)

    @property
    def is_simulated(self) -> bool:
        """Whether the device was a simulated one."""
        return self.about.source == SIMULATED

    def with_outcome(self, outcome: Outcome) -> tuple[Tried, ...]:
        """The verdicts with that outcome."""
        return tuple(each for each in self.tried if each.outcome is outcome)


class Reporter(Entered):
    """Writes the report of a device on a bench, as it goes; used as an asynchronous context manager.

    ::

        async with await open_bench(source) as bench, Reporter(bench, Path("lidar.mcap")) as reporter:
            await reporter.run(RULES)

    The file holds what was seen by then whatever ends it; that of a program that is killed lacks two seconds.

    Args:
        bench: The device.
        path: The file to make.
        facts: What is known of the adapter, beside what is found here.
        overwrite: Whether a file that is there already may be replaced.
    """

    _instead = "a report is made asynchronously: write `async with Reporter(bench, path):`"

    def __init__(
        self, bench: Bench, path: Path, facts: dict[str, str] | None = None, *, overwrite: bool = False
    ) -> None:
        source = SIMULATED if bench.kind in ("sim", "device") else bench.kind
        self._bench = bench
        self._source = bench.lidar.source
        self._kept = Kept(bench, path, source, overwrite=overwrite)
        self._about = self._kept.about()
        self._modes: tuple[ScanMode, ...] = ()
        self._rules: tuple[Rule, ...] = ()
        self._tried: list[Tried] = []
        speed = f", {bench.lidar.baudrate} baud" if bench.lidar.baudrate else ""
        self._facts = {**facts_of_computer(), "line": source + speed, **(facts or {})}

    async def start(self) -> None:
        """Create the file and begin; ``async with`` does so.

        Raises:
            CannotRecord: The file cannot be written, or exists already.
        """
        # Before the file is there: a device that talks meanwhile must not come to stand in front of it.
        self._write({"format": "1", **texts_of_facts(self._facts)})
        await self._kept.recording.start()

    async def run(self, rules: Iterable[Rule], **told: Any) -> None:
        """Try rules; the further arguments are those of `Bench.judge`. Cancelling ends it.

        Raises:
            LidarError: The modes cannot be asked for.
        """
        self._rules = tuple(rules)
        self._modes = tuple(await self._bench.lidar.get_modes())
        modes = json.dumps([asdict(mode) for mode in self._modes])
        self._write({"modes": modes, "rules": "\n".join(rule.name for rule in self._rules)})
        for rule in self._rules:
            for verdict in await self._bench.judge((rule,), **told):
                self._tried.append(self._told(verdict))
                self._write({"tried": self._tried[-1].as_text()})

    def report(self) -> Report:
        """What was found so far; rules that had no turn were not tried."""
        names = [rule.name for rule in self._rules]
        return Report(self._about, dict(self._facts), self._modes, _with_the_rest(self._tried, names))

    async def close(self) -> None:
        """Complete the file; harmless when done before. Cancelling ends only the waiting.

        Raises:
            CannotRecord: It could not be written to its end.
        """
        recording = self._kept.recording
        if recording.is_running:
            if trouble := self._bench.lidar.stats.line_trouble:
                self._facts["driver has counted"] = trouble
            if self._kept.left_out:
                self._facts["left out"] = f"{self._kept.left_out} bytes, because there were too many"
            self._write(texts_of_facts(self._facts))
        await recording.close()
        if recording.error is not None:
            raise recording.error

    def _write(self, texts: dict[str, str]) -> None:
        self._kept.recording.see_texts(REPORT, texts, self._bench.dialogue.port.now())

    def _told(self, verdict: Verdict) -> Tried:
        # Names of ports hold serial numbers of adapters, and addresses are nobody's business.
        text = self._kept.numbers.in_text(verdict.text).replace(self._source, self._about.source)
        return Tried(verdict.rule.name, verdict.outcome, text, verdict.seconds, verdict.figures)


def facts_of_computer() -> dict[str, str]:
    """The kind of this computer; nothing that tells it from others of its kind."""
    machine = platform.uname()
    return {
        "lidario": __version__,
        "system": f"{machine[0]} {machine.release}, {machine.machine}",
        "python": platform.python_version(),
    }


def texts_of_facts(facts: dict[str, str]) -> dict[str, str]:
    """Facts as they stand in the file."""
    return {_FACT + name: text for name, text in facts.items()}


def _with_the_rest(tried: Iterable[Tried], names: Iterable[str]) -> tuple[Tried, ...]:
    """What was tried, and of the rules of these names those that had no turn."""
    tried = tuple(tried)
    had = {each.rule for each in tried}
    rest = (Tried(name, Outcome.NOT_TRIED, _INTERRUPTED, 0.0) for name in names if name not in had)
    return (*tried, *rest)


def read_report(path: Path) -> Report:
    """The report in a file.

    Raises:
        RecordingError: There is none in it, or it cannot be read.
    """
    about: About | None = None
    texts, tried, room = dict[str, str](), list[str](), MOST_LETTERS
    with StoredFile(path) as file:
        for record in read_records(file):
            if isinstance(record, Metadata) and record.name == NAME:
                about = About.of(record.texts)
            elif isinstance(record, Metadata) and record.name == REPORT and room > 0:
                room -= sum(len(name) + len(text) for name, text in record.texts.items())
                tried.append(record.texts.get("tried", ""))
                texts |= record.texts
    if about is None or not texts:
        raise RecordingError(f"{path} is no report: `lidario report -o FILE` makes one")
    return report_of(about, {**texts, "tried": "\n".join(tried)})


def report_of(about: About, texts: dict[str, str]) -> Report:
    """The report that the texts of a file tell, as far as they can be right."""
    facts = {
        _short(name.removeprefix(_FACT)): _short(text) for name, text in texts.items() if name.startswith(_FACT)
    }
    tried = (_tried_of(line) for line in texts.get("tried", "").split("\n", MOST_TRIED)[:MOST_TRIED])
    names = texts.get("rules", "").split("\n", MOST_TRIED)[:MOST_TRIED]
    return Report(
        about,
        dict(list(facts.items())[:MOST_FACTS]),
        _modes_of(texts.get("modes", "")),
        _with_the_rest((each for each in tried if each is not None), map(_short, filter(None, names))),
    )


def _modes_of(text: str) -> tuple[ScanMode, ...]:
    try:
        return tuple(mode_of(each) for each in json.loads(text)[:MOST_MODES])
    except (ValueError, KeyError, TypeError, AttributeError, OverflowError, RecursionError):
        return ()


def _tried_of(line: str) -> Tried | None:
    try:
        name, outcome, text, seconds, *rest = json.loads(line)
        took = float(seconds)
        took = took if 0.0 <= took <= MOST_S else 0.0  # NaN is not
        figures = tuple(_figure_of(*each) for each in list(rest[0])[:MOST_FIGURES]) if rest else ()
        return Tried(_short(name), Outcome(outcome), _short(text), took, figures)
    except (ValueError, TypeError, OverflowError, RecursionError):
        return None


def _figure_of(name: object, value: float, unit: object) -> Figure:
    value = float(value)
    return Figure(_short(name), value if isfinite(value) else 0.0, _short(unit))
