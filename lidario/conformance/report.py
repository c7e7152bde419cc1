"""A report: what was tried on one device, with what came of it, in one file that its owner can send to anybody.

The file is a recording, which every reader of recordings reads, with one set of texts more (`REPORT`): computer,
line and adapter, the modes, and a verdict for each rule. It may come from anybody and from any version, so whatever
is there is read, and what cannot be right is left out.
"""

from __future__ import annotations

import json
import platform
from collections.abc import Iterable
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, Final, NamedTuple

from lidario.arguments import printable
from lidario.conformance.bench import Bench
from lidario.conformance.kept import Kept
from lidario.conformance.rule import Outcome, Rule, Verdict
from lidario.errors import RecordingError
from lidario.model import ScanMode
from lidario.recording.about import NAME, About
from lidario.recording.chronicle import mode_of
from lidario.recording.mcap_records import MAGIC, Metadata, read_records
from lidario.recording.opened import StoredFile
from lidario.version import __version__

__all__ = ["REPORT", "Report", "Reporter", "Tried", "read_report"]

REPORT: Final = "lidario-report"
SIMULATED: Final = "simulated"
"""What a report says of the source of a simulated device."""
MOST_TRIED: Final = 200
MOST_MODES: Final = 64
LONGEST_TEXT: Final = 400
MOST_FACTS: Final = 40
MOST_S: Final = 1e6
_FACT: Final = "fact: "
_INTERRUPTED: Final = "the report was ended before"


class Tried(NamedTuple):
    """A verdict as a file has it: the rule may be one of another version.

    Attributes:
        rule: Name of the rule.
        outcome: Whether it held.
        text: What was measured; by how much it was not held; or why it was not tried.
        seconds: How long that took.
    """

    rule: str
    outcome: Outcome
    text: str
    seconds: float


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

    def as_texts(self) -> dict[str, str]:
        """The set of texts in the file."""
        return {
            "format": "1",
            "modes": json.dumps([asdict(mode) for mode in self.modes]),
            "tried": "\n".join(json.dumps([*each[:1], each.outcome.value, *each[2:]]) for each in self.tried),
            **{_FACT + name: text for name, text in self.facts.items()},
        }


class Reporter:
    """Makes the report of a device on a bench.

    ::

        async with await open_bench(source) as bench:
            reporter = Reporter(bench, {"adapter": "CP2102"})
            await reporter.run(RULES)
        reporter.write(Path("lidar.mcap"))

    What it has seen may be written at any time, also behind an error or Ctrl-C.

    Args:
        bench: The device.
        facts: What is known of the adapter, beside what is found here.
    """

    def __init__(self, bench: Bench, facts: dict[str, str]) -> None:
        self._bench = bench
        self._source = bench.lidar.source
        self._kept = Kept(bench, SIMULATED if bench.kind in ("sim", "device") else bench.kind)
        self._modes: tuple[ScanMode, ...] = ()
        self._rules: tuple[Rule, ...] = ()
        self._verdicts: list[Verdict] = []
        speed = f", {bench.lidar.baudrate} baud" if bench.lidar.baudrate else ""
        machine = platform.uname()
        self._facts = {
            "lidario": __version__,
            "system": f"{machine[0]} {machine.release}, {machine.machine}",
            "python": platform.python_version(),
            "line": self._kept.about.source + speed,
            **facts,
        }

    async def run(self, rules: Iterable[Rule], **told: Any) -> None:
        """Try rules; the further arguments are those of `Bench.judge`. Cancelling ends it.

        Raises:
            LidarError: The modes cannot be asked for.
        """
        self._rules = tuple(rules)
        self._modes = tuple(await self._bench.lidar.get_modes())
        for rule in self._rules:
            self._verdicts += await self._bench.judge((rule,), **told)

    def report(self) -> Report:
        """What was found so far; rules that had no turn were not tried."""
        hidden = self._kept.hidden()

        def told(text: str) -> str:
            # Names of ports hold serial numbers of adapters, and addresses are nobody's business.
            return hidden.in_text(text).replace(self._source, self._kept.about.source)

        facts = dict(self._facts)
        trouble = self._bench.lidar.stats.line_trouble
        if trouble:
            facts["driver has counted"] = trouble
        if self._kept.left_out:
            facts["left out"] = f"{self._kept.left_out} bytes, because there were too many"
        tried = [Tried(each.rule.name, each.outcome, told(each.text), each.seconds) for each in self._verdicts]
        later = self._rules[len(tried) :]
        tried += [Tried(rule.name, Outcome.NOT_TRIED, _INTERRUPTED, 0.0) for rule in later]
        info = replace(self._kept.about.info, serial=hidden.in_text(self._kept.about.info.serial))
        return Report(replace(self._kept.about, info=info), facts, self._modes, tuple(tried))

    def write(self, path: Path, *, overwrite: bool = False) -> Report:
        """Write the file, and return the report.

        Raises:
            CannotRecord: It cannot be written.
        """
        report = self.report()
        self._kept.write(path, REPORT, report.as_texts(), overwrite=overwrite)
        return report


def read_report(path: Path) -> Report:
    """The report in a file.

    Raises:
        RecordingError: There is none in it, or it cannot be read.
    """
    about: About | None = None
    with StoredFile(path) as file:
        if file.read(len(MAGIC)) == MAGIC:
            for record in read_records(file):
                if isinstance(record, Metadata) and record.name == NAME:
                    about = About.of(record.texts)
                elif isinstance(record, Metadata) and record.name == REPORT and about is not None:
                    return _report_of(about, record.texts)
    raise RecordingError(f"{path} is no report: `lidario report -o FILE` makes one")


def _report_of(about: About, texts: dict[str, str]) -> Report:
    facts = {
        printable(name.removeprefix(_FACT)[:LONGEST_TEXT]): printable(text[:LONGEST_TEXT])
        for name, text in texts.items()
        if name.startswith(_FACT)
    }
    tried = (_tried_of(line) for line in texts.get("tried", "").split("\n", MOST_TRIED)[:MOST_TRIED])
    return Report(
        about,
        dict(list(facts.items())[:MOST_FACTS]),
        _modes_of(texts.get("modes", "")),
        tuple(each for each in tried if each is not None),
    )


def _modes_of(text: str) -> tuple[ScanMode, ...]:
    try:
        return tuple(mode_of(each) for each in json.loads(text)[:MOST_MODES])
    except (ValueError, KeyError, TypeError, AttributeError, OverflowError, RecursionError):
        return ()


def _tried_of(line: str) -> Tried | None:
    try:
        name, outcome, text, seconds = json.loads(line)
        took = float(seconds)
        took = took if 0.0 <= took <= MOST_S else 0.0  # NaN is not
        return Tried(
            printable(str(name)[:LONGEST_TEXT]), Outcome(outcome), printable(str(text)[:LONGEST_TEXT]), took
        )
    except (ValueError, TypeError, OverflowError, RecursionError):
        return None
