"""A long recording that several processes decode gives what one gives, to the last byte."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import BrokenExecutor, Executor, Future
from copy import copy
from functools import lru_cache
from itertools import cycle
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import pytest

import lidario
from lidario.cli.export import export_one
from lidario.config.read import Config
from lidario.families.base import Known
from lidario.families.registry import FAMILIES
from lidario.recording import decode_file, divided
from lidario.recording.decode_file import FileDecoder
from lidario.revolution import device_clock
from lidario.scan import Scan
from lidario.session.lidar import Lidar
from tests.cli.processes import in_memory, run, started
from tests.support.children import until
from tests.support.loop import driven
from tests.support.recorded import Live, assert_same_scans
from tests.support.recorded import record as record_any

SECONDS = 20.0
MODEL = "hokuyo-urg04lx"
"""One that sends little."""
LEAD_NS = 3_200_000_000
JOBS = 3
OF_EACH_FAMILY = [
    "rplidar-express", "rplidar-wrong-us", "rplidar-a1", "ydlidar-tmini-plus-sh", "ydlidar-x2", "ldrobot-ld14",
    "neato-xv11", "camsense-x1", "irobotix-delta2g", "hokuyo-urg04lx", "hlds-lds01",
]  # fmt: skip
"""The second of them alone shows that what two decoders hold is compared."""
MODELS = [name for family in FAMILIES for name in family.simulated if name != "ydlidar-x4"]
"""All but one that is not found while its line is so bad."""
NEVER_ALIKE = (
    *("rplidar-no-modes", "rplidar-unknown-response"),
    *("rplidar-wrong-us", "rplidar-zero-us", "rplidar-other-format"),
)
"""Two send packets of one sample, and where their first mark stood is never forgotten; the others tell a wrong time
of a sample or none, and what was measured instead is not forgotten either."""
FAULTS = ("drop:0.02%,stall:300ms,replug:11s", "burst:0.01%,duplicate:0.01%,reboot:7s")


class Here(Executor):
    """Runs at once what it is given, or fails at it."""

    def __init__(self, error: Exception | None = None) -> None:
        self._error = error

    def submit(self, run: Callable[..., Any], /, *args: Any, **named: Any) -> Future[Any]:
        """As `Executor.submit`."""
        done: Future[Any] = Future()
        if self._error is None:
            done.set_result(run(*args, **named))
        else:
            done.set_exception(self._error)
        return done


@pytest.fixture
def joined(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """Spans of seconds, and a device's clock that is followed over as few; which span was gone on with."""
    monkeypatch.setattr(divided, "LEAD_NS", LEAD_NS)
    monkeypatch.setattr(divided, "LEAST_NS", 2 * LEAD_NS)
    monkeypatch.setattr(divided, "processes", lambda *_: Here())
    monkeypatch.setattr(decode_file, "BLOCK_NS", 300_000_000)
    monkeypatch.setattr(device_clock, "BUCKETS", 3)
    found, make = list[int](), divided.Joined

    def told(span: int, begin: int, shift: int) -> Any:
        found.append(span)
        return make(span, begin, shift)

    monkeypatch.setattr(divided, "Joined", told)
    return found


def record(path: Path, model: str, fault: str) -> Path:
    """A recording of some seconds."""
    path.write_bytes(recorded(model, fault, SECONDS))
    return path


@lru_cache(maxsize=4)
def recorded(model: str, fault: str, seconds: float) -> bytes:
    """The same; several tests take the same one."""
    with TemporaryDirectory() as folder:
        return made(Path(folder, "a.mcap"), model, fault, seconds)


def made(path: Path, model: str, fault: str, seconds: float) -> bytes:
    """Record into a file; return what it holds."""

    async def read(lidar: Lidar, _: Live) -> None:
        async with lidar.scans(depth=64) as stream:
            first = await anext(stream)
            async for scan in stream:
                if scan.stamp_ns - first.stamp_ns > seconds * 1e9:
                    break

    record_any(path, in_memory(model, f"fault={fault.replace('%', '%25')}"), act=read)
    return path.read_bytes()


def renumbered(scan: Scan, shift: int) -> Scan:
    """The scan with another number."""
    other = copy(scan)
    object.__setattr__(other, "seq", scan.seq + shift)
    return other


def exported(path: Path, out: Path, jobs: int) -> bytes:
    """What ``lidario export`` writes of it."""
    options = {"frame": "laser", "beams": None, "order": "counter-clockwise", "preset": "rep103", "mount_yaw": 0.0,
               "filtered": "nan"}  # fmt: skip
    export_one(str(path), str(out), Known(), options, True, Config(), jobs)
    return out.read_bytes()


@pytest.mark.long
@pytest.mark.exhaustive(
    "case",
    sample=[*zip(OF_EACH_FAMILY, cycle(FAULTS), strict=False)],
    full=[*zip(MODELS, cycle(FAULTS), strict=False)],
)
def test_all_scans_are_those_of_one_process(tmp_path: Path, case: tuple[str, str], joined: list[int]) -> None:
    model, fault = case
    path = record(tmp_path / "a.mcap", model, fault)
    with divided.divided(FileDecoder(path), JOBS, iter, tmp_path, renumbered) as made:
        found = list(made)
    alone = list(FileDecoder(path))
    assert len(found) == len(alone) > 0
    assert_same_scans(alone, found)
    assert joined or model in NEVER_ALIKE
    assert [each.name for each in tmp_path.iterdir()] == ["a.mcap"]


