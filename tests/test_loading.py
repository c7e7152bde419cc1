"""A Ctrl-C while the library loads numpy, at the first use of a name: the program can go on."""

from __future__ import annotations

import os
import subprocess
import sys
import threading
from pathlib import Path

import pytest

from lidario.loading import load
from tests.support.children import until
from tests.support.interrupt import interrupted

ROOT = Path(__file__).parent.parent
PROGRAM = """
import os, signal, sys, threading
import lidario

interrupted = threading.Event()

def interrupt(event, arguments):
    if event == "import" and arguments[0] == "numpy.exceptions" and not interrupted.is_set():
        interrupted.set()
        os.kill(os.getpid(), signal.SIGINT)

sys.addaudithook(interrupt)
try:
    {use}
    raise SystemExit("it was not interrupted")
except KeyboardInterrupt:
    pass
import numpy
assert lidario.Scan and lidario.open_lidar and lidario.open_sync
from lidario.testing import make_scan
assert make_scan([0.0], [0.5]).nearest().range == 0.5
print("it goes on")
"""


@pytest.mark.long
@pytest.mark.parametrize(
    "use", ["lidario.Scan", "from lidario.testing import make_scan", "from lidario.ros import pointcloud2"]
)
def test_a_program_that_was_interrupted_goes_on(use: str) -> None:
    ended = subprocess.run(
        [sys.executable, "-W", "error", "-c", PROGRAM.format(use=use)],
        cwd=ROOT, env={**os.environ, "PYTHONPATH": str(ROOT)}, capture_output=True, text=True, timeout=60,
        check=False,
    )  # fmt: skip
    assert (ended.returncode, ended.stdout) == (0, "it goes on\n"), ended.stderr


def test_an_import_that_fails_fails_as_always(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delitem(sys.modules, "numpy")
    with pytest.raises(ModuleNotFoundError, match=r"lidario\.nothing"):
        load("lidario.nothing")
    assert load("lidario.errors").Busy


def test_ctrl_c_at_every_line_of_the_waiting(monkeypatch: pytest.MonkeyPatch) -> None:
    """The import goes on in its thread, wherever the waiting ends; a thread that fails would fail this test."""
    monkeypatch.delitem(sys.modules, "numpy")
    line = 0
    while interrupted_at(line):
        line += 1
    assert line > 8
    until(lambda: not any(thread.name == "lidario: import" for thread in threading.enumerate()))


def interrupted_at(line: int) -> bool:
    """Whether loading has so many lines; at that one it was interrupted."""
    try:
        interrupted(line, lambda: load("lidario.errors"))
    except KeyboardInterrupt:
        return True
    return False
