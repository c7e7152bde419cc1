"""A terminal that takes no output (Ctrl-S, a line that is dead) holds up neither the lidar nor a signal."""

import os
import re
import signal
import subprocess
import tty
from pathlib import Path

import pytest

from lidario.sim.device import SimulatedDevice
from tests.cli.processes import served
from tests.cli.terminals import on_terminal, resize
from tests.support.children import BOUND, until
from tests.support.recorded import record

pytestmark = pytest.mark.long
STOP, GO, INTERRUPT = b"\x13", b"\x11", b"\x03"
LEFT = "\x1b[?1049l"
FRAMES = 2 * 3200 * 4
"""Bytes of about two revolutions; a program that waits for its terminal has waited for long after those."""


def goes_on(device: SimulatedDevice) -> None:
    """Wait until the device has sent some revolutions more."""
    sent, transmit = [0], device.transmit

    def counted(now: int) -> bytes:
        data = transmit(now)
        sent.append(sent[-1] + len(data))
        return data

    device.transmit = counted  # type: ignore[method-assign]
    until(lambda: sent[-1] > FRAMES)


def test_watch_draws_anew_where_the_terminal_has_another_size() -> None:
    with (
        served("rplidar-s2") as server,
        on_terminal("watch", server.path, size=(30, 110)) as (process, screen, ours),
    ):
        assert "scanning" in screen.until("\x1b[H", lambda text: "forward is up" in text)
        resize(ours, 20, 60)
        last = screen.until("\x1b[H", lambda text: "forward is up" in text and "DenseBoost" not in text)
        assert 16 <= len(last.splitlines()) <= 20
        process.send_signal(signal.SIGINT)
        screen.until(LEFT)
        assert re.search(r"\d+ scans of ", screen.until("\n", lambda text: "scans of" in text))
        assert process.wait(BOUND) == 0
        until(lambda: not server.device.scanning)


@pytest.mark.parametrize("typed", [False, True])
def test_watch_is_ended_while_its_terminal_takes_nothing(typed: bool) -> None:
    """A typed Ctrl-C makes a terminal take output again, and it is restored."""
    with served("rplidar-s2") as server, on_terminal("watch", server.path) as (process, screen, terminal):
        screen.until("\x1b[H", lambda text: "forward is up" in text)
        os.write(terminal, STOP)
        goes_on(server.device)
        if typed:
            os.write(terminal, INTERRUPT)
            screen.until(LEFT)
            screen.until("\n", lambda text: "scans of" in text)
        else:
            process.send_signal(signal.SIGINT)
        until(lambda: not server.device.scanning)
        assert process.wait(BOUND) == 0


def test_watch_says_that_a_terminal_cannot_draw() -> None:
    with on_terminal("watch", "sim://rplidar-s2", kind="dumb") as (process, screen, _):
        screen.until("needs a terminal whose cursor moves")
        screen.until("\n", lambda text: "lidario watch --help" in text)
        assert process.wait(BOUND) == 2


def test_a_line_of_the_log_takes_the_place_of_what_shows_that_work_goes_on(tmp_path: Path) -> None:
    """Of the second file it is logged that no model need be named; the first one takes a while."""
    for name in ("a", "b"):
        record(tmp_path / f"{name}.mcap", "sim://rplidar-s2", 5)
    words = (*(str(tmp_path / f"{name}.mcap") for name in ("a", "b")), str(tmp_path / "{}.csv"), "--model", "x4")
    with on_terminal("export", *words) as (process, screen, _):
        for _ in range(2):
            line = screen.until("is not used\r\n").rpartition("\r\n")[0].rpartition("\r")[2].lstrip("\n")
            assert line.endswith(
                ".mcap tells by itself which lidar it is of: what was said of bare bytes is not used"
            )
            assert line.startswith(str(tmp_path))
        assert process.wait(BOUND) == 0


@pytest.mark.parametrize(("model", "logged"), [("rplidar-s2", ""), ("ldrobot-ld06", "cannot be stopped from here")])
def test_neither_what_shows_that_work_goes_on_nor_a_line_of_the_log_holds_it_up(
    tmp_path: Path, model: str, logged: str
) -> None:
    """A warning is logged when a device is opened that cannot be stopped."""
    with (
        served(model) as server,
        open(tmp_path / "scans", "w+", encoding="utf-8") as out,
        on_terminal("scan", server.path, "-n", "3", "--json", stdout=out.fileno()) as (process, screen, terminal),
    ):
        os.write(terminal, STOP)
        until(lambda: (tmp_path / "scans").read_bytes().count(b"\n") == 3)
        until(lambda: logged or not server.device.scanning)
        os.write(terminal, GO)
        if logged:
            screen.until(logged)
        assert process.wait(BOUND) == 0


def test_a_signal_ends_what_waits_for_a_device() -> None:
    """Nothing at the port responds, so the command waits, and says so on a terminal that is stopped."""
    ours, theirs = os.openpty()
    silent = os.ttyname(theirs)
    with (
        os.fdopen(ours, "rb", buffering=0),
        os.fdopen(theirs, "rb", buffering=0),
        on_terminal("scan", silent, stdout=subprocess.DEVNULL) as (process, screen, terminal),
    ):
        screen.until("waiting for")
        os.write(terminal, STOP)
        tty.setraw(theirs)
        assert os.read(ours, 1)
        process.send_signal(signal.SIGTERM)
        assert process.wait(BOUND) == 128 + signal.SIGTERM


def test_the_cursor_is_there_while_a_verb_works() -> None:
    """So a verb that is killed does not leave a terminal without one."""
    with served("rplidar-s2") as server:
        with server.lock:
            server.device.mute = True  # type: ignore[attr-defined]
        with on_terminal("info", server.path) as (process, screen, _):
            shown = [screen.until(f"asking {server.path}") for _ in range(2)]
            process.kill()
            process.wait(BOUND)
    written = "".join(shown)
    assert "\x1b[?25l" not in written
