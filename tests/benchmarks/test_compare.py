"""Two files of rows beside each other: what became better or worse."""

from pathlib import Path
from typing import Any

import pytest

from benchmarks import compare

ROW = {
    "format": "0x82",
    "case": "clean",
    "way": "read",
    "samples": 10_000,
    "kept": 5000,
    "wrong": 10,
    "missing": 100,
    "told": 80,
    "delivered": 50,
    "rpm_off": [0.5, 3.0],
    "times_off_ms": None,
}


def _written(path: Path, *rows: dict[str, Any]) -> str:
    compare.write_rows(path, path.stem, {"truth": rows, "damage": []})
    return str(path)


@pytest.mark.parametrize(
    ("change", "worse"),
    [
        ({"kept": 4990}, True),
        ({"kept": 5010}, False),
        ({"kept": 4999}, None),
        ({"wrong": 11}, True),
        ({"wrong": 0}, False),
        ({"told": 100}, False),
        ({"told": 119}, False),
        ({"told": 122}, True),
        ({"delivered": 49}, True),
        ({"rpm_off": [0.5, 4.0]}, True),
        ({"rpm_off": [0.1, 3.0]}, False),
        ({"rpm_off": None}, None),
        ({"times_off_ms": [1.0, 2.0]}, None),
        ({}, None),
    ],
)
def test_each_figure_has_a_direction(
    change: dict[str, Any], worse: bool | None, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    before, after = _written(tmp_path / "abc.jsonl", ROW), _written(tmp_path / "def.jsonl", ROW | change)
    assert compare.main([before, after]) == int(bool(worse))
    said = capsys.readouterr().out
    assert ("worse: 1 figures" in said) is bool(worse)
    assert ("better: 1 figures" in said) is (worse is False)
    assert "1 rows of abc and def compared" in said


def test_slack_can_be_refused(tmp_path: Path) -> None:
    before = _written(tmp_path / "a.jsonl", ROW)
    after = _written(tmp_path / "b.jsonl", ROW | {"kept": 4999})
    assert compare.main([before, after]) == 0
    assert compare.main([before, after, "--strict"]) == 1


def test_a_missing_row_is_worse_unless_a_part_was_run(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    other = ROW | {"case": "a ramp"}
    before, after = _written(tmp_path / "a.jsonl", ROW, other), _written(tmp_path / "b.jsonl", ROW)
    assert compare.main([before, after]) == 1
    assert "gone: truth, 0x82, a ramp, read" in capsys.readouterr().out
    assert compare.main([before, after, "--part"]) == 0
    assert compare.main([before, after, "--select", "clean"]) == 0
    assert compare.main([after, before]) == 0


@pytest.mark.parametrize("text", [None, "", "[1, 2]", '{"revision": "abc"}\n[1]', "\x00", '"rows"'])
def test_what_is_no_file_of_rows_is_told_and_is_no_row_that_became_worse(
    text: str | None, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Which ends with 1, as an exception does."""
    other = tmp_path / "other.jsonl"
    if text is not None:
        other.write_text(text)
    with pytest.raises(SystemExit) as ended:
        compare.main([_written(tmp_path / "a.jsonl", ROW), str(other)])
    assert ended.value.code == 2
    assert "other.jsonl cannot be compared: " in capsys.readouterr().err


def test_the_yardsticks_can_be_read() -> None:
    folder = Path(compare.__file__).parent / "yardsticks"
    for name, rows in (("truth", 1200), ("damage", 63)):
        revision, found = compare.read_rows(folder / f"{name}-0265bcb.jsonl")
        assert revision == "0265bcb"
        assert len(found) >= rows
        assert {key[0] for key in found} == {name}
