"""The guard of a port: started, told, dismissed, killed; what it costs; and what it writes, on a driven clock."""

from __future__ import annotations

import asyncio
import logging
import os
import signal
import socket
import sys
import termios
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from lidario import InvalidValue, Unsupported, open_lidar, simulate
from lidario.port import guard_process
from lidario.port.background import run_in_thread
from lidario.port.diagnose import busy, holders
from lidario.port.guard import Guard, start_guard
from lidario.port.left import guard_is_left
from lidario.port.serial import open_serial
from lidario.wire.envelope import Request
from tests.cli.processes import served
from tests.support.children import requests, until
from tests.support.drivers import LOW_LATENCY, SPEED_FLAG, FakeDriver
from tests.support.guards import guards_of, is_left_still, kilobytes, own_guards, switches
from tests.support.ports import PATIENCE_S, terminal_pair, written

STOP = Request("STOP", b"stop!", settle=0.01)
MOST_KB = 12 * 1024


async def ended(process: int) -> None:
    await run_in_thread(lambda: until(lambda: process not in own_guards()))


@pytest.mark.long
async def test_a_session_has_one_and_leaves_none() -> None:
    with served("rplidar-s2") as server:
        async with open_lidar(server.path, guard=True) as lidar:
            (guard,) = own_guards()
            assert list(holders(server.path)) == [(guard, "lidario-guard")]
            await lidar.scan()
        # At once: the port is closed when the session is.
        assert list(holders(server.path)) == []
        await ended(guard)
        async with open_lidar(server.path):
            assert own_guards() == []
        until(lambda: is_left_still(server))


@pytest.mark.long
async def test_it_needs_little_memory_and_is_never_woken() -> None:
    with served("rplidar-s2") as server:
        async with open_lidar(server.path, guard=True) as lidar, lidar.scans() as scans:
            for _ in range(3):
                await anext(scans)
            (guard,) = own_guards()
            woken = switches(guard)
            for _ in range(5):
                await anext(scans)
            assert switches(guard) == woken
            assert kilobytes(guard, "Pss") <= kilobytes(guard, "Rss") < MOST_KB


@pytest.mark.long
async def test_one_that_was_killed_is_told_once_and_the_session_goes_on(caplog: pytest.LogCaptureFixture) -> None:
    def told() -> list[str]:
        warnings = [record.message for record in caplog.records if record.levelno >= logging.WARNING]
        return [text for text in warnings if "guard" in text]  # a busy machine may lose scans, which is told too

    with served("rplidar-s2") as server:
        async with open_lidar(server.path, guard=True) as lidar, lidar.scans() as scans:
            await anext(scans)
            (guard,) = own_guards()
            os.kill(guard, signal.SIGKILL)
            await ended(guard)
            await lidar.get_health()
            async with asyncio.timeout(30.0):
                while not told():
                    await anext(scans)
            await lidar.stop()
            await lidar.scan()
        until(lambda: is_left_still(server))
    assert len(told()) == 1


@pytest.mark.long
async def test_one_that_is_stopped_does_not_keep_the_port(monkeypatch: pytest.MonkeyPatch) -> None:
    with served("rplidar-s2") as server:
        lidar = await open_lidar(server.path, guard=True)
        (guard,) = own_guards()
        os.kill(guard, signal.SIGSTOP)
        await lidar.close()
        await ended(guard)
        assert list(holders(server.path)) == []


@pytest.mark.parametrize("source", ["sim://rplidar-s2", "sim://rplidar-s2?via=memory", "device"])
async def test_a_simulated_device_needs_none(source: str, caplog: pytest.LogCaptureFixture) -> None:
    caplog.set_level(logging.INFO, "lidario")
    async with open_lidar(simulate("rplidar-s2") if source == "device" else source, guard=True, reconnect=True):
        assert own_guards() == []
    assert len([record for record in caplog.records if record.message.startswith("guard: nothing at")]) == 1


async def test_a_device_that_only_talks_needs_none() -> None:
    with served("ldrobot-ld06") as server:
        async with open_lidar(server.path, guard=True), asyncio.timeout(PATIENCE_S):
            while own_guards():  # one is dismissed as soon as the device is known
                await asyncio.sleep(0.01)


