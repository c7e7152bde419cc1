"""Standard streams that are closed, or whose encoding lacks what is written."""

import os
import subprocess
import sys

import pytest

from lidario.cli.streams import emit
from tests.support.children import BOUND, ROOT


def with_closed(streams: str, *arguments: str) -> subprocess.CompletedProcess[str]:
    """Run the command with some of its streams closed, as a shell closes them; warnings appear on stderr."""
    return subprocess.run(
        ["sh", "-c", f'exec "$0" -W error -m lidario "$@" {streams}', sys.executable, *arguments],
        cwd=ROOT, capture_output=True, text=True, timeout=BOUND, check=False,
    )  # fmt: skip


@pytest.mark.parametrize(
    ("closed", "arguments"),
    [(">&-", ("scan", "sim://rplidar-s2", "-n", "0")), (">&- 2>&-", ("sim",)), (">&- <&-", ("--version",))],
    ids=str,
)
def test_a_closed_stdout_is_said_and_ends_it(closed: str, arguments: tuple[str, ...]) -> None:
    ended = with_closed(closed, *arguments)
    assert ended.returncode == 2
    assert ended.stderr == ("" if "2>" in closed else "error: there is nowhere to write to: stdout is closed\n")


@pytest.mark.long
def test_a_closed_stderr_hides_messages_alone() -> None:
    ended = with_closed("2>&- <&-", "scan", "sim://rplidar-s2?via=memory", "--json")
    assert ended.returncode == 0
    assert ended.stdout.count("\n") == 1


def test_a_closed_stdin_is_not_noticed() -> None:
    ended = with_closed("<&-", "--version")
    assert (ended.returncode, ended.stderr) == (0, "")


@pytest.mark.parametrize(
    ("encoding", "written"), [("utf-8", "r\xf6 → ".encode() + b"\xff.mcap"), ("ascii", b"r? -> \xff.mcap")]
)
def test_a_file_name_is_printed_as_its_bytes(
    encoding: str, written: bytes, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A name that is none in the encoding of this process, and that a script uses to open the file."""
    reader, writer = os.pipe()
    with open(reader, "rb") as told, open(writer, "w", encoding=encoding) as stdout:
        monkeypatch.setattr(sys, "stdout", stdout)
        emit("r\xf6 → \udcff.mcap")
        assert told.read1() == written
