"""What a benchmark hands back, and how it is printed: tables that are Markdown, and JSON with every single value.

Every figure in a table is the median of the rounds of one run, with the smallest and the largest behind it. On a
shared machine figures of two runs must not be compared: ratios within a run may.
"""

from __future__ import annotations

import os
import platform
import statistics
import subprocess
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.peers import Peers
from benchmarks.processes import Failed


@dataclass(frozen=True, slots=True)
class Setting:
    """How to run.

    Attributes:
        quick: Only so long that everything is seen to work.
        peers: The other drivers; None to leave them out.
        words: Only rows that have all of these words in their names, in benchmarks that can.
    """

    quick: bool
    peers: Peers | None = None
    words: tuple[str, ...] = ()

    def selects(self, *names: str) -> bool:
        """Whether each of the words is in one of the names."""
        return all(any(word in name for name in names) for word in self.words)

    def ask_peer(self, contestant: str, adapter: str, task: dict[str, Any], *, timeout: float) -> dict[str, Any]:
        """As `Peers.ask`; one that is left out is absent."""
        if self.peers is None:
            raise Failed("left out")
        return self.peers.ask(contestant, adapter, task, timeout=timeout)

    def say(self, what: str) -> None:
        """Tell what is going on, on standard error."""
        os.write(2, f"[{time.strftime('%H:%M:%S')}] {what}\n".encode())


@dataclass(slots=True)
class Table:
    """A table and what must be known to read it."""

    title: str
    columns: Sequence[str]
    rows: list[list[str]] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)

    def add(self, *cells: str) -> None:
        """Add a row."""
        self.rows.append(list(cells))

    def note_absent(self, absent: Mapping[str, str]) -> None:
        """Say below it who is absent, and why."""
        self.notes += [f"absent: {who}: {why}" for who, why in absent.items()]

    def markdown(self) -> str:
        """As text that is Markdown and can be read as it is."""
        lines = [list(self.columns), *self.rows]
        widths = [max(len(line[at]) for line in lines) for at in range(len(self.columns))]

        def row(cells: Sequence[str]) -> str:
            first, *others = (cell.ljust(width) for cell, width in zip(cells, widths, strict=True))
            return f"| {' | '.join((first, *others))} |"

        rule = f"|{'|'.join('-' * (width + 2) for width in widths)}|"
        text = [f"#### {self.title}", "", row(lines[0]), rule, *map(row, self.rows)]
        return "\n".join([*text, "", *(f"- {note}" for note in self.notes), *([""] if self.notes else [])])


@dataclass(slots=True)
class Result:
    """What one benchmark found.

    Attributes:
        name: Its name.
        tables: For people.
        data: For programs: every value of every round.
        rows: For `benchmarks.compare`: figures that are the same in each run, by what they are of.
    """

    name: str
    tables: list[Table]
    data: dict[str, Any]
    rows: list[dict[str, Any]] = field(default_factory=list)


def median(values: Sequence[float]) -> float:
    """The median; NaN of none."""
    return statistics.median(values) if values else float("nan")


def percentile(values: Sequence[float], percent: float) -> float:
    """A percentile; NaN of none."""
    return float(np.percentile(values, percent)) if len(values) else float("nan")


def thinned(values: Sequence[float], most: int = 401) -> list[float]:
    """At most so many of the values, in order, so that every percentile stays what it is."""
    if len(values) <= most:
        return sorted(values)
    return [float(each) for each in np.quantile(values, np.linspace(0.0, 1.0, most))]


def spread(values: Sequence[float], digits: int = 1) -> str:
    """Median, smallest and largest."""
    if not values:
        return "–"
    middle = f"{median(values):.{digits}f}"
    if len(values) == 1:
        return middle
    return f"{middle} ({min(values):.{digits}f}–{max(values):.{digits}f})"


def ratio(values: Sequence[float], baseline: Sequence[float]) -> str:
    """Median over median."""
    if not values or not baseline or not median(baseline):
        return "–"
    return f"{median(values) / median(baseline):.2f}"


def machine() -> dict[str, str]:
    """What all this ran on."""
    return {
        "date": time.strftime("%Y-%m-%d %H:%M %Z"),
        "processor": _processor(),
        "cores": str(os.cpu_count()),
        "load before": " ".join(f"{load:.2f}" for load in os.getloadavg()) if hasattr(os, "getloadavg") else "?",
        "system": f"{platform.system()} {platform.release()}",
        "python": f"{platform.python_implementation()} {platform.python_version()}",
        "numpy": np.__version__,
        "revision": _revision(),
    }


def _processor() -> str:
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
    except OSError:
        return platform.processor() or platform.machine()
    names = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    virtual = any(line.startswith("flags") and " hypervisor" in line for line in lines)
    return (names[0] if names else platform.machine()) + (", a virtual machine" if virtual else "")


def _revision() -> str:
    root = Path(__file__).resolve().parent.parent
    try:
        done = subprocess.run(
            ["git", "describe", "--always", "--dirty"], cwd=root, capture_output=True, text=True, check=False
        )
    except OSError:
        return "unknown"
    return done.stdout.strip() or "unknown"