async def test_where_the_system_cannot_it_is_said(monkeypatch: pytest.MonkeyPatch) -> None:
    with served("rplidar-s2") as server:
        for owner, name, value in (
            (os, "posix_spawn", None),
            (sys, "frozen", True),
            (sys, "executable", ""),
            (sys, "executable", "/bin/false"),
            (sys, "executable", "/no/such/file"),
        ):
            with monkeypatch.context() as patch:
                if value is None:
                    patch.delattr(owner, name)
                else:
                    patch.setattr(owner, name, value, raising=False)
                with pytest.raises(Unsupported, match=r"guard: .*[Oo]pen the lidar without"):
                    await open_lidar(server.path, guard=True)
        assert requests(server) == []
        assert own_guards() == []
    with pytest.raises(InvalidValue, match="guard"):
        open_lidar(guard=np.zeros(2))  # type: ignore[arg-type]


async def test_cancelled_while_it_starts_it_ends(monkeypatch: pytest.MonkeyPatch) -> None:
    started = asyncio.Event()
    loop = asyncio.get_running_loop()
    made = Guard.__init__

    def told(self: Guard, port: str) -> None:
        loop.call_soon_threadsafe(started.set)
        made(self, port)

    monkeypatch.setattr(Guard, "__init__", told)
    starting = asyncio.create_task(start_guard("x"))
    await started.wait()
    starting.cancel()
    with pytest.raises(asyncio.CancelledError):
        await starting
    await run_in_thread(lambda: until(lambda: not own_guards()))


