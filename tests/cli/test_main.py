"""The frame around the verbs: version, help, usage errors, a missing extra."""

import io
import json
import os
import re
import sys

import pytest

import lidario
from lidario.__main__ import main
from lidario.cli.main import Lidario
from lidario.cli.output import dump
from lidario.cli.streams import emit
from tests.cli.processes import invoke, invoke_driven, run

S2 = "sim://rplidar-s2?via=memory"


def test_version_is_told_without_loading_what_verbs_need() -> None:
    told = run("--version", environment={"PYTHONPROFILEIMPORTTIME": "1"})
    assert (told.returncode, told.stdout) == (0, f"lidario {lidario.__version__}\n")
    loaded = {line.rpartition("|")[2].strip().partition(".")[0] for line in told.stderr.splitlines()}
    assert "lidario" in loaded
    assert not loaded & {"click", "rich"}


def test_no_verb_loads_what_only_several_processes_need() -> None:
    told = run("export", "--help", environment={"PYTHONPROFILEIMPORTTIME": "1"})
    loaded = {line.rpartition("|")[2].strip() for line in told.stderr.splitlines()}
    assert "lidario.cli.export" in loaded
    assert not loaded & {"multiprocessing", "concurrent.futures.process"}


@pytest.mark.parametrize("asked", ["", "3"])
def test_numpy_starts_no_threads_unless_asked_to(asked: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Each would use time of its own while the command starts."""
    monkeypatch.setenv("OPENBLAS_NUM_THREADS", asked)
    if not asked:
        monkeypatch.delenv("OPENBLAS_NUM_THREADS")
    monkeypatch.setattr(sys, "argv", ["lidario", "sim", "--list"])
    assert main() == 0
    assert os.environ["OPENBLAS_NUM_THREADS"] == (asked or "1")


def test_ctrl_c_before_a_verb_has_begun(monkeypatch: pytest.MonkeyPatch) -> None:
    """It was shown where it had come, as a traceback."""

    def interrupted(*_: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(Lidario, "run", interrupted)
    monkeypatch.setattr(sys, "argv", ["lidario", "devices"])
    assert main() == 130


def test_a_terminal_without_columns_is_none(
    monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    """As some programs tell those that they start."""
    monkeypatch.setattr(sys, "argv", ["lidario", "info", S2])
    told = []
    for size in ({}, {"COLUMNS": "0"}):
        monkeypatch.delenv("COLUMNS", raising=False)
        for name, value in size.items():
            monkeypatch.setenv(name, value)
        assert main() == 0
        told.append(capfd.readouterr().out)
    assert "RPLIDAR S2" in told[0]
    assert told[0] == told[1]


@pytest.mark.parametrize("missing", ["click", "rich"])
def test_a_missing_extra_is_one_sentence_that_names_the_cure(
    missing: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setitem(sys.modules, missing, None)
    monkeypatch.delitem(sys.modules, "lidario.cli.main")
    assert main() == 2
    out, err = capsys.readouterr()
    assert (out, err.count("\n")) == ("", 1)
    assert "pip install click rich websockets mcap" in err


@pytest.mark.parametrize(
    ("missing", "words", "package"),
    [
        ("websockets", f"view {S2}", "websockets"),
        ("matplotlib", f"plot {S2} -o x.png", "matplotlib"),
        ("zenoh", f"publish {S2} --ros", "eclipse-zenoh"),
        ("zenoh", "devices --zenoh", "eclipse-zenoh"),
        ("zenoh", "info zenoh:a", "eclipse-zenoh"),
    ],
)
def test_what_a_verb_needs_and_is_missing_is_one_sentence_too(
    missing: str, words: str, package: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, missing, None)
    said = invoke(*words.split(), code=2).stderr
    cure = f"pip install {package}(, or write an .svg)?"
    assert re.fullmatch(f"error: .* needs {package}, which is not installed: {cure}\n", said)


def test_help_names_every_verb() -> None:
    told = invoke("--help", code=0)
    verbs = "devices info scan view watch plot stats publish router doctor report udev motor sim completion"
    for verb in verbs.split():
        assert f"\n  {verb} " in told.stdout
    # What does not fit in its line is cut.
    assert "...\n" not in told.stdout.partition("\nCommands:")[2]


@pytest.mark.parametrize("typed", ["info /dev/none", "--traceback info /dev/none", "info /dev/none --traceback"])
def test_a_traceback_is_shown_when_asked_for(typed: str) -> None:
    ended = invoke(*typed.split())
    assert (ended.exit_code, ended.stdout) == (3, "")
    assert ("Traceback (most recent call last)" in ended.stderr) is ("--traceback" in typed)
    assert ended.stderr.splitlines()[-1].startswith("error: ")
    assert "/dev/none" in ended.stderr.splitlines()[-1]


def test_what_nobody_expected_is_one_line(monkeypatch: pytest.MonkeyPatch) -> None:
    def fail() -> None:
        raise ZeroDivisionError("division by\nzero")

    monkeypatch.setattr("lidario.list_serial_ports", fail)
    monkeypatch.setattr("lidario.list_lidars", _nothing)
    ended = invoke("devices", code=1)
    assert ended.stderr.startswith("error: ")
    assert ended.stderr.count("\n") == 1
    assert "ZeroDivisionError" in ended.stderr


async def _nothing(paths: tuple[str, ...] = ()) -> list[lidario.Found]:
    return []


def test_a_pipe_on_windows_takes_what_its_code_page_has(monkeypatch: pytest.MonkeyPatch) -> None:
    """There, text goes through the stream, and a character that the code page lacks is an error of its own."""
    written = io.BytesIO()
    monkeypatch.setattr(sys, "stdout", io.TextIOWrapper(written, encoding="cp1252", write_through=True))
    emit("5 → 7 m, 90°")
    assert written.getvalue() == b"5 -> 7 m, 90\xb0"


@pytest.mark.parametrize(("words", "said"), [("scan -n 1", r" \d\.\d\d m [+-]\d+deg "), ("info", "us/sample")])
def test_what_ascii_lacks_is_written_in_ascii(words: str, said: str) -> None:
    verb, *options = words.split()
    assert re.search(said, invoke_driven(verb, S2, *options, code=0, charset="ascii").stdout)


def test_json_needs_no_encoding(monkeypatch: pytest.MonkeyPatch) -> None:
    written = io.TextIOWrapper(io.BytesIO(), encoding="ascii")
    monkeypatch.setattr(sys, "stdout", written)
    dump({"path": "r\xf6 \udcff.mcap"})
    written.seek(0)
    assert json.loads(written.read()) == {"path": "r\xf6 \udcff.mcap"}
