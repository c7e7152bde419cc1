"""Who opens a line waits for the guard of a dead program there, and for no other."""

import os
import socket
import subprocess
import time
from pathlib import Path

import pytest

from lidario.port.guard import wait_for_guard
from lidario.port.sockets import open_tcp, open_udp
from tests.support.children import guard_like


@pytest.fixture
def dead_program() -> int:
    """The number of a program that has ended."""
    with subprocess.Popen(["true"]) as program:
        return program.pid


def killed_meanwhile(guard: subprocess.Popen[bytes], patch: pytest.MonkeyPatch) -> list[float]:
    """End what looks like a guard as soon as somebody waits for it; the pauses for which it was waited."""
    slept: list[float] = []

    def sleep(seconds: float) -> None:
        slept.append(seconds)
        guard.kill()
        guard.wait()

    patch.setattr("lidario.port.guard.time.sleep", sleep)
    return slept


@pytest.mark.parametrize("name", ["tcp://x:1", "/dev/lidar"])
def test_the_guard_of_a_dead_program_is_waited_for_and_no_longer(
    name: str, dead_program: int, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    if name.startswith("/"):
        # Another name of the same port.
        held, name = name, str(tmp_path / "lidar")
        os.symlink(held, name)
    else:
        held = name
    with guard_like(dead_program, held) as guard:
        slept = killed_meanwhile(guard, monkeypatch)
        wait_for_guard("tcp://y:1")
        assert slept == []
        wait_for_guard(name)
        # It is noticed within a twentieth of a second.
        assert len(slept) == 1
        assert slept[0] <= 0.05


@pytest.mark.parametrize("scheme", ["tcp", "udp"])
async def test_a_line_of_a_network_is_opened_behind_the_guard_of_a_dead_program(
    scheme: str, dead_program: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    kind = socket.SOCK_STREAM if scheme == "tcp" else socket.SOCK_DGRAM
    with socket.socket(socket.AF_INET, kind) as server:
        server.bind(("127.0.0.1", 0))
        if scheme == "tcp":
            server.listen()
        number = server.getsockname()[1]
        name = f"{scheme}://127.0.0.1:{number}"
        with guard_like(dead_program, name) as guard:
            slept = killed_meanwhile(guard, monkeypatch)
            port = await (open_tcp if scheme == "tcp" else open_udp)(name, "127.0.0.1", number)
            assert len(slept) == 1
            await port.close()


def test_one_that_stays_is_not_waited_for_for_ever(dead_program: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """As where it was stopped."""
    clock = time.monotonic()

    def sleep(seconds: float) -> None:
        nonlocal clock
        clock += seconds + 0.2  # each look takes a while

    with guard_like(dead_program, "tcp://x:1"), monkeypatch.context() as patch:
        patch.setattr("lidario.port.guard.time.sleep", sleep)
        patch.setattr("lidario.port.guard.time.monotonic", lambda: clock)
        began = clock
        wait_for_guard("tcp://x:1")
    assert 4.0 <= clock - began < 4.3


@pytest.mark.parametrize("ended", [False, True])
def test_the_guard_of_a_program_that_runs_is_not_waited_for(ended: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    """One that has ended is dead, also where its parent has not waited for it yet."""
    with subprocess.Popen(["cat"], stdin=subprocess.PIPE) as program:
        if ended:
            program.kill()
            os.waitid(os.P_PID, program.pid, os.WEXITED | os.WNOWAIT)
        with guard_like(program.pid, "tcp://x:1") as guard:
            slept = killed_meanwhile(guard, monkeypatch)
            wait_for_guard("tcp://x:1")
            assert len(slept) == ended
