"""The script for bash, in an interactive bash: readline divides the words, and replaces what was typed."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from tests.cli.processes import ROOT, invoke
from tests.cli.test_watch import Screen

PROMPT = "tell me> "


TYPED = [
    # bash divides words at ":".
    ("lidario scan sim://ydlidar-4ros-sl", "lidario scan sim://ydlidar-4ros-slow "),
    ("lidario scan 'sim://ydlidar-4ros-sl", "lidario scan 'sim://ydlidar-4ros-slow' "),
    ("lidario info sim:", "lidario info sim://"),
    ("lidario motor stop sim://ydlidar-4ros-sl", "lidario motor stop sim://ydlidar-4ros-slow "),
    ("lidario stats sim://rplidar-s2 --js", "lidario stats sim://rplidar-s2 --json "),
    ("lidario info a_rec", "lidario info a_recording.mcap "),
]


@pytest.mark.exhaustive("word", sample=[TYPED[0], TYPED[-1]], full=TYPED)
def test_a_word_is_completed(tmp_path: Path, word: tuple[str, str]) -> None:
    typed, completed = word
    (tmp_path / "a_recording.mcap").touch()
    command = tmp_path / "bin" / "lidario"
    command.parent.mkdir()
    command.write_text(f'#!/bin/sh\nexec "{sys.executable}" -m lidario "$@"\n')
    command.chmod(0o755)
    start = tmp_path / "start"
    start.write_text(invoke("completion", "bash").stdout + f"PS1='{PROMPT}'\nbind 'set bell-style none'\n")
    ours, theirs = os.openpty()
    with os.fdopen(ours, "rb", buffering=0):
        bash = subprocess.Popen(
            ["bash", "--noprofile", "--rcfile", str(start), "-i"],
            cwd=tmp_path, stdin=theirs, stdout=theirs, stderr=theirs, start_new_session=True,
            env={"PATH": f"{command.parent}:{os.environ['PATH']}", "PYTHONPATH": str(ROOT), "TERM": "dumb"},
        )  # fmt: skip
        os.close(theirs)
        try:
            screen = Screen(ours)
            screen.until(PROMPT)
            os.write(ours, f"{typed}\t".encode())
            assert screen.until(completed).endswith(completed)
        finally:
            bash.send_signal(signal.SIGKILL)
            bash.wait()
