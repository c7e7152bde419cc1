"""No figure of the benchmark "truth" may become worse than in the rows that are kept; and what those must tell."""

from functools import cache
from pathlib import Path

import pytest

from benchmarks import compare
from benchmarks.truth import judged
from benchmarks.truth_cases import CASES
from benchmarks.truth_forms import FORMATS
from benchmarks.truth_ways import WAYS

KEPT = Path(compare.__file__).parent / "yardsticks" / "truth.jsonl"
ROWS = [
    (case, name, way) for case in CASES for name in FORMATS for way in WAYS if CASES[case].in_files or way != "file"
]
SOME = ROWS[::9]
"""Of each case some, in each way and of any format."""


@cache
def kept() -> dict[compare.Key, compare.Row]:
    return compare.read_rows(KEPT)[1]


@pytest.mark.exhaustive(("case", "name", "way"), sample=SOME, full=ROWS)
def test_what_becomes_of_a_stream_is_no_worse_than_it_was(case: str, name: str, way: str) -> None:
    """``python -m benchmarks --only truth --rows benchmarks/yardsticks/truth.jsonl`` keeps what became better."""
    key = ("truth", name, case, way)
    ((_, found, _),) = judged(CASES[case], FORMATS[name], [way])
    changes = compare.changes(kept()[key], found.row(), key)
    assert not [f"{each.what}: {each.before} -> {each.after}" for each in changes if each.worse]


def test_where_nothing_is_missing_nothing_is_told_as_lost() -> None:
    """However the rotor turns, and however late and in whatever pieces its packets come."""
    rows = [row for row in kept().values() if not row["missing"]]
    assert len(rows) > 1200
    for row in rows:
        assert (row["told"], row["seq_off"], row["mixed"]) == (0, 0, 0), row
        assert row["told_revolutions"] == row["missing_revolutions"], row
        # A packet in the midst of which the rotor stops has its samples at equal steps all the same.
        stops = row["case"].startswith(("standing", "braked"))
        assert row["wrong"] <= (0.006 * row["samples"] if stops else 0), row


def test_what_is_lost_of_a_live_stream_is_told_and_bends_nothing() -> None:
    """Where a read brings no more than a revolution, of a rotor that turns."""
    rows = [
        row
        for row in kept().values()
        if ("gone" in row["case"] or "outage" in row["case"]) and row["way"] in ("read", "held")
        if not row["case"].startswith("stop and go") and "0.2 to 0.3 s" not in row["case"]
    ]
    assert len(rows) > 500
    for row in rows:
        assert row["wrong"] <= 0.001 * row["samples"], row
        assert row["mixed"] <= 0.02 * row["samples"], row
        # Of outages that come as often as revolutions, some packets are not known to have been lost.
        assert 0.88 * row["missing"] - 10 < row["told"] < 1.04 * row["missing"] + 12, row
        assert abs(row["told_revolutions"] - row["missing_revolutions"]) <= 2, row
        assert row["seq_off"] <= 3, row


def test_of_a_line_that_loses_bytes_no_more_is_told_than_there_was() -> None:
    rows = [row for row in kept().values() if "bytes lost" in row["case"]]
    assert len(rows) > 100
    for row in rows:
        assert row["delivered"] <= row["revolutions"], row
        # Of 0x81, damaged bytes may pass for nodes, so that fewer seem to be missing than are.
        assert row["told"] <= 1.05 * row["missing"] + 10, row
        assert row["delivered"] + row["told_revolutions"] <= 1.1 * row["revolutions"] + 1, row
