"""`--guard`: a verb that is killed leaves laser and motor off, and no process."""

import subprocess
from pathlib import Path
from typing import Any

import pytest

from lidario.sim.serve import PtyServer
from tests.cli.processes import served, started
from tests.cli.terminals import on_terminal
from tests.support.children import BOUND, guards_of, is_still, until

pytestmark = pytest.mark.discards(
    "a guard cannot know what the killed program has just written, so it writes again"
)

VERBS = {
    "scan": ("-n", "0", "--reconnect"),
    "stats": ("-t", "60s"),
    "record": ("-o", "run.mcap"),
    "view": ("--port", "0"),
    "publish": ("--zenoh", "here", "--router", "tcp/127.0.0.1:1"),
}


def killed(process: subprocess.Popen[Any], server: PtyServer) -> None:
    """Kill it once it scans."""
    until(lambda: not is_still(server) or process.poll() is not None)
    assert len(guards_of(process.pid)) == 1
    process.kill()
    process.communicate(timeout=BOUND)
    until(lambda: not guards_of(process.pid))
    until(lambda: is_still(server))


@pytest.mark.long
@pytest.mark.exhaustive("verb", sample=["scan", "view"], full=VERBS)
def test_a_verb_that_is_killed(verb: str, tmp_path: Path) -> None:
    options = [str(tmp_path / each) if each.endswith(".mcap") else each for each in VERBS[verb]]
    with served("rplidar-s2") as server, started(verb, server.path, *options, "--guard") as process:
        killed(process, server)


@pytest.mark.long
def test_on_a_terminal() -> None:
    with served("rplidar-s2") as server, on_terminal("watch", server.path, "--guard") as (process, _, _):
        killed(process, server)
