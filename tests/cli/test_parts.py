"""``lidario record --reconnect --split --keep``, and every verb that takes a pattern of files."""

import json
from pathlib import Path

import pytest

from lidario.recording.decode_file import FileDecoder
from tests.cli.processes import invoke, invoke_driven
from tests.support.recorded import thread_takes_no_time

SOURCE = "sim://rplidar-s2?via=memory&fault=replug:2s"


@pytest.fixture(scope="module")
def pattern(tmp_path_factory: pytest.TempPathFactory) -> str:
    folder = tmp_path_factory.mktemp("runs")
    path = str(folder / "run.mcap")
    options = ("--reconnect", "--split", "1s", "--keep", "1GB")
    with thread_takes_no_time():
        done = invoke_driven("record", SOURCE, "-n", "36", "-o", path, *options, code=0)
    assert done.stdout == f"{folder / 'run-*.mcap'}\n"
    files = len(list(folder.iterdir()))
    assert files > 3
    assert "36 scans" in done.stderr
    assert f"{files} files" in done.stderr
    return done.stdout.strip()


@pytest.mark.long
def test_info_tells_of_all_of_them(pattern: str) -> None:
    told = json.loads(invoke("info", pattern, "--json").stdout)
    assert told["scans"] in (36, 37)
    assert (told["damage"], told["losses"], told["streams"]) == (None, 1, 2)
    assert 1.0 < told["away_s"] < 3.0
    assert "1 time, " in invoke("info", pattern).stdout


@pytest.mark.long
def test_a_reader_sees_the_gap(pattern: str) -> None:
    done = invoke("scan", f"{pattern}?rate=0", "-n", "0", "--json", code=0)
    scans = [json.loads(line) for line in done.stdout.splitlines()]
    assert len(scans) in (36, 37)
    assert [scan["seq"] for scan in scans] == [scan.seq for scan in FileDecoder(pattern)]


@pytest.mark.long
def test_they_are_exported_as_one(pattern: str, tmp_path: Path) -> None:
    invoke("export", pattern, str(tmp_path / "{}.mcap"), code=0)
    (path,) = tmp_path.iterdir()
    assert path.name == "run.mcap"
    assert [scan.stamp_ns for scan in FileDecoder(path)] == [scan.stamp_ns for scan in FileDecoder(pattern)]
