"""What the README shows works as it stands there."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import pytest

from benchmarks import __main__ as measuring
from tests.cli.processes import invoke_driven

ROOT = Path(__file__).parent.parent
README = (ROOT / "README.md").read_text()
PATIENCE_S = 60.0
PYTHON = re.findall(r"```python\n(.*?)```", README, re.DOTALL)
COMMANDS = [
    line.split("#")[0].removeprefix("$ lidario").split()
    for block in re.findall(r"```console\n(.*?)```", README, re.DOTALL)
    for line in block.splitlines()
]


MEASURED_BY = sorted(
    set(
        re.findall(
            r"^ {4}python -m benchmarks (.*)$|`python -m benchmarks ([^`]*)`",
            README + (ROOT / "docs" / "reliability.md").read_text(),
            re.MULTILINE,
        )
    )
)


@pytest.fixture
def _in_memory(monkeypatch: pytest.MonkeyPatch) -> None:
    """Simulated lidars are in memory where nothing else is said. Only the first program takes the whole path."""
    monkeypatch.setattr("lidario.port.simulated._way", lambda source: source.options.get("via", "memory"))


def test_the_first_program_runs_as_a_process() -> None:
    result = subprocess.run(
        [sys.executable, "-W", "error", "-c", PYTHON[0]],
        capture_output=True, text=True, timeout=PATIENCE_S, cwd=ROOT, check=False,
    )  # fmt: skip
    assert result.returncode == 0, result.stderr
    assert len(result.stdout.splitlines()) >= 1


@pytest.mark.usefixtures("_in_memory")
@pytest.mark.parametrize("program", PYTHON[1:], ids=range(1, len(PYTHON)))
def test_programs_run(program: str, capsys: pytest.CaptureFixture[str]) -> None:
    exec(compile(program, "the program", "exec"), {"__name__": "__main__"})
    assert capsys.readouterr().out


@pytest.mark.usefixtures("_in_memory")
@pytest.mark.parametrize("words", COMMANDS, ids=" ".join)
def test_commands_run(words: list[str]) -> None:
    result = invoke_driven(*words)
    # `devices` finds none where none is plugged in.
    assert result.exit_code == (3 if words == ["devices"] and "no lidar" in result.stderr else 0), result.stderr


@pytest.mark.parametrize("command", ["".join(found) for found in MEASURED_BY])
def test_the_commands_that_print_its_figures_are_there(command: str) -> None:
    options = measuring.parser().parse_args(command.split())
    assert set(options.only.split(",")) <= set(measuring.BENCHMARKS)


def test_figures_name_their_commands() -> None:
    assert len(MEASURED_BY) >= 2
    for path in re.findall(r"`python -m pytest ([^`]*)`", README):
        assert (ROOT / path).exists()


def test_every_file_it_names_is_there() -> None:
    for target in re.findall(r"\]\(([^)#:]+)\)", README):
        assert (ROOT / target).exists(), target


def test_the_two_commands_come_first_and_the_wrong_package_never() -> None:
    assert README.index("make demo") < README.index("make test") < README.index("## What you can rely on")
    assert not re.search(r"pip install ['\"]?lidario(?!-asyncio)", README)
    makefile = (ROOT / "Makefile").read_text()
    for target in re.findall(r"`make (\w+)`", README):
        assert re.search(rf"^{target}:", makefile, re.MULTILINE), target


def test_the_version_is_in_the_changelog() -> None:
    from lidario import __version__

    assert __version__ in (ROOT / "CHANGELOG.md").read_text()
    assert re.fullmatch(r"\d+\.\d+\.\d+", __version__)
