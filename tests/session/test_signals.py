"""Signals that end a program: with `lidario.run` the device is left still, without it SIGTERM leaves it scanning.

The device runs in this process and the program in another one, so what reached the device is known first hand.
"""

import asyncio
import os
import signal
import subprocess
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from types import SimpleNamespace

import pytest

import lidario
from lidario.sim.serve import PtyServer
from tests.cli.processes import served
from tests.support.children import BOUND, UNDISTURBED, child, ended, is_still, line_of, requests, until, was_stopped

MODELS = ("rplidar-s2", "ydlidar-4ros")

PROGRAM = """
import asyncio, signal, sys
import lidario

async def main():
    async with lidario.open_lidar(sys.argv[1], family=sys.argv[2]) as lidar:
        async for scan in lidar.scans():
            print(scan.seq, flush=True)

"""
SWALLOWING = """
async def swallowing():
    try:
        await main()
    except asyncio.CancelledError:
        return "its own result"

print(lidario.run(swallowing()))
"""
FAILING = """
async def failing():
    try:
        await main()
    finally:
        raise ValueError("a mistake in the cleanup")

lidario.run(failing())
"""
IN_BACKGROUND = """
async def waiting():
    task = asyncio.create_task(main())
    await asyncio.Event().wait()

lidario.run(waiting())
"""
RUN = "lidario.run(main())"
WITHOUT_RUN = "asyncio.run(main())"
EXIT_TERM, EXIT_HUP = 128 + signal.SIGTERM, 128 + signal.SIGHUP


def scanning(process: subprocess.Popen[str]) -> None:
    """Return when the program has read scans."""
    for _ in range(2):
        assert line_of(process.stdout).strip().isdecimal()


@contextmanager
def running(program: str, model: str = MODELS[0]) -> Iterator[tuple[PtyServer, subprocess.Popen[str]]]:
    """A device, and a program that has read scans of it."""
    text = UNDISTURBED + PROGRAM + program
    with served(model) as server, child(text, server.path, model.partition("-")[0]) as process:
        scanning(process)
        yield server, process


def ended_by(process: subprocess.Popen[str], *numbers: int) -> tuple[int, str, str]:
    """Exit code, output and errors of a program that gets these signals."""
    for number in numbers:
        process.send_signal(number)
    out, said = process.communicate(timeout=BOUND)
    return process.returncode, out, said


# The program, its signals, its exit code, the last line of its output and that of its errors.
WAYS = {
    "term": (RUN, [signal.SIGTERM], EXIT_TERM, "", ""),
    "hup": (RUN, [signal.SIGHUP], EXIT_HUP, "", ""),
    "term twice": (RUN, [signal.SIGTERM] * 2, EXIT_TERM, "", ""),
    "int": (RUN, [signal.SIGINT], -signal.SIGINT, "", "KeyboardInterrupt"),
    "int twice": (RUN, [signal.SIGINT] * 2, -signal.SIGINT, "", "KeyboardInterrupt"),
    "int without run": (WITHOUT_RUN, [signal.SIGINT], -signal.SIGINT, "", "KeyboardInterrupt"),
    "the cancellation is swallowed": (SWALLOWING, [signal.SIGTERM], 0, "its own result", ""),
    "the cleanup fails": (FAILING, [signal.SIGTERM], 1, "", "ValueError: a mistake in the cleanup"),
    # That task is cancelled after the main one has ended; signals that come in between must not kill it.
    "another task holds it": (IN_BACKGROUND, [signal.SIGTERM] * 3, EXIT_TERM, "", ""),
}


@pytest.mark.long
@pytest.mark.parametrize("way", WAYS)
def test_a_signal_leaves_the_device_still(way: str) -> None:
    program, numbers, code, printed, error = WAYS[way]
    with running(program, MODELS[list(WAYS).index(way) % 2]) as (server, process):
        returned, out, said = ended_by(process, *numbers)
        until(lambda: was_stopped(server), lambda: (said, requests(server)[-5:]))
    assert returned == code, said
    assert out.strip().endswith(printed)
    assert (said.splitlines() or [""])[-1] == error


@pytest.mark.long
def test_without_run_sigterm_leaves_the_device_scanning() -> None:
    """The limit that the documentation states; it shows that the tests above can fail."""
    with running(WITHOUT_RUN) as (server, process):
        assert ended_by(process, signal.SIGTERM)[0] == -signal.SIGTERM
        assert not is_still(server)


@pytest.mark.long
def test_handlers_of_the_program_are_left_in_place_and_what_is_ignored_stays_ignored() -> None:
    """As under nohup."""
    # Not `print`: a handler that comes in the midst of another one must not use the same stream.
    own = "import os; signal.signal(signal.SIGTERM, lambda *_: os.write(1, b'its own handler\\n'))"
    with running(f"{own}\nsignal.signal(signal.SIGHUP, signal.SIG_IGN)\n{RUN}") as (server, process):
        process.send_signal(signal.SIGHUP)
        scanning(process)
        process.send_signal(signal.SIGTERM)
        while (line := line_of(process.stdout)) != "its own handler\n":
            assert line.strip().isdecimal()
        scanning(process)
        assert ended_by(process, signal.SIGINT)[0] == -signal.SIGINT
        until(lambda: was_stopped(server))


@pytest.mark.long
def test_signals_while_a_session_opens() -> None:
    with served(MODELS[0]) as server:
        with server.lock:
            server.device.response_delay_s = 0.05  # type: ignore[attr-defined]
        with child(UNDISTURBED + PROGRAM + RUN, server.path, "rplidar") as process:
            until(lambda: any(each.name == "get_info" for each in requests(server)))
            assert ended_by(process, signal.SIGTERM) == (EXIT_TERM, "", "")
        until(lambda: [each.name for each in requests(server) if each.obeyed][-1] == "stop")
        assert is_still(server)


