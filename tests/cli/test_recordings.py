"""``lidario record``, ``play``, ``export`` and ``info FILE``."""

import json
import os
import shlex
import time
from concurrent.futures import BrokenExecutor, Executor, Future
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import lidario
from lidario.recording.files import open_stored
from lidario.recording.played import PlayedDevice
from tests.cli.processes import end, invoke, invoke_driven, run, started
from tests.support.cases import KINDS, Case
from tests.support.children import BOUND, line_of, until
from tests.support.devices import some
from tests.support.loop import run_driven
from tests.support.ports import terminal_pair
from tests.support.recorded import Live, assert_same_scans, record, same_points


@pytest.fixture(scope="module")
def live(tmp_path_factory: pytest.TempPathFactory) -> Live:
    return record(tmp_path_factory.mktemp("runs") / "run.mcap", "sim://rplidar-s2", 6)


@pytest.mark.long
def test_record_ends_by_itself_and_names_its_file(tmp_path: Path) -> None:
    path = str(tmp_path / "a.mcap")
    done = invoke_driven("record", "sim://rplidar-s2?via=memory", "-n", "4", "-o", path, "--scans")
    assert (done.exit_code, done.stdout) == (0, f"{path}\n"), done.stderr
    assert "4 scans" in done.stderr
    summary = json.loads(invoke("info", path, "--json").stdout)
    assert summary["scans"] in (4, 5)
    assert (summary["damage"], summary["lost_packets"], summary["timed"]) == (None, 0, True)
    # The motor needs longer than that to be at its speed.
    invoke_driven("record", "sim://rplidar-s2?via=memory", "-t", "1s", "-o", path, "--force", code=0)
    assert 0.9 < json.loads(invoke("info", path, "--json").stdout)["duration_s"] < 1.3


