"""Starts the processes a live benchmark is made of, and talks JSON with them: players, readers, adapters."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import TracebackType
from typing import Any, Self

__all__ = ["ROOT", "Failed", "Player", "run_json", "started"]

ROOT = Path(__file__).resolve().parent.parent
_PATIENCE_S = 20.0


class Failed(Exception):
    """A process ended without a response; the text says why, on one line."""


class Player:
    """A process that plays devices of one kind; see `benchmarks.player`.

    Attributes:
        paths: The pseudo-terminals, one a device.
    """

    def __init__(
        self,
        rate: str,
        count: int = 1,
        *,
        delivery: int = 64,
        every: float = 0.0,
        speed: int = 1,
        holds: int = 0,
    ) -> None:
        command = [sys.executable, "-m", "benchmarks.player", rate, "--count", str(count)]
        command += ["--delivery", str(delivery), "--every", str(every), "--speed", str(speed)]
        command += ["--holds", str(holds)]
        self._process = subprocess.Popen(
            command, cwd=ROOT, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, bufsize=1
        )
        self.paths: list[str] = self._response()

    def report(self) -> dict[str, Any]:
        """What was played since the last report; afterwards all devices are as new."""
        assert self._process.stdin is not None
        self._process.stdin.write("\n")
        self._process.stdin.flush()
        report: dict[str, Any] = self._response()
        return report

    def close(self) -> None:
        """End the process."""
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        self._process.stdin.close()
        try:
            self._process.wait(_PATIENCE_S)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
        self._process.stdout.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def _response(self) -> Any:
        assert self._process.stdout is not None
        line = self._process.stdout.readline()
        if not line:
            raise Failed("the player ended")
        return json.loads(line)


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
