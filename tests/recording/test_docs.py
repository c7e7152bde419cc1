"""What docs/recordings.md shows works as it stands there, in its order, in one folder."""

from __future__ import annotations

import os
import re
import shlex
import subprocess
import sys
from pathlib import Path

import pytest

from tests.cli.processes import invoke

ROOT = Path(__file__).parents[2]
TEXT = (ROOT / "docs" / "recordings.md").read_text(encoding="utf-8")
BLOCKS = re.findall(r"```(console|python)\n(.*?)```", TEXT, re.DOTALL)
BOUND_S = 120


def run(folder: Path, *words: str) -> str:
    done = subprocess.run(
        [sys.executable, *words],
        cwd=folder, capture_output=True, text=True, timeout=BOUND_S, check=False,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
    )  # fmt: skip
    assert done.returncode == 0, f"{words}: {done.stderr}"
    return done.stdout + done.stderr


def test_every_command_and_program_runs(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    said = ""
    for number, (kind, text) in enumerate(BLOCKS):
        if kind == "python" and "processes" in text:
            program = tmp_path / f"program{number}.py"  # a file, since its processes import it
            program.write_text(text, encoding="utf-8")
            said += run(tmp_path, str(program))
        elif kind == "python":
            exec(compile(text, f"program {number}", "exec"), {"__name__": "__main__"})
            said += capsys.readouterr().out
        for line in text.splitlines() if kind == "console" else ():
            words = shlex.split(line.removeprefix("$ lidario"), comments=True)
            if "-j" in words:
                said += run(tmp_path, "-m", "lidario", *words)
                continue
            # In this process: starting one takes longer than most of them.
            done = invoke(*words)
            assert done.exit_code == 0, f"{words}: {done.stderr}"
            said += done.stdout
    assert len(BLOCKS) >= 7
    assert re.search(r"^\d+ None 0$", said, re.MULTILINE)
    # What the program on many files prints.
    found = re.findall(r"^(\S+\.mcap) (\d+) scans, ([0-9.]+) m$", said, re.MULTILINE)
    assert [name for name, _, _ in found] == ["mine.mcap", "ros.mcap", "run.mcap", "with_scans.mcap"]
    assert all(int(scans) >= 2 and 1 < float(metres) < 12 for _, scans, metres in found)
    assert {path.name for path in tmp_path.glob("scans-*.npz")} == {"scans-run.npz", "scans-ros.npz"}
