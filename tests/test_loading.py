"""A Ctrl-C while the library loads numpy, at the first use of a name: the program can go on."""

import signal
import sys
import threading

import pytest

from lidario.loading import load
from tests.support.children import ended, until
from tests.support.interrupt import interrupted

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
    done = ended(PROGRAM.format(use=use))
    assert (done.returncode, done.stdout) == (0, "it goes on\n"), done.stderr


@pytest.mark.long
def test_a_program_that_it_ends_says_so_by_its_exit_code() -> None:
    """As a shell needs it to leave a loop. The import, which goes on, must not make Python forget Ctrl-C."""
    done = ended(PROGRAM.partition("try:")[0] + "lidario.Scan")
    assert done.returncode == -signal.SIGINT, done.stderr
    assert done.stderr.endswith("\nKeyboardInterrupt\n")


OPENED = """
import asyncio, sys
import lidario

async def main():
    async with lidario.open_lidar("sim://rplidar-s2?via=memory") as lidar:
        before = set(sys.modules)
        await lidar.scan()
        await lidar.stop()
    print(sorted(set(sys.modules) - before))

asyncio.run(main())
"""


@pytest.mark.long
def test_an_open_lidar_scans_stops_and_closes_without_importing_anything() -> None:
    """An import needs a file descriptor, and keeps the loop busy: not while the device is stopped."""
    done = ended(OPENED)
    assert (done.returncode, done.stdout) == (0, "[]\n"), done.stderr


RUN = """
import sys
import lidario

async def main():
    before = set(sys.modules)
    lidario.open_lidar("/dev/ttyUSB0")
    print(sorted(set(sys.modules) - before))

lidario.run(main())
"""


def test_what_a_program_opens_a_lidar_with_is_loaded_before_its_event_loop_runs() -> None:
    """That takes some tenths of a second, in which no task of a robot would go on."""
    done = ended(RUN)
    assert (done.returncode, done.stdout) == (0, "[]\n"), done.stderr


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
