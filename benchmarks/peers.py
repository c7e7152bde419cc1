"""Sets up the other drivers: ``benchmarks/.peers``, a virtual environment and a folder for each.

Two of them are imported by the same name, so each gets a folder of its own, and the one environment holds what
they need: pyserial, pyserial-asyncio for the plain reader, numpy, matplotlib for the plots. Each is installed by
itself, without what it asks for on top: where that fails the driver is absent, by name and with the reason.
"""

from __future__ import annotations

import os
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from benchmarks.processes import ROOT, Failed, run_json

_HOME = ROOT / "benchmarks" / ".peers"
_REQUIREMENTS = ROOT / "benchmarks" / "requirements-peers.txt"
_COMMON = ("numpy", "pyserial", "pyserial-asyncio", "matplotlib")
_TIMEOUT_S = 300.0


@dataclass(frozen=True, slots=True)
class Peer:
    """One of the other drivers.

    Attributes:
        name: Its name on PyPI.
        version: The version asked for; empty for any.
        folder: Where it is installed.
        absent: Why it is not there; empty when it is.
    """

    name: str
    version: str
    folder: Path
    absent: str


class Peers:
    """All other drivers, and how to run one."""

    def __init__(self, peers: list[Peer], absent: str) -> None:
        self._peers = {peer.name: peer for peer in peers}
        self._absent = absent

    @property
    def all(self) -> list[Peer]:
        """Every driver that was asked for, absent or not."""
        return list(self._peers.values())

    def why_absent(self, name: str) -> str:
        """Why a driver cannot take part; empty when it can. ``plain`` is not on PyPI but ours."""
        peer = self._peers.get(name)
        return self._absent or (peer.absent if peer else "")

    def command(self, adapter: str, *arguments: str) -> list[str]:
        """The command that runs one of our adapters in their environment, from the root of the repository."""
        return [str(_python()), "-m", f"benchmarks.adapters.{adapter}", *arguments]

    def ask(self, contestant: str, adapter: str, task: dict[str, Any], *, timeout: float) -> dict[str, Any]:
        """What an adapter prints that does `task` with a driver.

        Args:
            contestant: The name of the driver, with what our adapters tell its ways apart by.
            adapter: The adapter.
            task: What it is to do.
            timeout: Seconds after which it is killed.

        Raises:
            Failed: It is absent, or did not get through; the text says why.
        """
        name = package_of(contestant)
        if why := self.why_absent(name):
            raise Failed(why)
        peer = self._peers.get(name)
        environment = os.environ | {"PYTHONPATH": str(peer.folder) if peer else ""}
        given = {**task, "contestant": contestant}
        return run_json(self.command(adapter), timeout=timeout, environment=environment, given=given)


def package_of(contestant: str) -> str:
    """What it is called on PyPI: one of them reads two families, in two ways."""
    return contestant.removesuffix("-4ros")


def set_up() -> Peers:
    """Install what is not there yet; takes a minute the first time and nothing afterwards."""
    wanted = [line.strip() for line in _REQUIREMENTS.read_text().splitlines() if line and not line.startswith("#")]
    why = "" if _python().exists() else _run(sys.executable, "-m", "venv", str(_HOME / "venv"))
    ready = _HOME / "venv" / ".ready"
    if not why and not ready.exists():
        why = _pip(*_COMMON)
        if not why:
            ready.touch()
    return Peers([_peer(line, why) for line in wanted], f"no environment for it: {why}" if why else "")


def _peer(requirement: str, why: str) -> Peer:
    name, _, version = requirement.partition("==")
    folder = _HOME / name
    ready = folder / ".ready"
    if not why and not ready.exists():
        why = _pip("--no-deps", "--upgrade", "--target", str(folder), requirement)
        if not why:
            ready.touch()
    return Peer(name, version, folder, why)


def _python() -> Path:
    return _HOME / "venv" / ("Scripts" if os.name == "nt" else "bin") / "python"


def _pip(*arguments: str) -> str:
    return _run(str(_python()), "-m", "pip", "install", "--quiet", "--disable-pip-version-check", *arguments)


def _run(*command: str) -> str:
    """Run a command; empty when it worked, else the line that tells why not."""
    try:
        done = subprocess.run(command, capture_output=True, text=True, timeout=_TIMEOUT_S, check=False)
    except subprocess.TimeoutExpired:
        return f"not installed within {_TIMEOUT_S:g} s"
    if done.returncode == 0:
        return ""
    errors = [line for line in done.stderr.splitlines() if "error" in line.lower()]
    return (errors or done.stderr.splitlines() or [f"ended with {done.returncode}"])[-1].strip()
