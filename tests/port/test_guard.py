"""The guard of a port: started, told, dismissed, killed; and what it costs."""

import asyncio
import logging
import os
import signal
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from lidario import InvalidValue, Unsupported, open_lidar, simulate
from lidario.port import guard, guard_process
from lidario.port.background import run_in_thread
from lidario.port.diagnose import busy, holders
from lidario.port.guard import Guard, start_guard, wait_for_guard
from lidario.port.serial import open_serial
from lidario.wire.envelope import Request
from tests.cli.processes import served
from tests.support.children import children_that_ended, guards_of, is_still, own_guards, requests, until
from tests.support.drivers import LOW_LATENCY, SPEED_FLAG, FakeDriver
from tests.support.loop import driven, now
from tests.support.ports import PATIENCE_S, Sink, terminal_pair, written
from tests.support.times import takes

STOP = Request("STOP", b"stop!", settle=0.01)


async def ended(process: int) -> None:
    await run_in_thread(lambda: until(lambda: process not in own_guards()))


@pytest.mark.long
async def test_a_session_has_one_and_leaves_none(monkeypatch: pytest.MonkeyPatch) -> None:
    # On a busy machine the process may need longer than a session waits for it.
    for name in ("guard.RELEASE_S", "port.CLOSE_TIMEOUT_S"):
        monkeypatch.setattr(f"lidario.port.{name}", PATIENCE_S)
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
        until(lambda: is_still(server))


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
        until(lambda: is_still(server))
    assert len(told()) == 1


@driven
async def test_one_that_is_stopped_keeps_the_port_for_half_a_second() -> None:
    with terminal_pair() as (_, _, path):
        port = await open_serial(path, 115200)
        await port.guard()
        port.attach(Sink(), lambda: ([STOP], [], 0.0))
        (guard,) = own_guards()
        await run_in_thread(lambda: until(lambda: guard in dict(holders(path))))
        os.kill(guard, signal.SIGSTOP)
        began = now()
        await port.close()
        assert now() - began == pytest.approx(0.5)
        await ended(guard)
        assert list(holders(path)) == []


async def test_one_that_is_stopped_blocks_nobody_who_tells_it_more_than_it_takes() -> None:
    with terminal_pair() as (_, _, path):
        guard = await start_guard(path)
        (process,) = own_guards()
        os.kill(process, signal.SIGSTOP)
        try:
            with takes(5.0):  # half of what starting it may take
                while guard.send(bytes(1 << 16)):
                    pass
        finally:
            os.kill(process, signal.SIGKILL)
            guard.dismiss_at_once()
        await ended(process)


async def test_one_that_is_stopped_is_killed_where_it_is_dismissed_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """As where there is no loop any more. It would be stopped for ever, and hold the port."""
    monkeypatch.setattr("lidario.port.guard.RELEASE_S", 0.02)
    with terminal_pair() as (_, _, path):
        guard = await start_guard(path)
        (process,) = own_guards()
        os.kill(process, signal.SIGSTOP)
        try:
            guard.dismiss_at_once()
            await ended(process)
        except BaseException:
            os.kill(process, signal.SIGKILL)
            raise


@pytest.mark.long
@pytest.mark.parametrize("source", ["sim://rplidar-s2", "sim://rplidar-s2?via=memory", "device"])
async def test_a_simulated_device_needs_none(source: str, caplog: pytest.LogCaptureFixture) -> None:
    caplog.set_level(logging.INFO, "lidario")
    async with open_lidar(simulate("rplidar-s2") if source == "device" else source, guard=True, reconnect=True):
        assert own_guards() == []
    async with open_lidar("sim://rplidar-s2?via=memory"):
        pass  # nobody has asked for one
    assert len([record for record in caplog.records if record.message.startswith("guard: nothing at")]) == 1


@pytest.mark.long
async def test_a_device_that_only_talks_needs_none() -> None:
    with served("ldrobot-ld06") as server:
        async with open_lidar(server.path, guard=True), asyncio.timeout(PATIENCE_S):
            while own_guards():  # one is dismissed as soon as the device is known
                await asyncio.sleep(0.01)


@pytest.mark.long
async def test_where_the_system_cannot_it_is_said(monkeypatch: pytest.MonkeyPatch) -> None:
    with served("rplidar-s2") as server:
        for owner, name, value in (
            (os, "posix_spawn", None),
            (sys, "frozen", True),
            (sys, "executable", ""),
            (sys, "executable", "/bin/false"),
            (sys, "executable", "/no/such/file"),
            (guard, "_SCRIPT", "/usr/lib/lidario.zip/lidario/port/guard_process.py"),
        ):
            with monkeypatch.context() as patch:
                if value is None:
                    patch.delattr(owner, name)
                else:
                    patch.setattr(owner, name, value, raising=False)
                with pytest.raises(Unsupported, match=r"guard: .*[Oo]pen the lidar without") as refused:
                    await open_lidar(server.path, guard=True)
            # Where the process has ended at once, it told what `int` said of no text.
            assert "literal" not in str(refused.value)
        # It is only asked what it is, to be left still.
        assert {each.name for each in requests(server)} <= {"get_info", "motor_speed_ctrl", "stop"}
        assert own_guards() == []
    with pytest.raises(InvalidValue, match="guard"):
        open_lidar(guard=np.zeros(2))  # type: ignore[arg-type]


