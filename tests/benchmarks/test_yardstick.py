"""No figure of the benchmark "truth" may become worse than in the rows that are kept."""

import zlib
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


def some(share: int) -> list[tuple[str, str, str]]:
    """About one of so many rows, always the same ones."""
    return [row for row in ROWS if zlib.crc32(" ".join(row).encode()) % share == 0]


@cache
def kept() -> dict[compare.Key, compare.Row]:
    return compare.read_rows(KEPT)[1]


@pytest.mark.exhaustive(("case", "name", "way"), sample=some(20), full=ROWS)
def test_what_becomes_of_a_stream_is_no_worse_than_it_was(case: str, name: str, way: str) -> None:
    """``python -m benchmarks --only truth --rows benchmarks/yardsticks/truth.jsonl`` keeps what became better."""
    key = ("truth", name, case, way)
    ((_, found, _),) = judged(CASES[case], FORMATS[name], [way])
    changes = compare.changes(kept()[key], found.row(), key)
    assert not [f"{each.what}: {each.before} -> {each.after}" for each in changes if each.worse]
