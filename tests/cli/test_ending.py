"""However the command ends, laser and motor are off and the exit code says how it went.

The device runs in this process, so what reached it is known first hand, not by what the command says.
"""

import json
import os
import signal
from contextlib import suppress
from pathlib import Path
from typing import IO

import pytest

from tests.cli.processes import end, invoke, served, started
from tests.support.children import BOUND, line_of, requests, until, was_stopped

pytestmark = pytest.mark.long
FIRST, SECOND = "rplidar-s2", "ydlidar-4ros"
SIGNALS = [
    (FIRST, signal.SIGINT),
    (FIRST, signal.SIGTERM),
    (FIRST, getattr(signal, "SIGHUP", signal.SIGTERM)),  # Windows has none
    (SECOND, signal.SIGINT),
    (SECOND, signal.SIGTERM),
]


@pytest.mark.exhaustive("ended", sample=[SIGNALS[0], SIGNALS[-1]], full=SIGNALS)
def test_a_signal_ends_an_endless_stream_as_it_is_meant_to_end(ended: tuple[str, signal.Signals]) -> None:
    model, number = ended
    with served(model) as server:
        with started("scan", server.path, "-n", "0", "--json") as process:
            seqs = [json.loads(line_of(process.stdout))["seq"] for _ in range(3)]
            # On a busy machine a scan may be dropped between two of them.
            assert seqs[0] < seqs[1] < seqs[2]
            rest, said = end(process, number)
        assert process.returncode == 0
        for line in rest.splitlines():
            json.loads(line)
        assert "scans in" in said
        assert "Traceback" not in said
        until(lambda: was_stopped(server))


def test_people_get_the_picture_after_ctrl_c() -> None:
    with served(FIRST) as server, started("scan", server.path, "-n", "0") as process:
        for _ in range(3):
            line_of(process.stdout)
        rest, _ = end(process)
    assert process.returncode == 0
    assert "▲" in rest


@pytest.mark.parametrize(
    ("verb", "number", "code"),
    [
        ("scan -n 100000", signal.SIGINT, 130),
        ("scan -n 100000", signal.SIGTERM, 143),
        ("stats -t 1h", signal.SIGINT, 130),
    ],
)
def test_a_number_of_scans_or_a_time_that_is_not_reached(verb: str, number: signal.Signals, code: int) -> None:
    name, *options = verb.split()
    with served(FIRST) as server:
        with started(name, server.path, *options, "--json") as process:
            until(lambda: server.device.scanning)
            _, said = end(process, number)
        assert process.returncode == code
        assert "Traceback" not in said
        until(lambda: was_stopped(server))


def test_ctrl_c_in_a_question() -> None:
    with served(FIRST) as server:
        with server.lock:
            server.device.mute = True  # type: ignore[attr-defined]
        with started("info", server.path) as process:
            until(lambda: any(each.name == "get_info" for each in requests(server)))
            out, said = end(process)
    assert process.returncode == 130
    assert out == ""
    assert "Traceback" not in said


@pytest.mark.exhaustive("form", sample=["--json"], full=["--json", "--csv", ""])
def test_a_reader_that_goes_away_ends_it_without_a_word(form: str) -> None:
    with served(FIRST) as server:
        with started("scan", server.path, "-n", "0", *form.split()) as process:
            assert process.stdout is not None
            assert process.stderr is not None
            line_of(process.stdout)
            process.stdout.close()
            said = process.stderr.read()
            assert process.wait(BOUND) == 0
        # People are told at the beginning which device it is, and on a busy machine what was lost before the end.
        words = [line for line in said.splitlines() if not line.endswith(" so far")]
        assert len(words) == (0 if form else 1)
        assert "rror" not in said
        until(lambda: was_stopped(server))


@pytest.mark.parametrize("stream", ["stdout", "stderr"])
@pytest.mark.parametrize("verb", ["view --port 0", "record -o run.mcap", "scan -n 0 --json"])
def test_a_pipe_that_nobody_reads_keeps_no_verb_from_its_end(verb: str, stream: str, tmp_path: Path) -> None:
    """The address of the page was written by the event loop, which then obeyed nothing but SIGKILL."""
    words = verb.replace("run.mcap", str(tmp_path / "run.mcap")).split()
    with served(FIRST) as server:
        with started(words[0], server.path, *words[1:]) as process:
            fill(getattr(process, stream))
            writes_at_once = words[0] == "view" or (words[0], stream) == ("scan", "stdout")
            number = "0x1" if stream == "stdout" else "0x2"
            until(lambda: server.device.scanning and (not writes_at_once or hangs_in_a_write(process.pid, number)))
            process.send_signal(signal.SIGTERM)
            assert process.wait(BOUND) == 0
        until(lambda: was_stopped(server))


def test_a_pipe_that_nobody_reads_keeps_no_simulator_from_its_end() -> None:
    with started("sim", FIRST, "--tcp", ":0") as process:
        fill(process.stderr)
        line_of(process.stdout)
        until(lambda: hangs_in_a_write(process.pid, "0x2"))
        process.send_signal(signal.SIGINT)
        assert process.wait(BOUND) == 0


def fill(pipe: IO[str] | None) -> None:
    """Write to a pipe from which this process reads until it takes no more."""
    assert pipe is not None
    filler = os.open(f"/proc/self/fd/{pipe.fileno()}", os.O_WRONLY | os.O_NONBLOCK)
    with suppress(BlockingIOError):
        while True:
            os.write(filler, b" " * 4096)
    os.close(filler)


def hangs_in_a_write(pid: int, number: str = "0x1") -> bool:
    """Whether a thread of that process is in a system call on that stream of its own, stdout by default."""
    for path in Path(f"/proc/{pid}/task").glob("*/syscall"):
        with suppress(FileNotFoundError, ProcessLookupError):  # a thread that has just ended
            if path.read_text().split()[1:2] == [number]:
                return True
    return False


def test_keep_spinning_leaves_the_motor_on_and_the_laser_off() -> None:
    with served(FIRST) as server:
        invoke("scan", server.path, "--json", "--keep-spinning", code=0)
        until(lambda: not server.device.scanning)
        with server.lock:
            assert server.device.motor_on
