"""Running the command: in this process, or as one of its own; and a simulated device whose log can be read.

`invoke_driven` is for simulated devices in memory. The clock is driven, so the command waits for nothing, and how
busy the machine is decides nothing: on a true clock, a scan that takes long to print lets the next one be dropped.
"""

import signal
import subprocess
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from typing import Any

import pytest
from click.testing import CliRunner, Result

from lidario.cli.main import cli
from lidario.cli.output import Worker
from lidario.families.registry import family_of_simulated
from lidario.sim.serve import PtyServer
from tests.support import children
from tests.support.children import BOUND, finished
from tests.support.loop import DrivenLoop
from tests.support.speeds import SpeedPtyServer


def invoke(*arguments: str, code: int | None = None, charset: str = "utf-8") -> Result:
    """Run the command in this process; it must end with the exit code, where one is given."""
    done = CliRunner(charset).invoke(cli, list(arguments), env={"COLUMNS": "80", "NO_COLOR": "1"})
    assert code in (None, done.exit_code), (done.exit_code, done.stderr)
    return done


def invoke_driven(*arguments: str, code: int | None = None, charset: str = "utf-8") -> Result:
    """Run the command in this process, on a driven clock; for sources with ``via=memory`` alone."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("asyncio.events.new_event_loop", DrivenLoop)
        # A driven clock does not wait for the thread that usually writes.
        patch.setattr(Worker, "call", call_at_once)
        return invoke(*arguments, code=code, charset=charset)


def in_memory(model: str, *options: str) -> str:
    """The source of a simulated model in memory; named where what it sends would be taken for another's."""
    named = {"ydlidar-tx8": ["model=tx8"], "ydlidar-s4b": ["model=s4b"]}.get(model, [])
    return f"sim://{model}?{'&'.join(['via=memory', *options, *named])}"


def run(*arguments: str, **streams: Any) -> subprocess.CompletedProcess[str]:
    """Run the command as a process, to its end; with another `environment` and other `streams` than pipes, too."""
    return finished("-m", "lidario", *arguments, **streams)


def started(*arguments: str) -> AbstractContextManager[subprocess.Popen[str]]:
    """Start the command as a process; at the end of the block it is gone."""
    return children.started("-m", "lidario", *arguments)


@contextmanager
def served(model: str) -> Iterator[PtyServer]:
    """A simulated device on a pseudo-terminal, in this process; its rotor needs no time to speed up."""
    device = family_of_simulated(model).simulate(model, world=None, serial=None, seed=0)
    device.spin_up_s = 0.0  # type: ignore[attr-defined]
    with SpeedPtyServer(device) as server:
        yield server


def end(process: subprocess.Popen[str], number: signal.Signals = signal.SIGINT) -> tuple[str, str]:
    """End a process by a signal; what else it printed, to stdout and to stderr."""
    process.send_signal(number)
    return process.communicate(timeout=BOUND)


async def call_at_once(_: Worker, work: Callable[[], object]) -> None:
    work()