@pytest.mark.long
@pytest.mark.exhaustive("form", sample=[".npz"], full=[".csv", ".npz", ".mcap"])
def test_what_is_exported_is_the_same_to_the_last_byte(tmp_path: Path, form: str, joined: list[int]) -> None:
    model = {".csv": "rplidar-s2", ".npz": "ydlidar-4ros", ".mcap": "ldrobot-ld06"}[form]
    path = record(tmp_path / "a.mcap", model, FAULTS[0])
    alone = exported(path, tmp_path / f"one{form}", 1)
    assert not joined
    assert exported(path, tmp_path / f"several{form}", JOBS) == alone
    assert joined


@pytest.mark.long
def test_so_it_is_of_a_file_that_is_cut_and_damaged(tmp_path: Path, joined: list[int]) -> None:
    path = record(tmp_path / "a.mcap", MODEL, FAULTS[0])
    data = bytearray(path.read_bytes())
    for place in (len(data) // 4, len(data) // 2):
        data[place] ^= 0x55
    path.write_bytes(data[: len(data) * 9 // 10])
    assert "left out (2 times)" in FileDecoder(path).recording.damage
    assert exported(path, tmp_path / "several.csv", JOBS) == exported(path, tmp_path / "one.csv", 1)
    assert joined


@pytest.mark.long
@driven
async def test_so_it_is_of_several_files_that_are_one_recording(tmp_path: Path, joined: list[int]) -> None:
    async with (
        lidario.open_lidar(in_memory(MODEL)) as lidar,
        lidar.record(tmp_path / "a.mcap", split_s=5.0),
        lidar.scans(depth=64) as stream,
    ):
        for _ in range(200):
            await anext(stream)
    files = tmp_path / "a-*.mcap"
    assert exported(files, tmp_path / "several.csv", JOBS) == exported(files, tmp_path / "one.csv", 1)
    assert joined == [2, 1]


@pytest.mark.long
def test_where_none_comes_to_hold_the_same_one_process_decodes_all(
    tmp_path: Path, joined: list[int], monkeypatch: pytest.MonkeyPatch
) -> None:
    path = record(tmp_path / "a.mcap", MODEL, FAULTS[0])
    numbers = iter(range(1_000_000))
    monkeypatch.setattr(decode_file, "held", lambda *_: next(numbers).to_bytes(8, "little"))
    assert exported(path, tmp_path / "several.csv", JOBS) == exported(path, tmp_path / "one.csv", 1)
    assert not joined


@pytest.mark.long
def test_bare_bytes_and_short_recordings_are_decoded_by_one_process(
    tmp_path: Path, joined: list[int], monkeypatch: pytest.MonkeyPatch
) -> None:
    path = record(tmp_path / "a.mcap", MODEL, FAULTS[0])
    raw = tmp_path / "raw.bin"
    raw.write_bytes(b"".join(piece.data for piece in FileDecoder(path).recording.pieces()))
    monkeypatch.setattr(divided, "processes", None)
    assert exported(raw, tmp_path / "raw-3.csv", JOBS) == exported(raw, tmp_path / "raw.csv", 1)
    monkeypatch.setattr(divided, "LEAST_NS", round(SECONDS * 1e9))
    assert exported(path, tmp_path / "several.csv", JOBS) == exported(path, tmp_path / "one.csv", 1)


@pytest.mark.long
@pytest.mark.parametrize(
    ("form", "error", "words"),
    [
        (".csv", lidario.RecordingError("it was cut while it was read"), "cut while it was read"),
        (".npz", BrokenExecutor("terminated abruptly"), "was killed: is memory short"),
        (".mcap", lidario.RecordingError("it was cut while it was read"), "cut while it was read"),
    ],
)
def test_what_fails_on_another_process_is_told_and_leaves_nothing(
    tmp_path: Path, form: str, error: Exception, words: str, joined: list[int], monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "a.mcap"
    path.write_bytes(recorded(MODEL, "", 14.0))
    monkeypatch.setattr(divided, "processes", lambda *_: Here(error))
    with pytest.raises(lidario.LidarError, match=words):
        exported(path, tmp_path / f"several{form}", JOBS)
    assert not joined
    assert [each.name for each in tmp_path.iterdir()] == ["a.mcap"]


@pytest.mark.long
def test_real_processes_do_the_same(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "a.mcap"
    monkeypatch.setattr("tests.recording.test_divided.SECONDS", 245.0)
    record(path, MODEL, "drop:0.02%,stall:300ms")
    for jobs in ("1", "2"):
        done = run("export", str(path), str(tmp_path / f"{jobs}.csv"), "-j", jobs)
        assert done.returncode == 0, done.stderr
    assert (tmp_path / "1.csv").read_bytes() == (tmp_path / "2.csv").read_bytes()


@pytest.mark.long
def test_when_it_is_killed_no_process_and_no_part_is_left(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "a.mcap"
    monkeypatch.setattr("tests.recording.test_divided.SECONDS", 245.0)
    record(path, MODEL, "drop:0.02%,stall:300ms")
    with started("export", str(path), str(tmp_path / "a.csv"), "-j", "2") as process:
        until(lambda: any(tmp_path.glob(".export-*/*")))
        process.kill()
        process.wait()
        until(lambda: not any(tmp_path.glob(".export-*")))