@pytest.mark.long
def test_two_that_begin_in_one_second_and_name_no_file_have_files_of_their_own(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    named = [invoke_driven("record", "sim://rplidar-s2?via=memory", "-n", "1").stdout.strip() for _ in range(3)]
    assert sorted(path.name for path in tmp_path.iterdir()) == sorted(named)


@pytest.mark.long
def test_other_verbs_read_a_recording_to_its_end(live: Live, tmp_path: Path) -> None:
    path = str(live.path)
    done = invoke("stats", f"{path}?rate=0", "-t", "30s", "--json")
    assert done.exit_code in (0, 5), done.stderr
    assert "Stop" not in done.stderr
    assert json.loads(done.stdout)["scans"] >= len(live.scans) - 2
    drawn = invoke("plot", f"{path}?rate=0", "-n", "50", "-o", str(tmp_path / "a.svg"))
    assert (drawn.exit_code, drawn.stderr) == (0, "")
    for words in (["start"], ["stop"], ["speed", "12"]):
        turned = invoke("motor", *words, path)
        assert (turned.exit_code, turned.stdout) == (2, "")
        assert "error: a recording has no motor" in turned.stderr


def test_a_recording_without_a_scan_is_told(live: Live, tmp_path: Path) -> None:
    # From the descriptor on: packets of a tenth of a revolution.
    received = b"".join(data for direction, data, _ in live.chunks if direction == "in")
    begin = received.rindex(bytes.fromhex("a55a5400004085"))
    path = tmp_path / "short.bin"
    path.write_bytes(received[begin : begin + 7 + 10 * 84])
    for words in ("scan", "scan -n 0 --json", "stats -t 1s", f"plot -o '{tmp_path}/a.svg'"):
        verb, *options = shlex.split(words)
        done = invoke(verb, f"{path}?rate=0", *options)
        assert (done.exit_code, "holds no full revolution" in done.stderr) == (7, True), done.stderr


def test_the_files_of_a_split_recording_have_names_of_their_own(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    path.write_bytes(b"mine")
    assert invoke("record", "/dev/nothing-is-here", "-o", str(path), "--split", "1m").exit_code == 3
    assert path.read_bytes() == b"mine"


@pytest.mark.long
def test_a_recording_that_ends_by_itself_is_told_once(tmp_path: Path) -> None:
    """It was logged, and told once more as the error of the command."""
    path = tmp_path / "run.mcap"
    with started("record", "sim://rplidar-s2?via=memory", "-o", str(path)) as process:
        until(lambda: path.exists() and path.stat().st_size)
        path.unlink()
        _, said = process.communicate(timeout=BOUND)
    assert process.returncode == 4
    assert said.count("was removed while it was written") == 1
    assert said.splitlines()[-1].startswith(f"error: {path} was removed")


@pytest.mark.parametrize("until", [("-t", "2s"), ("-n", "1")])
def test_a_stream_that_never_begins_is_an_error(tmp_path: Path, until: tuple[str, str]) -> None:
    """Its `ResponseTimeout` was taken for the end of the time that was asked for."""
    source, path = "sim://rplidar-s2?via=memory&fault=silent:0.1s", str(tmp_path / "a.mcap")
    done = invoke_driven("record", source, "-o", path, *until)
    assert (done.exit_code, done.stdout) == (5, "")
    assert "error: no response to SCAN" in done.stderr


def test_ctrl_c_before_there_is_a_file_names_none(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    with terminal_pair() as (master, _, silent), started("record", silent, "-o", str(path)) as process:
        os.read(master, 1)  # it asks what is there
        said, told = end(process)
    assert (process.returncode, said, path.exists()) == (130, "", False), told


@pytest.mark.long
def test_ctrl_c_is_the_end_of_a_recording(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    with started("record", "sim://rplidar-s2", "-o", str(path)) as process:
        while not path.exists() or path.stat().st_size < 50_000:
            assert process.poll() is None
            time.sleep(0.05)  # the file is what tells
        said, told = end(process)
    assert (process.returncode, said) == (0, f"{path}\n"), told
    assert "Traceback" not in told
    assert open_stored(path).damage == ""


def test_info_tells_what_is_in_a_file(live: Live, tmp_path: Path) -> None:
    said = invoke("info", str(live.path)).stdout
    assert live.info.model in said
    assert live.info.serial in said
    assert "0 revolutions missing, 0 interruptions" in said
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(live.path.read_bytes()[:20_000])
    told = invoke("info", str(cut), code=0)
    assert "the file was cut" in told.stderr


@pytest.mark.parametrize("verb", [("info",), ("scan",), ("play",)])
def test_where_nothing_can_be_read_the_code_is_7(tmp_path: Path, verb: tuple[str, ...]) -> None:
    (tmp_path / "bad.mcap").write_bytes(bytes(300))
    for name in ("bad.mcap", "missing.mcap", "missing.bin"):
        done = invoke(*verb, str(tmp_path / name), code=7)
        assert done.stderr.startswith("error: ")


@pytest.mark.long
def test_export(live: Live, tmp_path: Path) -> None:
    scans = list(lidario.decode_file(live.path))
    for form in ("npz", "csv", "mcap"):
        invoke("export", str(live.path), str(tmp_path / f"out.{form}"), code=0)
    with np.load(tmp_path / "out.npz") as out:
        assert "intensities" not in out  # the format has none
        assert out["starts"].dtype == out["stamps_ns"].dtype == out["lost_packets"].dtype == np.int64
        assert out["device_angles"].dtype == out["device_distances"].dtype == np.float32
        assert out["stamps_ns"].tolist() == [scan.wall_stamp_ns for scan in scans]
        assert np.diff(out["starts"]).tolist() == [len(scan) for scan in scans]
        np.testing.assert_array_equal(out["device_angles"], np.concatenate([s.device_angles for s in scans]))
        np.testing.assert_array_equal(out["device_distances"], np.concatenate([s.device_distances for s in scans]))
        assert json.loads(str(out["meta"]))["serial"] == live.info.serial
    rows = (tmp_path / "out.csv").read_text().splitlines()
    assert rows[0] == "seq,wall_stamp_ns,angle_rad,range_m,intensity"
    assert len(rows) == 1 + sum(len(scan) for scan in scans)
    assert_same_scans(scans, list(lidario.decode_file(tmp_path / "out.mcap")))
    assert {path.name for path in tmp_path.iterdir()} == {"out.npz", "out.csv", "out.mcap"}
    assert invoke("export", str(live.path), str(tmp_path / "out.npz")).exit_code == 4
    assert invoke("export", str(live.path), str(tmp_path / "out.npz"), "--force").exit_code == 0
    assert invoke("export", str(live.path), str(tmp_path / "no" / "out.npz")).exit_code == 4


@pytest.mark.long
def test_several_files_are_exported_on_processes_and_one_bad_one_harms_no_other(live: Live, tmp_path: Path) -> None:
    for name in ("a.mcap", "b.mcap"):
        (tmp_path / name).write_bytes(live.path.read_bytes())
    (tmp_path / "bad.mcap").write_bytes(b"nothing")
    files = [str(tmp_path / name) for name in ("a.mcap", "bad.mcap", "b.mcap")]
    done = run("export", *files, str(tmp_path / "{}.npz"), "-j", "2")
    assert done.returncode == 7
    assert "bad.mcap" in done.stderr
    assert "Traceback" not in done.stderr
    one, other = (tmp_path / "a.npz").read_bytes(), (tmp_path / "b.npz").read_bytes()
    assert len(one) == len(other) > 100_000


class Killed(Executor):
    """Processes that the system has killed."""

    def submit(self, *_: Any, **__: Any) -> Future[Any]:
        done = Future[Any]()
        done.set_exception(BrokenExecutor("terminated abruptly"))
        return done


def test_a_process_that_is_killed_is_told(live: Live, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("lidario.cli.export.processes", lambda _: Killed())
    (tmp_path / "b.mcap").write_bytes(live.path.read_bytes())
    done = invoke("export", str(live.path), str(tmp_path / "b.mcap"), str(tmp_path / "{}.npz"), "-j", "2", code=4)
    assert f"{tmp_path / 'b.npz'} is not written: a process was killed" in done.stderr
    assert [each.name for each in tmp_path.iterdir()] == ["b.mcap"]


@pytest.mark.parametrize("option", ["--family", "--model", "--sample-us"])
def test_what_is_said_of_bare_bytes_is_told_to_be_unused_of_a_recording(
    live: Live, tmp_path: Path, caplog: pytest.LogCaptureFixture, option: str
) -> None:
    value = {"--family": "ydlidar", "--model": "x4", "--sample-us": "1000"}[option]
    assert invoke("export", str(live.path), str(tmp_path / "out.npz"), option, value).exit_code == 0
    said = f"{live.path} tells by itself which lidar it is of: what was said of bare bytes is not used"
    assert caplog.messages == [said]
    # Who names the family that it is of has said nothing wrong.
    assert invoke("export", str(live.path), str(tmp_path / "b.npz"), "--family", live.info.family).exit_code == 0
    assert caplog.messages == [said]


@pytest.mark.exhaustive("case", sample=KINDS)
def test_bare_bytes_are_exported_as_they_are_decoded(case: Case, tmp_path: Path) -> None:
    """Of what a user says of them, too; tests/test_golden.py tells that the scans are right."""
    data, known = case.told + case.descriptor + case.raw, (case.truth.family, str(1.5 * case.sample_us))
    (tmp_path / "raw.bin").write_bytes(data)
    target = tmp_path / "out.npz"
    done = invoke("export", str(tmp_path / "raw.bin"), str(target), "--family", known[0], "--sample-us", known[1])
    assert done.exit_code == 0, done.stderr
    right = lidario.decode_arrays(data, family=known[0], sample_us=float(known[1]))
    with np.load(target) as out:
        for name in ("device_angles", "device_distances", "starts", "stamps_ns", "lost_packets"):
            np.testing.assert_array_equal(out[name], getattr(right, name))


def played(device: PlayedDevice, live: Live, count: int) -> list[lidario.Scan]:
    """So many scans, as a session gets them that takes what is played for the recorded device."""

    async def main() -> list[lidario.Scan]:
        async with lidario.open_lidar(device, family=live.info.family) as lidar:
            assert lidar.info == live.info
            for mode, recorded in zip(await lidar.get_modes(), live.modes, strict=True):
                # What a sample takes is measured where no device tells it.
                assert mode == replace(recorded, sample_us=mode.sample_us)
                assert mode.sample_us == pytest.approx(recorded.sample_us, rel=0.001)
            async with lidar.scans(depth=64) as stream:
                scans = await some(stream, count)
                assert device.scanning or device.finished
                return scans

    return run_driven(main)


def test_a_played_recording_is_a_device_like_the_recorded_one(live: Live) -> None:
    device = PlayedDevice(open_stored(live.path))
    for one, other in zip(live.scans, played(device, live, len(live.scans)), strict=True):
        assert same_points(one, other)
    assert not device.scanning
    # The speed of the motor has no response, so it is in no recording.
    assert {each.data[1] for each in device.log if not each.obeyed} == {0xA8}


ONLY_TALK = ("ldrobot-ld06", "ydlidar-x3")


@pytest.mark.parametrize(
    "model",
    ["hlds-lds01", "hokuyo-urg04lx", "hokuyo-ust10lx", "ldrobot-ld14p", "ydlidar-g4", "ydlidar-tmini", *ONLY_TALK],
)
def test_a_played_recording_is_started_and_stopped_as_its_family_is(tmp_path: Path, model: str) -> None:
    """By a letter, by lines of text, or by a request whose response tells another type than the recording.

    One that only talks was never asked to start: it begins as soon as somebody listens, and hears no request.
    """
    live = record(tmp_path / "run.mcap", f"sim://{model}", 4)
    device = PlayedDevice(open_stored(live.path), loop=True)
    assert model in ONLY_TALK or device.transmit(0) == b""
    found = {scan.device_distances.tobytes() for scan in played(device, live, 3)}
    assert found & {scan.device_distances.tobytes() for scan in live.scans}
    if model in ONLY_TALK:
        device.receive(b"\xa5\x50", 0)
    else:
        assert not device.scanning
    assert {each.obeyed for each in device.log} == {model not in ONLY_TALK}


def test_a_played_recording_of_lines_of_text_reads_them_as_any_program_writes_them(tmp_path: Path) -> None:
    device = PlayedDevice(open_stored(record(tmp_path / "run.mcap", "sim://hokuyo-urg04lx", 2).path))
    device.receive(b"\n\nV", 0)
    assert device.transmit(0) == b""
    device.receive(b"V\nQT\nBM\n" + bytes(1000), 0)
    said = device.transmit(0)
    assert said.startswith(b"VV\n00P\nVEND:Hokuyo")
    assert said.endswith(b"\n\nQT\n00P\n\n")
    assert [(each.data, each.obeyed) for each in device.log[:3]] == [
        (b"VV\n", True), (b"QT\n", True), (b"BM\n", False),
    ]  # fmt: skip
    device.receive(b"\nMD0044072501000\n", 0)
    assert device.transmit(0).startswith(b"MD0044072501000\n00P\n\nMD0044072501000\n99b\n")


@pytest.mark.parametrize("verb", ["play", "info"])
@pytest.mark.parametrize("option", ["rate=2", "loop=1", "from=1"])
def test_options_of_a_source_that_a_verb_does_not_follow_are_refused(live: Live, verb: str, option: str) -> None:
    done = invoke(verb, f"{live.path}?{option}")
    assert (done.exit_code, done.stdout) == (2, "")
    assert f"{option.partition('=')[0]}= " in done.stderr


@pytest.mark.long
def test_play_serves_another_process(live: Live) -> None:
    with started("play", str(live.path), "--loop", "--tcp", ":0") as process:
        name = line_of(process.stdout).strip()
        done = run("scan", f"{name}?family={live.info.family}", "-n", "2", "--json")
        assert done.returncode == 0, done.stderr
        assert len(done.stdout.splitlines()) == 2
        end(process)
    assert process.returncode == 0


@pytest.mark.long
def test_play_tells_no_speed_that_is_not_known(live: Live, tmp_path: Path) -> None:
    """As of bare bytes, or of what came over a network."""
    bare = tmp_path / "raw.bin"
    bare.write_bytes(live.received)
    with started("play", str(bare), "--loop", "--tcp", ":0") as process:
        line_of(process.stdout)
        assert f"\n{bare}, until its end or Ctrl-C" in end(process)[1]