def test_run_in_another_thread_takes_no_signals() -> None:
    async def main() -> int:
        assert signal.getsignal(signal.SIGTERM) is before
        await asyncio.sleep(0)
        return 7

    before = signal.getsignal(signal.SIGTERM)
    results: list[int] = []
    thread = threading.Thread(target=lambda: results.append(lidario.run(main())))
    thread.start()
    thread.join(BOUND)
    assert results == [7]


def test_signals_are_as_before_after_it() -> None:
    async def main() -> None:
        assert signal.getsignal(signal.SIGTERM) is not signal.SIG_DFL

    lidario.run(main())
    assert signal.getsignal(signal.SIGTERM) is signal.SIG_DFL
    assert signal.getsignal(signal.SIGHUP) is signal.SIG_DFL
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler


@pytest.mark.parametrize("holder", ["main", "another task"])
def test_who_presses_ctrl_c_twice_ends_no_cleanup(holder: str) -> None:
    """The second one may come at any moment, as in the midst of the requests that stop a lidar."""
    done: list[str] = []

    async def holding() -> None:
        try:
            await asyncio.Event().wait()
        finally:
            done.append("begun")
            signal.raise_signal(signal.SIGINT)
            with suppress(asyncio.CancelledError):
                await asyncio.sleep(0.01)
            done.append("ended")

    async def main() -> None:
        asyncio.get_running_loop().call_soon(signal.raise_signal, signal.SIGINT)
        if holder == "main":
            await holding()
        kept = asyncio.create_task(holding())
        await asyncio.wait([kept])

    with pytest.raises(KeyboardInterrupt):
        lidario.run(main())
    assert done == ["begun", "ended"]


def test_a_program_that_blocks_its_loop_is_ended_by_ctrl_c_behind_5_s(monkeypatch: pytest.MonkeyPatch) -> None:
    now = [100.0]
    monkeypatch.setattr("lidario.session.run.time", SimpleNamespace(monotonic=lambda: now[-1]))

    async def main() -> None:
        for passed in (0.0, 3.0, 5.0, 5.1, 6.0):
            now.append(100.0 + passed)
            signal.raise_signal(signal.SIGINT)

    with pytest.raises(KeyboardInterrupt):
        lidario.run(main())
    assert now[-1] == 105.1


@pytest.mark.long
def test_what_ends_the_cleanup_is_told_and_nothing_else() -> None:
    async def main() -> None:
        loop = asyncio.get_running_loop()

        def leave(code: int) -> None:
            raise SystemExit(code)

        def tap(*_: object) -> None:
            if not loop.is_closed():
                loop.call_soon(leave, 6)

        async with lidario.open_lidar("sim://rplidar-s2?via=memory") as lidar:
            await lidar.scan()
            # The stop requests are written first, and then it is waited until they were heard.
            lidar.tap(tap)
            loop.call_soon(leave, 5)
            await asyncio.Event().wait()

    with pytest.raises(SystemExit) as left:
        lidario.run(main())
    assert left.value.code == 6


IN_A_PROCESS = """
import multiprocessing, sys

if __name__ == "__main__":
    arguments = sys.argv[2], {"source": sys.argv[3]}
    work = multiprocessing.get_context(sys.argv[1]).Process(target=exec, args=arguments)
    work.start()
    work.join()
    sys.exit(work.exitcode)
"""
BLOCKING = """
import lidario

lidar = lidario.open_sync(source)
scans = iter(lidar.scans())
next(scans)
raise SystemExit(5)
"""
ASYNC = """
import asyncio
import lidario

async def hold():
    global lidar, scans
    lidar = await lidario.open_lidar(source)
    scans = lidar.scans()
    await anext(scans)

asyncio.run(hold())
raise SystemExit(5)
"""
LEFT = {"blocking": BLOCKING, "async": ASYNC}


@pytest.mark.long
@pytest.mark.parametrize("method", ["fork", "forkserver", "spawn"])
@pytest.mark.parametrize("left", LEFT)
def test_a_process_that_multiprocessing_has_started_ends_without_closing(left: str, method: str) -> None:
    """By `os._exit`: its lidar is still all the same."""
    with served("rplidar-s2") as server:
        process = ended(UNDISTURBED + IN_A_PROCESS, method, UNDISTURBED + LEFT[left], server.path)
        assert (process.returncode, process.stderr) == (5, "")
        until(lambda: is_still(server), lambda: requests(server)[-5:])
        assert was_stopped(server)


BESIDE_A_PROCESS = """
import multiprocessing, signal, sys
import lidario

lidar = lidario.open_sync(sys.argv[1])
scans = iter(lidar.scans())
next(scans)
process = multiprocessing.get_context("spawn").Process(target=signal.pause)
process.start()
print(process.pid, flush=True)
"""


@pytest.mark.long
def test_a_program_that_never_closes_stops_it_before_it_waits_for_a_process_that_it_has_started() -> None:
    """The lidar went on turning for as long as that process did."""
    with served("rplidar-s2") as server, child(UNDISTURBED + BESIDE_A_PROCESS, server.path) as program:
        other = int(line_of(program.stdout))
        try:
            until(lambda: was_stopped(server), lambda: requests(server)[-5:])
            assert program.poll() is None
        finally:
            os.kill(other, signal.SIGKILL)
        assert program.wait(30) == 0
