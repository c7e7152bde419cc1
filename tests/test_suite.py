"""What watches every test can itself fail: each kind of thing left behind makes a test fail."""

from __future__ import annotations

import asyncio
import os
import re
import subprocess
import sys
import threading
from pathlib import Path

import pytest

from tests.support import leaks
from tests.support.leaks import leaves_no_task, leaves_nothing

ROOT = Path(__file__).parent.parent
PATIENCE_S = 60.0
CULPRITS = """
import asyncio
import os


def test_innocent() -> None:
    pass


async def test_innocent_and_async() -> None:
    await asyncio.create_task(asyncio.sleep(0))


def test_leaves_a_file() -> None:
    os.open(os.devnull, os.O_RDONLY)


async def test_leaves_a_task() -> None:
    asyncio.get_running_loop().task = asyncio.create_task(asyncio.sleep(60))
"""
CAUGHT = {"test_leaves_a_file", "test_leaves_a_task"}
if not Path(leaks.FOLDER).is_dir():
    CAUGHT.remove("test_leaves_a_file")  # the system does not tell


@pytest.fixture
def _impatient(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(leaks, "GRACE_S", 0.05)


@pytest.mark.usefixtures("_impatient")
def test_a_thread_left_behind_is_found() -> None:
    go = threading.Event()
    thread = threading.Thread(target=go.wait, args=(PATIENCE_S,), name="the culprit")
    with pytest.raises(AssertionError, match="the culprit"), leaves_nothing():
        thread.start()
    go.set()
    thread.join()


def test_a_thread_that_is_about_to_end_is_waited_for() -> None:
    go = threading.Event()
    threading.Thread(target=go.wait, args=(PATIENCE_S,)).start()
    with leaves_nothing():
        second = threading.Thread(target=go.wait, args=(PATIENCE_S,))
        second.start()
        threading.Timer(0.05, go.set).start()
    assert not second.is_alive()


@pytest.mark.usefixtures("_impatient")
def test_a_descriptor_left_behind_is_found(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    # A folder of links like /proc/self/fd, since not every system has that.
    monkeypatch.setattr(leaks, "FOLDER", str(tmp_path))
    with pytest.raises(AssertionError, match=r"7 -> .*culprit"), leaves_nothing():
        (tmp_path / "7").symlink_to("culprit")


async def test_a_task_left_behind_is_found() -> None:
    left: list[asyncio.Task[None]] = []

    async def culprit() -> None:
        left.append(asyncio.create_task(asyncio.sleep(PATIENCE_S), name="the culprit"))

    with pytest.raises(AssertionError, match="the culprit"):
        await leaves_no_task(culprit)()
    left[0].cancel()
    await asyncio.wait(left)


def test_the_suite_watches_every_test(tmp_path: Path) -> None:
    """The conftest of the suite, with tests that leave something behind."""
    conftest = ROOT / "tests" / "conftest.py"
    impatient = "\n\nfrom tests.support import leaks\n\nleaks.GRACE_S = 0.05\n"
    (tmp_path / "conftest.py").write_text(conftest.read_text(encoding="utf-8") + impatient, encoding="utf-8")
    (tmp_path / "test_culprits.py").write_text(CULPRITS, encoding="utf-8")
    ended = subprocess.run(
        [sys.executable, "-m", "pytest", "-c", str(ROOT / "pyproject.toml"), "--rootdir", str(tmp_path),
         "-p", "no:cacheprovider", "-rA", str(tmp_path)],
        cwd=tmp_path, env={**os.environ, "PYTHONPATH": str(ROOT)},
        capture_output=True, text=True, timeout=PATIENCE_S, check=False,
    )  # fmt: skip
    # A test whose fixture fails after it is reported as passed, and as an error.
    told = re.findall(r"^(PASSED|FAILED|ERROR) \S+::(test_\w+)", ended.stdout, re.MULTILINE)
    assert {name for outcome, name in told if outcome != "PASSED"} == CAUGHT, ended.stdout
    assert {name for _, name in told} > CAUGHT
