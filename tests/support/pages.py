"""Runs what a page of the documentation shows: programs, files, commands, in their order, in one folder.

The machine that the pages are about has two lidars, ``/dev/ttyUSB0`` and ``/dev/ttyUSB1``, and ``auto`` is the
first. Here both are simulated ones in memory, whose rotors need no time, and event loops of the main thread have a
fast clock. So a page takes as long as its programs compute.

- A ``python`` block with a title is a file. Without one it runs at once, and knows the names of the blocks before
it.
- A line of a ``console`` block that begins with ``$`` is a command; the lines below it are what it prints, in which
  numbers may differ and spaces do not count.
- Commands that run until Ctrl-C (`ENDLESS`) are only read as the command line reads them; tests/cli runs them, and
  tests/ros those that need a network.
"""

import asyncio
import os
import re
import runpy
import shlex
import shutil
import subprocess
import sys
import threading
import tomllib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple

import click
import pytest

from lidario.basics.source import Source, as_source
from lidario.cli.main import cli
from lidario.cli.output import Worker
from lidario.testing.clock import clock_of
from tests.cli.processes import call_at_once, invoke
from tests.support.inner import ASYNCIO_INI, forgetting, run_pytest

ROOT = Path(__file__).parents[2]
PACE = 1000.0
PORTS = {
    "/dev/ttyUSB0": "sim://rplidar-s2",
    "/dev/ttyUSB1": "sim://ydlidar-4ros",
    "auto": "sim://rplidar-s2",
    "serial:///dev/ttyUSB0?model=tx8": "sim://ydlidar-tx8?model=tx8",
}
ENDLESS = {"view", "watch", "play", "sim", "publish"}
ENDLESS_PROGRAMS = {"robot.py"}
"""Copies of examples that run until Ctrl-C; tests/test_examples_under_faults.py runs them."""
NOTHING_TO_RUN = {"sudo", "ssh", "jupyter", "uvicorn", "source"}
"""What is not ours and changes the machine, or serves until Ctrl-C."""
PROCESS_BOUND_S = 120
_FENCE = re.compile(r"^( *)```(\w+)([^\n]*)\n(.*?)^\1```", re.DOTALL | re.MULTILINE)


class Block(NamedTuple):
    """A block of a page."""

    kind: str  # ``python``, ``console``,
    title: str  # name of the file that it is; else empty
    text: str  # what stands in it


def blocks(text: str) -> list[Block]:
    """Every fenced block of a page."""
    found = []
    for indent, kind, options, body in _FENCE.findall(text):
        title = re.search(r'title="([^"]+)"', options)
        lines = [line.removeprefix(indent) for line in body.splitlines(keepends=True)]
        found.append(Block(kind, title[1] if title else "", "".join(lines)))
    return found


@contextmanager
def _fast_machine() -> Iterator[None]:
    """The machine that the pages are about."""
    from lidario.port import simulated
    from lidario.session import opening

    make = simulated.make_device
    new_loop = asyncio.events.new_event_loop

    def make_ready(source: Source) -> Any:
        device, faults = make(source)
        device.spin_up_s = 0.0  # type: ignore[attr-defined]
        return device, faults

    def plugged_in(source: Any) -> Source:
        return as_source(PORTS.get(source, source) if isinstance(source, str) else source)

    def fast_loop() -> asyncio.AbstractEventLoop:
        loop = new_loop()
        # Without await, time would run ahead of the program that reads.
        clock = clock_of(loop) if threading.current_thread() is threading.main_thread() else None
        if clock is not None:
            clock.set(PACE)
        return loop

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(simulated, "make_device", make_ready)
        patch.setattr(simulated, "usual_way", lambda _: "memory")
        patch.setattr(opening, "as_source", plugged_in)
        patch.setattr("asyncio.events.new_event_loop", fast_loop)
        patch.setattr(Worker, "call", call_at_once)
        yield