async def test_the_end_of_the_socket_without_a_farewell_is_the_end_of_the_program() -> None:
    with terminal_pair() as (master, _, path):
        port = await open_serial(path, 115200)
        # No event loop watches it: that would see the end of the socket too.
        guard = Guard(path)
        (process,) = own_guards()
        handle = os.open(path, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
        guard.take(handle)
        os.close(handle)
        guard.tell([STOP], [], 0.0)
        guard.let_go()
        assert written(master, 25) == b"stop!" * guard_process.LEAST
        await ended(process)
        await port.close()


def test_a_port_that_a_guard_has_is_held_by_its_program() -> None:
    """What is said to the next program: the guard of a program that lives is not waited for, and not named."""
    with served("rplidar-s2") as server:
        assert not guard_is_left(server.path)

        async def main() -> None:
            async with open_lidar(server.path, guard=True):
                assert not guard_is_left(server.path)
                assert "lidario-guard" in str(busy(server.path))

        asyncio.run(main())
        assert guards_of(os.getpid()) == []


@pytest.mark.parametrize("hurried", [False, True])
async def test_low_latency_is_given_back_where_the_program_had_set_it(
    hurried: bool, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """What the port tells the process, and what that does by it; the process has the real driver, of no adapter."""
    with terminal_pair() as (_, _, path):
        driver = FakeDriver(path, monkeypatch, tmp_path)
        if not hurried:
            driver.flags |= LOW_LATENCY
            driver.show_latency()
        taken: list[bool] = []
        take = Guard.take

        def seen(self: Guard, handle: int, *, hurried: bool = False) -> None:
            taken.append(hurried)
            take(self, handle, hurried=hurried)

        monkeypatch.setattr(Guard, "take", seen)
        port = await open_serial(path, 115200)
        await port.guard()
        assert taken == [hurried]
        assert driver.flags == SPEED_FLAG | LOW_LATENCY
        handle = os.open(path, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
        guard_process.clear_low_latency(handle)
        assert driver.flags == SPEED_FLAG
        driver.gone = True
        guard_process.clear_low_latency(handle)
        os.close(handle)
        driver.gone = False
        await port.close()


@pytest.mark.parametrize("hurried", [b"", b"hurried\n"])
@pytest.mark.parametrize("ending", [b"", b"farewell\n"])
@pytest.mark.parametrize("piece", [1, 7, 4096])
def test_what_the_process_understands(hurried: bytes, ending: bytes, piece: int) -> None:
    ours, theirs = socket.socketpair()
    with ours, theirs:
        message = hurried + b"0.015 0.0 1 -aa 1bb\n" + ending
        for begin in range(0, len(message), piece):
            ours.send(message[begin : begin + piece])
        ours.close()
        order, handle, gives_back = guard_process.last_order(theirs)
    assert order == (None if ending else ([(b"\xbb", True)], [(b"\xaa", None)], 0.015, 0.0))
    assert (handle, gives_back) == (-1, bool(hurried))


# ------------------------------------------------------------------------------------------- what it writes


class Clock:
    """The time, and everything that is written at a time."""

    def __init__(self, patch: pytest.MonkeyPatch, handle: int = 5) -> None:
        self.now = 100.0
        self.written: list[tuple[float, object]] = []
        self.waiting = 0
        patch.setattr("time.monotonic", lambda: self.now)
        patch.setattr("time.sleep", self.sleep)
        patch.setattr("os.write", lambda _, data: self.note(data))
        patch.setattr("fcntl.ioctl", self.ioctl)
        patch.setattr("termios.tcgetattr", lambda _: [0, 0, termios.HUPCL | termios.CREAD, 0, 0, 0, []])
        patch.setattr("termios.tcsetattr", lambda _, when, to: self.note(("settings", to[2])))
        patch.setattr("termios.tcflush", lambda _, queue: self.note(("flushed", queue)))

    def sleep(self, seconds: float) -> None:
        self.now += seconds

    def note(self, what: object) -> int:
        self.written.append((round(self.now - 100.0, 3), what))
        return 0

    def ioctl(self, handle: int, request: int, argument: bytes) -> bytes:
        if request == termios.TIOCOUTQ:
            return self.waiting.to_bytes(4, sys.byteorder)
        assert argument == termios.TIOCM_DTR.to_bytes(4, sys.byteorder)
        self.note({termios.TIOCMBIS: "DTR on", termios.TIOCMBIC: "DTR off"}[request])
        return b""

    def left_still(
        self,
        *orders: tuple[bytes, bool | None],
        last: guard_process.Requests | None = None,
        listens_at: float = 0.0,
    ) -> list[tuple[float, Any]]:
        guard_process.leave_still(5, (list(orders), last or [], 0.015, listens_at))
        return self.written


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> Clock:
    return Clock(monkeypatch)


def test_five_times_within_an_eighth_of_a_second(clock: Clock) -> None:
    seen = clock.left_still((b"motor", None), (b"stop", None))
    times = [at for at, data in seen if data == b"stop"]
    assert times == pytest.approx([0.0, 0.015, 0.037, 0.071, 0.122], abs=0.001)
    assert [data for _, data in seen] == [b"motor", b"stop"] * 5


def test_until_the_device_listens_and_no_longer_than_that(clock: Clock) -> None:
    times = [at for at, _ in clock.left_still((b"stop", None), listens_at=101.0)]
    assert times[-2] < 1.0 <= times[-1]
    assert times[-1] < 1.0 + 0.016


def test_not_for_ever(clock: Clock) -> None:
    assert 2.5 <= clock.left_still((b"stop", None), listens_at=1e9)[-1][0] < 2.6


def test_the_motor_that_hangs_on_dtr(clock: Clock) -> None:
    seen = [what for _, what in clock.left_still((b"", True), (b"stop", None))]
    # Else the system would clear DTR when the port is closed, and the motor would turn.
    assert seen[:3] == [("settings", termios.CREAD), "DTR on", b"stop"]


def test_what_makes_a_device_deaf_comes_last(clock: Clock) -> None:
    seen = [what for _, what in clock.left_still((b"stop", None), last=[(b"pwm", None), (b"", True)])]
    assert seen == [b"stop"] * 5 + [b"pwm", ("settings", termios.CREAD), "DTR on"]


def test_a_motor_that_stops_when_dtr_is_cleared(clock: Clock) -> None:
    assert {what for _, what in clock.left_still((b"", False))} == {"DTR off"}


def test_nothing_for_a_device_that_only_talks(clock: Clock) -> None:
    assert clock.left_still((b"", None)) == []
    assert clock.now == 100.0


def test_an_adapter_that_is_stuck_is_waited_for_shortly(clock: Clock) -> None:
    clock.waiting = 10
    seen = clock.left_still((b"stop", None))
    assert seen[-1][1] == ("flushed", termios.TCOFLUSH)
    assert seen[-1][0] < 0.3
