"""The front page: short, the two commands first, figures with their commands. What it shows: tests/test_docs.py."""

import re
from pathlib import Path

import pytest

from benchmarks import __main__ as measuring
from tests.support.children import ended

ROOT = Path(__file__).parent.parent
README = (ROOT / "README.md").read_text(encoding="utf-8")
MEASURING = "\n".join(
    path.read_text(encoding="utf-8") for path in (ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md")))
)
MEASURED_BY = sorted(
    {
        "".join(found)
        for found in re.findall(
            r"^ {4}python -m benchmarks (.*)$|`python -m benchmarks ([^`]*)`", MEASURING, re.MULTILINE
        )
    }
)


@pytest.mark.long
def test_the_first_program_runs_as_a_process() -> None:
    program = re.findall(r"```python\n(.*?)```", README, re.DOTALL)[0]
    result = ended(program)
    assert result.returncode == 0, result.stderr
    assert len(result.stdout.splitlines()) >= 1


@pytest.mark.parametrize("command", MEASURED_BY)
def test_the_commands_that_print_the_figures_are_there(command: str) -> None:
    options = measuring.parser().parse_args(command.split())
    assert set(options.only.split(",")) <= set(measuring.BENCHMARKS)


def test_figures_name_their_commands() -> None:
    assert len(MEASURED_BY) >= 6
    measured = README[README.index("## Measured") : README.index("## Limits")]
    rows = [line for line in measured.splitlines() if line.startswith("| ") and re.search(r"\d", line)]
    assert len(rows) >= 5
    for row in rows:
        assert "`python -m benchmarks" in row, row
    for path in re.findall(r"`python -m pytest ([^`]*)`", MEASURING):
        for word in path.split():
            assert (ROOT / word).exists()


def test_every_benchmark_is_told_once() -> None:
    told = (ROOT / "benchmarks" / "README.md").read_text(encoding="utf-8")
    table = told[told.index("| benchmark |") : told.index("## Results")]
    rows = re.findall(r"^\| (\w+) \|", table, re.MULTILINE)[1:]
    assert sorted(rows) == sorted(measuring.BENCHMARKS)


def test_it_is_short_and_begins_with_two_commands_and_what_pip_needs_beside_them() -> None:
    assert len(README.splitlines()) < 120
    assert README.index("make demo") < README.index("make test") < README.index("```python")
    for line in README.splitlines():
        if "make demo" in line or "`make test`" in line:
            assert "pip install -e '.[" in line
    makefile = (ROOT / "Makefile").read_text(encoding="utf-8")
    for target in re.findall(r"`make (\w+)`", MEASURING):
        assert re.search(rf"^{target}:", makefile, re.MULTILINE), target


def test_the_version_is_in_the_changelog() -> None:
    from lidario import __version__

    assert __version__ in (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")
    assert re.fullmatch(r"\d+\.\d+\.\d+", __version__)