class Page:
    """One page that is being run in a folder."""

    def __init__(self, text: str, folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
        self.blocks = blocks(text)
        self.said = ""
        self._folder = folder
        self._capsys = capsys
        self._names: dict[str, Any] = {"__name__": "__main__"}

    def run(self) -> None:
        """Run every block; an AssertionError says which command does not do what the page says."""
        with forgetting(self._folder), _fast_machine():
            self._run()

    def _run(self) -> None:
        for number, block in enumerate(self.blocks):
            if block.kind == "python":
                self._python(block, f"block {number}")
            elif block.kind in ("ini", "toml"):
                assert block.title, f"block {number} is a file without a name"
                self._write(block)
            elif block.kind == "console":
                self._console(block.text)

    def _write(self, block: Block) -> None:
        path = self._folder / block.title
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(block.text, encoding="utf-8")

    def _python(self, block: Block, name: str) -> None:
        if block.title:
            self._write(block)
        elif "processes" in block.text:  # a file, since its processes import it
            self._write(Block("python", "many.py", block.text))
            self._process("many.py")
        else:
            exec(compile(block.text, name, "exec"), self._names)
            self.said += self._capsys.readouterr().out

    def _console(self, text: str) -> None:
        said = ""
        for line in text.splitlines():
            if line.startswith("$ "):
                said = self._command(shlex.split(line[2:], comments=True))
                self.said += said
            elif line.strip():
                assert _plain(line) in _plain(said), f"{line!r} is not printed, but:\n{said}"

    def _command(self, words: list[str]) -> str:
        if words[0] == "lidario":
            return self._lidario(words[1:])
        if words[0] == "cp":
            shutil.copy(ROOT / words[1], self._folder / words[2])
            return ""
        if words[0] in ("python", "python3"):
            return self._program(words[1:])
        if words[0] == "pytest":
            return self._pytest(words[1:])
        if words[0] in ("pip", "pipx"):
            _check_packages(words)
        elif words[0] == "make":
            assert re.search(rf"^{words[1]}:", (ROOT / "Makefile").read_text(encoding="utf-8"), re.MULTILINE)
        else:
            assert words[0] in NOTHING_TO_RUN, f"nobody knows how to test {words}"
        return ""

    def _lidario(self, words: list[str]) -> str:
        listing = "--list" in words or "--list-faults" in words
        # Another machine's lidars: tests/ros runs these.
        network = any("zenoh" in word for word in words)
        if words and (words[0] in ENDLESS or network) and not listing:
            command = cli.get_command(click.Context(cli), words[0])
            assert command is not None
            command.make_context(words[0], words[1:])
            return ""
        if words[:1] == ["calibrate"]:
            words = [*words, "-n", "2"]  # twenty scans take ten times as long, and show no more here
        if "-j" in words:
            return self._process("-m", "lidario", *words)
        done = invoke(*words)
        none_there = words[:1] == ["devices"] and done.exit_code == 3 and "no lidar" in done.stderr
        assert done.exit_code == 0 or none_there, f"{words}: {done.stderr}"
        return done.stdout + done.stderr

    def _program(self, words: list[str]) -> str:
        if words[0] == "-m":
            assert words[1] in ("benchmarks", "venv", "benchmarks.pictures"), words
            return ""
        if words[0] in ENDLESS_PROGRAMS:
            assert (self._folder / words[0]).is_file()
            return ""
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(sys, "argv", words)
            runpy.run_path(str(self._folder / words[0]), run_name="__main__")
        return self._capsys.readouterr().out

    def _process(self, *words: str) -> str:
        done = subprocess.run(
            [sys.executable, *words], capture_output=True, text=True, timeout=PROCESS_BOUND_S, check=False,
            cwd=self._folder, env=_environment(),
        )  # fmt: skip
        assert done.returncode == 0, f"{words}: {done.stderr}"
        self.said += done.stdout
        return done.stdout + done.stderr

    def _pytest(self, words: list[str]) -> str:
        if not (self._folder / "pytest.ini").exists():
            (self._folder / "pytest.ini").write_text(ASYNCIO_INI, encoding="utf-8")
        ran = run_pytest(self._folder, "-p", "no:anyio", *words)
        assert ran.code == 0, ran.text
        return ran.text


def _plain(text: str) -> str:
    # Serial numbers; the digits behind a point are no such one, however many they are.
    text = re.sub(r"(?<![.0-9A-F])[0-9A-F]{16,}", "#", re.sub(r"\s+", "", text))
    return re.sub(r"[-+]?\d+(\.\d+)?", "#", text)


def _environment() -> dict[str, str]:
    return {**os.environ, "PYTHONPATH": str(ROOT)}


def _check_packages(words: list[str]) -> None:
    """What is to be installed of ours is the distribution with extras that it has; never the name of another."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    for word in words[2:]:
        match = re.fullmatch(r"(\.|lidario[\w-]*)(?:\[([\w,]+)\])?", word)
        if match is not None:
            assert match[1] in (".", project["name"]), word
            assert set((match[2] or "").split(",")) - {""} <= set(project["optional-dependencies"]), word
