"""Interactive shells on a pseudo-terminal, in which a word is typed and completed."""

import contextlib
import fcntl
import os
import signal
import subprocess
import sys
import termios
from collections.abc import Iterator
from pathlib import Path
from typing import Final

from tests.cli.processes import invoke
from tests.cli.terminals import Screen, resize
from tests.support.children import ROOT

_PROMPT: Final = "tell me> "
_SCRIPT: Final = "the-script"

TYPED: Final = [
    ("lidario scan sim://ydlidar-4ros-sl", "lidario scan sim://ydlidar-4ros-slow"),
    ("lidario scan 'sim://ydlidar-4ros-sl", "lidario scan 'sim://ydlidar-4ros-slow'"),
    ("lidario info sim:", "lidario info sim://"),
    ("lidario motor stop sim://ydlidar-4ros-sl", "lidario motor stop sim://ydlidar-4ros-slow"),
    ("lidario stats sim://rplidar-s2 --js", "lidario stats sim://rplidar-s2 --json"),
    ("lidario info a_rec", "lidario info a_recording.mcap"),
    ("lidario export a_rec", "lidario export a_recording.mcap"),
]
"""What is typed, and what the line is after the tabulator; bash divides words at ":"."""

_STARTS: Final = {
    "bash": (["bash", "--noprofile", "--rcfile", "start", "-i"], "start"),
    "zsh": (["zsh", "-i"], ".zshrc"),
    "fish": (["fish", "--no-config", "--init-command", "source start", "-i"], "start"),
}
"""The command that starts each shell, and the file that it reads."""
_LINES: Final = {
    "bash": f". ./{_SCRIPT}\nPS1='{_PROMPT}'\nbind 'set bell-style none'\n",
    "zsh": f"autoload -Uz compinit\ncompinit -u -D\n. ./{_SCRIPT}\nPS1='{_PROMPT}'\nunsetopt zle_bracketed_paste\n",
    "fish": f"source {_SCRIPT}\nfunction fish_prompt; echo -n '{_PROMPT}'; end\n",
}


@contextlib.contextmanager
def interactive(shell: str, folder: Path) -> Iterator[tuple[int, Screen]]:
    """The shell at its prompt in `folder`, where a recording lies, with our completion script."""
    (folder / "a_recording.mcap").touch()
    command = folder / "bin" / "lidario"
    command.parent.mkdir()
    command.write_text(f'#!/bin/sh\nexec "{sys.executable}" -m lidario "$@"\n')
    command.chmod(0o755)
    (folder / _SCRIPT).write_text(invoke("completion", shell).stdout)
    start, name = _STARTS[shell]
    (folder / name).write_text(_LINES[shell])
    environment = {
        "PATH": f"{command.parent}:{os.environ['PATH']}", "PYTHONPATH": str(ROOT), "TERM": "dumb",
        "HOME": str(folder), "ZDOTDIR": str(folder), "LANG": "C.UTF-8",
    }  # fmt: skip
    ours, theirs = os.openpty()
    resize(theirs, 24, 200)
    with os.fdopen(ours, "rb", buffering=0):
        process = subprocess.Popen(
            start, cwd=folder, stdin=theirs, stdout=theirs, stderr=theirs, env=environment,
            start_new_session=True, preexec_fn=lambda: fcntl.ioctl(0, termios.TIOCSCTTY, 0),
        )  # fmt: skip
        os.close(theirs)
        try:
            screen = Screen(ours)
            screen.until(_PROMPT)
            yield ours, screen
        finally:
            process.send_signal(signal.SIGKILL)
            process.wait()


def is_completed(shell: str, folder: Path, typed: str, completed: str) -> None:
    """Type a word and a tabulator, and wait for the completed line."""
    with interactive(shell, folder) as (terminal, screen):
        os.write(terminal, f"{typed}\t".encode())
        assert screen.until(completed).endswith(completed)
