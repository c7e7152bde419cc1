"""How true scans are: of streams whose true angles and times are known, what is delivered, and how far off it is.

Every format, with small packets and with large ones; every speed of the rotor, every damage and every delay of
`benchmarks.truth_cases`; live and from a file. Nothing here is timed, and the same command prints the same figures.

A point is known by its distance, in which the number of its sample is coded (`benchmarks.truth_code`), so that its
angle and its time can be compared with the true ones. The table tells of each stream what `Score` holds.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from typing import Any

from benchmarks.report import Result, Setting, Table
from benchmarks.truth_cases import CASES, Case, happen
from benchmarks.truth_forms import FORMATS
from benchmarks.truth_score import Score, score
from benchmarks.truth_streams import Form
from benchmarks.truth_vendor import by_vendor
from benchmarks.truth_ways import WAYS, receive

Vendor = tuple[int, int] | None
"""Points kept, and wrong ones; None where the rules are not known."""

_COLUMNS = (
    "format, what happens, way",
    "kept",
    "by the vendor's rules: kept, wrong",
    "wrong, mixed, twice",
    "farthest",
    "revolutions",
    "packets missing, told",
    "revolutions missing, told",
    "rpm off, %",
    "times off, ms",
    "overlap, ms",
)


def run(setting: Setting) -> Result:
    """Everything that happens, to every format, in every way; or what has one of the selected words in its name."""
    table = Table("Truth", _COLUMNS)
    rows = list[dict[str, Any]]()
    cases = list(CASES.values())[:3] if setting.quick else list(CASES.values())
    for case in cases:
        if any(setting.selects(form, case.name, way) for form in FORMATS for way in WAYS):
            setting.say(case.name)
        for form in FORMATS.values():
            ways = [way for way in WAYS if setting.selects(form.name, case.name, way)]
            for way, found, vendor in judged(case, form, ways):
                table.add(f"{form.name}, {case.name}, {way}", *_cells(found, vendor))
                rows.append({"format": form.name, "case": case.name, "way": way, **found.row(), "vendor": vendor})
    table.notes += [
        "wrong: samples more than a degree off; mixed: of another revolution than their scan; twice: once more",
        "farthest: of all samples, in degrees; off: of half of the scans or samples, and at most",
    ]
    return Result("truth", [table, _summed(rows)], {}, rows)


def _summed(rows: list[dict[str, Any]]) -> Table:
    """All formats together, by what happens and in which way."""
    table = Table(
        "Truth, all formats together",
        ("what happens, way", "kept", "wrong, mixed, twice", "revolutions", _COLUMNS[6], _COLUMNS[7]),
    )
    sums = dict[tuple[str, str], Counter[str]]()
    for row in rows:
        whole = Counter({name: value for name, value in row.items() if isinstance(value, int)})
        sums.setdefault((row["case"], row["way"]), Counter()).update(whole)
    for names, each in sums.items():
        table.add(
            ", ".join(names),
            f"{100 * each['kept'] / each['samples']:.1f} %",
            f"{each['wrong']}, {each['mixed']}, {each['twice']}",
            f"{each['delivered']} of {each['revolutions']}",
            f"{each['missing']}, {each['told']}",
            f"{each['missing_revolutions']}, {each['told_revolutions']}",
        )
    return table


def judged(case: Case, form: Form, ways: list[str]) -> Iterator[tuple[str, Score, Vendor]]:
    """What becomes of one stream, in each of these ways in which it can come; and by the vendor's rules."""
    if not ways:
        return
    stream, line = happen(case, form)
    vendor = by_vendor(stream, line)
    for way in ways:
        if case.in_files or way != "file":
            yield way, score(stream, line, receive(stream, line, way), timed=way != "file"), vendor


def _cells(found: Score, vendor: Vendor) -> list[str]:
    return [
        f"{100 * found.kept / found.samples:.1f} %" if found.samples else "-",
        "-" if vendor is None else f"{100 * vendor[0] / found.samples:.1f} %, {vendor[1]}",
        f"{found.wrong}, {found.mixed}, {found.twice}",
        f"{found.farthest_deg:.2f}",
        f"{found.delivered} of {found.revolutions}",
        f"{found.missing}, {found.told}",
        f"{found.missing_revolutions}, {found.told_revolutions}",
        _two(found.rpm_off, 2),
        _two(found.times_off_ms, 1),
        f"{found.overlap_ms:.1f}",
    ]


def _two(off: tuple[float, float] | None, digits: int) -> str:
    return "-" if off is None else f"{off[0]:.{digits}f}, {off[1]:.{digits}f}"
