"""Two commits beside each other, row by row: ``python -m benchmarks.compare A.jsonl B.jsonl``.

``python -m benchmarks --only truth,damage --rows FILE`` writes such a file: a line tells the commit, the benchmark
and its columns, each of the lines behind it is a row. What became better or worse from A to B is printed, and the
exit status is 1 where anything became worse. A row that only A has counts as worse, unless ``--part`` says that B
has but some.

What is better depends on the figure: more samples kept; fewer wrong; what is told nearer to what is missing.
Figures that differ by less than a slack, such as two samples of ten thousand, are alike; ``--strict`` allows none.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

Row = Mapping[str, Any]
Key = tuple[str, str, str, str]


@dataclass(frozen=True, slots=True)
class Figure:
    """A figure of a row that has a good and a bad direction.

    Attributes:
        name: For people.
        of: The figure of a row; the smaller the better.
        slack: By how much it may differ and still be alike; of a row.
        shown: As it is printed.
    """

    name: str
    of: Callable[[Row], float]
    slack: Callable[[Row], float]
    shown: Callable[[Row], str]


@dataclass(frozen=True, slots=True)
class Change:
    """One figure of one row that differs.

    Attributes:
        key: Benchmark, format, case and way.
        what: The figure.
        before: What it was.
        after: What it is.
        worse: Whether that is worse.
    """

    key: Key
    what: str
    before: str
    after: str
    worse: bool


def _number(name: str, slack: float = 0.0, *, samples: float = 0.0, more: bool = False) -> Figure:
    """A figure by its name; figures are alike within `slack`, and `samples` of all samples of the row."""
    sign = -1 if more else 1
    return Figure(
        name,
        lambda row: sign * float(row[name]),
        lambda row: slack + samples * float(row["samples"]),
        lambda row: str(row[name]),
    )


def _part(name: str, at: int, what: str, slack: float) -> Figure:
    return Figure(
        f"{name}, {what}", lambda row: float(row[name][at]), lambda _: slack, lambda row: str(row[name][at])
    )


def _told(what: str, told: str, missing: str) -> Figure:
    """How far what is told is from what is missing; one of two hundred is alike."""
    return Figure(
        what,
        lambda row: abs(row[told] - row[missing]),
        lambda row: 0.005 * float(row[missing]),
        lambda row: f"{row[told]} of {row[missing]}",
    )


FIGURES: Final = (
    _number("kept", samples=2e-4, more=True),
    _number("wrong", samples=2e-5),
    _number("farthest_deg", 0.1),
    _number("mixed", samples=2e-5),
    _number("twice"),
    _number("delivered", more=True),
    _told("packets told", "told", "missing"),
    _told("revolutions told", "told_revolutions", "missing_revolutions"),
    _told("revolutions told", "told_scans", "missing_scans"),
    _number("seq_off"),
    _part("rpm_off", 0, "half of the scans", 0.05),
    _part("rpm_off", 1, "at most", 0.5),
    _part("times_off_ms", 0, "half of the samples", 0.05),
    _part("times_off_ms", 1, "at most", 0.5),
    _number("overlap_ms", 0.5),
    _number("no_rpm"),
)
"""All figures that have a direction; a row has those whose names it has."""


def write_rows(path: Path, revision: str, rows: Mapping[str, Sequence[Row]]) -> None:
    """Write the rows of benchmarks, by their names, each behind a line with the commit that they are of."""
    lines = list[str]()
    for name, each in rows.items():
        if each:
            lines.append(json.dumps({"revision": revision, "benchmark": name, "columns": list(each[0])}))
            lines += [json.dumps(list(row.values()), ensure_ascii=False) for row in each]
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text("".join(f"{line}\n" for line in lines), encoding="utf-8")


def read_rows(path: Path) -> tuple[str, dict[Key, Row]]:
    """The commit, and the rows by what they are of."""
    revision, head, rows = "", dict[str, Any](), dict[Key, Row]()
    for line in path.read_text(encoding="utf-8").splitlines():
        read = json.loads(line)
        if isinstance(read, dict):
            head, revision = read, read["revision"]
            continue
        row = dict(zip(head["columns"], read, strict=True))
        rows[head["benchmark"], row["format"], row["case"], row.get("way", "")] = row
    return revision, rows


def _rows(path: str) -> tuple[str, dict[Key, Row]]:
    """As `read_rows`, for an argument."""
    try:
        found = read_rows(Path(path))
        if not found[1]:
            raise ValueError("it has no rows")
    except (OSError, ValueError, LookupError, TypeError) as error:
        raise argparse.ArgumentTypeError(f"{path} cannot be compared: {error}") from error
    return found


def changes(before: Row, after: Row, key: Key, *, strict: bool = False) -> list[Change]:
    """The figures of one row that became better or worse."""
    found = list[Change]()
    for figure in FIGURES:
        try:
            old, new = figure.of(before), figure.of(after)
        except (KeyError, TypeError):
            continue  # not a figure of this benchmark, or one of no scan at all
        if abs(new - old) > (0.0 if strict else figure.slack(before)):
            found.append(Change(key, figure.name, figure.shown(before), figure.shown(after), new > old))
    return found


def main(arguments: Sequence[str] | None = None) -> int:
    """Compare two files."""
    options = _parser().parse_args(arguments)
    (old, before), (new, after) = options.before, options.after
    words = [] if options.select is None else options.select.split(",")
    keys = [key for key in before if all(any(word in name for name in key) for word in words)]
    both = [key for key in keys if key in after]
    found = [each for key in both for each in changes(before[key], after[key], key, strict=options.strict)]
    gone = [] if options.part else [key for key in keys if key not in after]
    for title, worse in (("worse", True), ("better", False)):
        some = [each for each in found if each.worse is worse]
        print(f"{title}: {len(some)} figures of {len({each.key for each in some})} rows")
        for each in some:
            print(f"  {', '.join(filter(None, each.key))}: {each.what} {each.before} -> {each.after}")
    for key in gone:
        print(f"gone: {', '.join(filter(None, key))}")
    print(f"{len(both)} rows of {old} and {new} compared, {len(set(after) - set(before))} are new")
    return int(bool(gone) or any(each.worse for each in found))


def _parser() -> argparse.ArgumentParser:
    made = argparse.ArgumentParser(prog="python -m benchmarks.compare", description=__doc__)
    made.add_argument("before", type=_rows, metavar="A.jsonl")
    made.add_argument("after", type=_rows, metavar="B.jsonl")
    made.add_argument("--select", metavar="WORDS", help="only rows that have all of these words in their names")
    made.add_argument("--part", action="store_true", help="B may have only some of the rows of A")
    made.add_argument("--strict", action="store_true", help="no slack: each figure counts")
    return made


if __name__ == "__main__":
    sys.exit(main())
