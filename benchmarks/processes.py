"""Starts the processes a live benchmark is made of, and talks JSON with them: players, readers, adapters."""

from __future__ import annotations

import contextlib
import json
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import TracebackType
from typing import Any, Self

ROOT = Path(__file__).resolve().parent.parent
_PATIENCE_S = 20.0


class Failed(Exception):
    """A process ended without a response; the text says why, on one line."""


class Responder:
    """A process that responds to each line on its standard input with one of JSON, and ends with it.

    Args:
        command: The command.
        folder: Its working directory.
        environment: Its environment; None for ours.
    """

    def __init__(self, command: list[str], folder: Path = ROOT, environment: dict[str, str] | None = None) -> None:
        self._process = subprocess.Popen(
            command, cwd=folder, env=environment, bufsize=1, text=True,
            stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE,
        )  # fmt: skip

    def ask(self, line: str = "") -> Any:
        """What it responds to a line.

        Raises:
            Failed: It has ended.
        """
        assert self._process.stdin is not None
        with contextlib.suppress(BrokenPipeError):
            self._process.stdin.write(line + "\n")
        return self.response()

    def response(self) -> Any:
        """The next line that it says; Failed: it has ended."""
        assert self._process.stdout is not None
        assert self._process.stderr is not None
        line = self._process.stdout.readline()
        if not line:
            raise Failed(["it ended", *self._process.stderr.read().strip().splitlines()][-1])
        return json.loads(line)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        try:
            self._process.communicate(timeout=_PATIENCE_S)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.communicate()


class Player(Responder):
    """A process that plays devices of one kind; see `benchmarks.player`.

    Attributes:
        paths: The pseudo-terminals, one a device; by `tcp`, the sources of their bridges.
    """

    def __init__(
        self, rate: str, count: int = 1, *, every: float = 0.0, speed: int = 1, holds: int = 0, tcp: bool = False
    ) -> None:
        told = [rate, "--count", str(count), "--every", str(every), "--speed", str(speed), "--holds", str(holds)]
        told += ["--tcp"] if tcp else []
        super().__init__([sys.executable, "-m", "benchmarks.player", *told])
        self.paths: list[str] = self.response()

    def report(self) -> dict[str, Any]:
        """What was played since the last report; afterwards all devices are as new."""
        report: dict[str, Any] = self.ask()
        return report


@contextmanager
def started(module: str, *arguments: str) -> Iterator[tuple[subprocess.Popen[str], str]]:
    """A module that runs until the block ends, and prints a line when it has begun: the process, and that line.

    Raises:
        Failed: It ended before.
    """
    with subprocess.Popen(
        [sys.executable, "-m", module, *arguments],
        cwd=ROOT, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True,
    ) as process:  # fmt: skip
        assert process.stdout is not None
        try:
            line = process.stdout.readline().strip()
            if not line:
                raise Failed(f"{' '.join((module, *arguments[:1]))} did not begin")
            yield process, line
        finally:
            process.terminate()


def run_json(
    command: list[str],
    *,
    timeout: float,
    environment: dict[str, str] | None = None,
    given: object = None,
    folder: Path = ROOT,
) -> dict[str, Any]:
    """Run a command that prints one line of JSON as its last, and return it.

    Args:
        command: The command.
        timeout: Seconds after which it is killed.
        environment: Its environment; None for ours.
        given: What is passed to it as JSON, as its last argument.
        folder: Its working directory.

    Raises:
        Failed: It printed none, or took too long; the text is the last line it complained with.
    """
    command = command if given is None else [*command, json.dumps(given)]
    try:
        done = subprocess.run(
            command, cwd=folder, capture_output=True, text=True, timeout=timeout, env=environment, check=False
        )
    except subprocess.TimeoutExpired:
        raise Failed(f"no result within {timeout:g} s") from None
    lines = done.stdout.strip().splitlines()
    try:
        result: dict[str, Any] = json.loads(lines[-1])
    except (IndexError, ValueError):
        complaint = done.stderr.strip().splitlines()
        raise Failed(complaint[-1] if complaint else f"ended with {done.returncode}, said nothing") from None
    if "failed" in result:
        raise Failed(result["failed"])
    return result