async def test_it_keeps_nothing_open_that_its_program_writes_to() -> None:
    """Who reads what the program says until its end would wait for the guard, too."""
    # What else a program leaves to its children: a loop has this descriptor, or another file.
    os.set_inheritable(3, True)
    guard = await start_guard("x")
    os.set_inheritable(3, False)
    (process,) = own_guards()
    assert sorted(os.listdir(f"/proc/{process}/fd")) == ["0", "1", "2"]
    assert {os.readlink(f"/proc/{process}/fd/{number}") for number in (1, 2)} == {"/dev/null"}
    guard.dismiss_at_once()
    await ended(process)


async def test_cancelled_while_it_starts_it_ends(monkeypatch: pytest.MonkeyPatch) -> None:
    started = asyncio.Event()
    loop = asyncio.get_running_loop()
    made = Guard.__init__

    def told(self: Guard, *given: Any) -> None:
        loop.call_soon_threadsafe(started.set)
        made(self, *given)

    monkeypatch.setattr(Guard, "__init__", told)
    starting = asyncio.create_task(start_guard("x"))
    await started.wait()
    starting.cancel()
    with pytest.raises(asyncio.CancelledError):
        await starting
    await run_in_thread(lambda: until(lambda: not own_guards()))


@pytest.mark.long
async def test_the_end_of_the_socket_without_a_farewell_is_the_end_of_the_program() -> None:
    with terminal_pair() as (master, _, path):
        port = await open_serial(path, 115200)
        # No event loop watches it: that would see the end of the socket too.
        guard = Guard(path, asyncio.get_running_loop())
        (process,) = own_guards()
        handle = os.open(path, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
        guard.take(handle)
        os.close(handle)
        guard.tell([STOP], [], 0.0)
        guard.forked()
        assert written(master, 25) == b"stop!" * guard_process.LEAST
        await ended(process)
        await port.close()


async def test_it_is_told_what_stops_the_device_and_when_that_changes(monkeypatch: pytest.MonkeyPatch) -> None:
    guard = await start_guard("x")
    told: list[Any] = []

    def send(message: bytes) -> bool:
        told.append(guard_process.order_in(message))
        return len(told) > 1

    with monkeypatch.context() as patch:
        patch.setattr(guard, "send", send)
        slow, later = Request("SLOW", b"s", settle=0.05, dtr=True), time.monotonic() + 100
        # What it did not take it is told once more.
        for requests_, last, listens_at in (
            *[([STOP, slow], [slow], 0.0)] * 3,
            *[([STOP], [], later)] * 2,
            *[([STOP], [], time.monotonic())] * 2,
        ):
            guard.tell(requests_, last, listens_at)
            assert guard.awaits_change is (listens_at == later)
    first = ([(b"stop!", None), (b"s", True)], [(b"s", True)], pytest.approx(0.055), 0.0)
    stop = [(b"stop!", None)]
    short = pytest.approx(0.015)
    assert told == [first, first, (stop, [], short, later), (stop, [], short, 0.0)]
    # One that has ended is not killed: its number may be that of another process.
    monkeypatch.setattr(os, "kill", lambda *_: pytest.fail("killed"))
    guard.dismiss_at_once()


async def test_a_farewell_is_its_end(caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch) -> None:
    """Nothing of it is left: no timer, no process, also none that nobody has waited for."""
    loop, gone, timers = asyncio.get_running_loop(), asyncio.Event(), list[asyncio.TimerHandle]()
    guard, call_later = await start_guard("x"), loop.call_later
    assert children_that_ended() == []
    (process,) = own_guards()

    def noted(*given: Any) -> asyncio.TimerHandle:
        timers.append(call_later(*given))
        return timers[-1]

    with monkeypatch.context() as patch:
        patch.setattr(loop, "call_later", noted)
        patch.setattr("lidario.port.guard.RELEASE_S", 2 * PATIENCE_S)
        guard.dismiss(gone.set)
    async with asyncio.timeout(PATIENCE_S):
        await gone.wait()
    assert [timer.cancelled() for timer in timers] == [True]
    await ended(process)
    assert caplog.records == []


async def test_its_end_without_a_farewell_is_told(caplog: pytest.LogCaptureFixture) -> None:
    guard = await start_guard("x")
    os.kill(own_guards()[0], signal.SIGKILL)
    await run_in_thread(lambda: until(lambda: caplog.records))
    assert [record.message[:24] for record in caplog.records] == ["x: its guard has ended ("]
    called: list[int] = []
    guard.dismiss(lambda: called.append(1))
    assert called == [1]


@pytest.mark.long
def test_a_port_that_a_guard_has_is_held_by_its_program(monkeypatch: pytest.MonkeyPatch) -> None:
    """The guard of a program that lives is not waited for. Nor is that program told to stop it: it has the port."""
    with served("rplidar-s2") as server:

        async def main() -> None:
            async with open_lidar(server.path, guard=True):
                with monkeypatch.context() as patch:
                    patch.setattr("lidario.port.guard.time.sleep", lambda _: pytest.fail("waited"))
                    wait_for_guard(server.path)
                assert "this program has it open already" in str(busy(server.path))

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
        # And nothing else.
        driver.flags |= 0xFFFF
        guard_process.clear_low_latency(handle)
        assert driver.flags == 0xFFFF & ~LOW_LATENCY
        driver.flags = SPEED_FLAG
        driver.gone = True
        guard_process.clear_low_latency(handle)
        os.close(handle)
        driver.gone = False
        await port.close()
