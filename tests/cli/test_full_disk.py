"""What is written on a full disk: a full stdout is an error with exit code 4; a full stderr changes no exit code.

Python keeps what it could not write and tries once more at its end; that ends the process with 120. With
``PYTHONUNBUFFERED``, which many containers set, it keeps nothing. Both ways are tried.
"""

import os
import re
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from tests.cli.processes import invoke_driven, run

SIM = "sim://rplidar-s2?via=memory"
WRITE = [("--version",), ("--help",), ("sim", "--list"), ("devices", "--json"), ("info", SIM), ("scan", SIM)]
"""Commands that write to stdout."""
RUNS = [
    (("scan", "/dev/nothing-is-here"), 3),
    (("scan", "--no-such-option"), 2),
    (("scan", SIM, "--traceback", "--mode", "none"), 2),
    (("scan", SIM, "-n", "2"), 0),
]
"""Commands, and the exit code of each."""


def ended(arguments: tuple[str, ...], unbuffered: bool, *, on_full_disk: str) -> subprocess.CompletedProcess[str]:
    """Run the command with one of its streams on a full disk."""
    environment = {"PYTHONUNBUFFERED": "1" if unbuffered else ""}
    with open("/dev/full", "wb", buffering=0) as disk:
        return run(*arguments, environment=environment, **{on_full_disk: disk})


@pytest.mark.long
@pytest.mark.exhaustive("unbuffered", sample=[False], full=[False, True])
@pytest.mark.exhaustive("arguments", sample=[WRITE[1], *WRITE[-2:]], full=WRITE)
def test_stdout_on_a_full_disk_is_told(arguments: tuple[str, ...], unbuffered: bool) -> None:
    done = ended(arguments, unbuffered, on_full_disk="stdout")
    assert done.stderr.count("error: stdout cannot be written: No space left on device. Free some room") == 1
    assert "unexpected" not in done.stderr
    assert "ignored" not in done.stderr
    assert done.returncode == 4, done.stderr


@pytest.mark.long
@pytest.mark.exhaustive("unbuffered", sample=[False], full=[False, True])
@pytest.mark.exhaustive("run", sample=[RUNS[0], RUNS[-1]], full=RUNS)
def test_a_log_on_a_full_disk_changes_no_exit_code(run: tuple[tuple[str, ...], int], unbuffered: bool) -> None:
    arguments, code = run
    done = ended(arguments, unbuffered, on_full_disk="stderr")
    assert done.returncode == code
    assert bool(done.stdout) is (code == 0)


@contextmanager
def no_room(size: int = 100) -> Iterator[None]:
    """Files may have no more than so many bytes, as on a disk that is nearly full."""
    import resource

    usual = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, usual[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, usual)


@pytest.mark.parametrize("name", ["full.svg", "x" * 300 + ".svg"], ids=["full disk", "long name"])
def test_a_picture_that_cannot_be_written_is_told_and_the_one_before_stays(tmp_path: Path, name: str) -> None:
    (tmp_path / "full.svg").write_text("mine")
    with no_room():
        done = invoke_driven("plot", SIM, "-o", str(tmp_path / name), "--force", code=4)
    assert f"{name} cannot be written: " in done.stderr
    assert (tmp_path / "full.svg").read_text() == "mine"
    assert os.listdir(tmp_path) == ["full.svg"]


@pytest.mark.parametrize("options", [(), ("--split", "1s")], ids=["one file", "split"])
def test_a_recording_that_cannot_begin_leaves_no_file(tmp_path: Path, options: tuple[str, ...]) -> None:
    """So the same command works when there is room again."""
    command = "record", SIM, "-n", "1", "-o", str(tmp_path / "run.mcap"), *options
    with no_room():
        done = invoke_driven(*command, code=4)
    assert "cannot be written: " in done.stderr
    assert os.listdir(tmp_path) == []
    assert invoke_driven(*command).exit_code == 0


def test_of_a_recording_that_is_cut_short_it_is_told_that_scans_are_missing(tmp_path: Path) -> None:
    """It was said how many had come, as if all of them were in the file."""
    with no_room(100_000):
        done = invoke_driven("record", SIM, "-n", "60", "-o", str(tmp_path / "run.mcap"), code=4)
    told, lost, error = done.stderr.splitlines()[:3]
    assert " scans" in told
    assert re.fullmatch(
        r"without the last \d+ bytes, and the scans in them, because the file could not be written", lost
    )
    assert "cannot be written: " in error


@pytest.mark.parametrize("kind", [".csv", ".npz", ".mcap"])
def test_an_export_that_cannot_be_written_is_told(tmp_path: Path, kind: str) -> None:
    """Whether a file of this name exists cannot be found out either, as in a folder of another user."""
    recording = tmp_path / "in.mcap"
    assert invoke_driven("record", SIM, "-n", "1", "-o", str(recording)).exit_code == 0
    name = "x" * 300 + kind
    done = invoke_driven("export", str(recording), str(tmp_path / name), code=4)
    assert f"{name} cannot be written: " in done.stderr


@pytest.mark.long
@pytest.mark.parametrize("arguments", [("--version",), ("scan", "--help")], ids=" ".join)
def test_a_reader_that_is_gone_is_no_error(arguments: tuple[str, ...]) -> None:
    reader, writer = os.pipe()
    os.close(reader)
    try:
        done = run(*arguments, environment={"PYTHONUNBUFFERED": ""}, stdout=writer)
    finally:
        os.close(writer)
    assert (done.returncode, done.stderr) == (0, "")
