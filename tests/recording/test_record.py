"""What is written, as other programs read it; and a disk that is slow, full or not there."""

import asyncio
import json
import sys
import threading
import time
from pathlib import Path
from typing import Any

import pytest
from mcap.reader import make_reader
from rosbags.rosbag2 import Reader
from rosbags.typesys import Stores, get_typestore
from rosbags.typesys.msg import get_types_from_msg
from rosbags.typesys.store import Typestore

import lidario
from lidario.recording import record as record_module
from lidario.recording.files import open_stored
from lidario.recording.ros_messages import DEFINITIONS, LASERSCAN_TYPE, RAW_TYPE
from lidario.recording.write import EVENTS_TOPIC, RAW_TOPIC, SCAN_TOPIC, FileWriter
from tests.support.children import ended
from tests.support.loop import driven, run_driven
from tests.support.recorded import record
from tests.support.refused import refused

SOURCES = ("sim://rplidar-s2", "sim://ydlidar-4ros")
both_sources = pytest.mark.parametrize("source", SOURCES)


@pytest.fixture
def store() -> Typestore:
    types = get_typestore(Stores.ROS2_HUMBLE)
    types.register(get_types_from_msg(DEFINITIONS[RAW_TYPE], RAW_TYPE))
    return types


def decoded(store: Typestore, data: bytes, name: str) -> Any:
    return store.deserialize_cdr(data, name)


@both_sources
def test_every_chunk_in_both_directions_is_in_the_file(tmp_path: Path, source: str, store: Typestore) -> None:
    live = record(tmp_path / "a.mcap", source, 5)
    with open(live.path, "rb") as file:
        reader = make_reader(file, validate_crcs=True)
        (about,) = [each.metadata for each in reader.iter_metadata()]
        offset = int(about["clock_offset_ns"])
        found = [
            (message.log_time - offset, decoded(store, message.data, RAW_TYPE))
            for _, _, message in reader.iter_messages(topics=[RAW_TOPIC])
        ]
        summary = reader.get_summary()
    chunks = [("out" if raw.direction else "in", raw.data.tobytes(), at_ns) for at_ns, raw in found]
    assert chunks == live.chunks[: len(chunks)]
    # What follows came when the recording had ended.
    assert len(live.chunks) - len(chunks) < 0.3 * len(chunks)
    assert {direction for direction, _, _ in chunks} == {"in", "out"}
    assert (about["family"], about["model"], about["serial"]) == (
        live.info.family, live.info.model, live.info.serial,
    )  # fmt: skip
    assert about["lidario"] == lidario.__version__
    assert about["source"].startswith(source)
    seconds = (chunks[-1][2] - chunks[0][2]) / 1e9
    assert summary is not None
    assert len(summary.chunk_indexes) >= seconds


@both_sources
def test_rosbags_reads_scans_that_equal_to_laserscan(tmp_path: Path, source: str, store: Typestore) -> None:
    live = record(tmp_path / "a.mcap", source, 4, scans=True)
    with Reader(live.path) as reader:
        assert {each.topic: each.msgtype for each in reader.connections} == {
            RAW_TOPIC: RAW_TYPE, EVENTS_TOPIC: "std_msgs/msg/String", SCAN_TOPIC: LASERSCAN_TYPE,
        }  # fmt: skip
        scans = [(at_ns, data) for each, at_ns, data in reader.messages() if each.topic == SCAN_TOPIC]
        events = [
            json.loads(decoded(store, data, "std_msgs/msg/String").data)["event"]
            for connection, _, data in reader.messages()
            if connection.topic == EVENTS_TOPIC
        ]
    assert len(live.scans) <= len(scans) <= len(live.scans) + 1
    (beams,) = {len(decoded(store, data, LASERSCAN_TYPE).ranges) for _, data in scans}
    assert abs(beams - len(live.scans[-1])) <= 2
    for scan, (at_ns, data) in zip(live.scans, scans, strict=False):
        wanted = scan.to_laserscan(beams)
        # That such bytes are the message, rosbags tells in tests/ros/test_messages.py.
        assert (at_ns, data, wanted.frame_id) == (wanted.stamp_ns, wanted.to_cdr(), "laser")
    assert events.count("began") == events.count("ended") == 1


def test_the_definition_of_the_scan_is_that_of_ros(store: Typestore) -> None:
    ours = get_types_from_msg(DEFINITIONS[LASERSCAN_TYPE], LASERSCAN_TYPE)
    for name in ours:
        assert list(ours[name][1]) == list(store.fielddefs[name][1]), name


@pytest.mark.long
@driven
async def test_a_slow_disk_ends_the_recording_and_not_the_scanning(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    free = threading.Event()
    flush = FileWriter.flush
    flushed: list[int] = []

    def slow(writer: FileWriter) -> None:
        flushed.append(writer.size)
        if len(flushed) == 2:  # the first one is that of the header
            assert free.wait(60)
        flush(writer)

    monkeypatch.setattr(FileWriter, "flush", slow)
    monkeypatch.setattr(record_module, "QUEUE_BYTES", 100_000)
    async with lidario.open_lidar("sim://rplidar-s2?via=memory") as lidar:
        async with lidar.record(tmp_path / "a.mcap") as recording, lidar.scans(depth=64) as stream:
            for _ in range(100):
                if recording.error is not None:
                    break
                await anext(stream)
            else:
                free.set()
            before = lidar.stats.scans
            await anext(stream)
            assert not recording.is_running
            free.set()
        assert lidar.stats.scans > before
        assert "too slow" in str(recording.error)
        assert recording.lost_bytes > 0
    assert "too slow" in caplog.text
    with (tmp_path / "a.mcap").open("rb") as file:
        assert sum(1 for _ in make_reader(file).iter_messages()) > 100


FULL = """
import resource, signal, sys
import lidario
from tests.support.loop import run_driven
signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
resource.setrlimit(resource.RLIMIT_FSIZE, (150_000, 150_000))

async def main():
    async with lidario.open_lidar("sim://rplidar-s2?via=memory") as lidar:
        before = lidar.stats.bytes_received
        async with lidar.record(sys.argv[1]) as recording, lidar.scans(depth=64) as stream:
            while recording.error is None:
                await anext(stream)
            for _ in range(3):
                await anext(stream)
            # The loop does not wait for the thread, and goes on receiving until that has ended.
            received = lidar.stats.bytes_received - before
            await recording.close()
            print(recording.error, recording.size, received, recording.lost_bytes)

run_driven(main)
"""


@pytest.mark.long
def test_a_full_disk_ends_the_recording_in_order(tmp_path: Path) -> None:
    """The system refuses to let the file grow, half-way through a chunk."""
    path = tmp_path / "a.mcap"
    done = ended(FULL, str(path))
    assert done.returncode == 0, done.stderr
    assert "cannot be written: file too large" in done.stdout
    size, received, lost = map(int, done.stdout.split()[-3:])
    # Not a byte of the chunk that did not fit is left.
    assert path.stat().st_size == size
    kept = sum(len(piece.data) for piece in open_stored(path).pieces())
    # But for requests, responses and events, which are a few hundred.
    assert lost == pytest.approx(received - kept, abs=1000)


@pytest.mark.parametrize(
    ("name", "why"),
    [("there.mcap", "exists already"), ("no/folder.mcap", "no such file"), (".", "it is a directory")],
)
@driven
async def test_a_file_that_cannot_be_made_is_said_at_once(tmp_path: Path, name: str, why: str) -> None:
    (tmp_path / "there.mcap").write_bytes(b"precious")
    async with lidario.open_lidar("sim://rplidar-s2?via=memory") as lidar:
        with pytest.raises(lidario.CannotRecord, match=why):
            async with lidar.record(tmp_path / name):
                pass
        assert (await lidar.get_health()).ok
    assert (tmp_path / "there.mcap").read_bytes() == b"precious"


@driven
async def test_without_the_package_it_says_what_to_install(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "mcap.writer", None)
    async with lidario.open_lidar("sim://rplidar-s2?via=memory") as lidar:
        with pytest.raises(lidario.CannotRecord, match=r"pip install mcap"):
            async with lidar.record(tmp_path / "a.mcap"):
                pass


@driven
async def test_closing_the_session_completes_the_file(tmp_path: Path) -> None:
    async with lidario.open_lidar("sim://rplidar-s2?via=memory") as lidar:
        recording = lidar.record(tmp_path / "a.mcap")
        await recording.start()
        await lidar.scan()
    assert not recording.is_running
    with pytest.raises(lidario.LocalProtocolError, match="once"):
        await recording.start()
    with (tmp_path / "a.mcap").open("rb") as file:
        messages = [message.data for _, _, message in make_reader(file).iter_messages(topics=[RAW_TOPIC])]
    sent = [message for message in messages if message[4] == 1]
    assert sent[-1].endswith(b"\xa5\x25")  # the STOP request


@pytest.mark.long
@driven
async def test_who_is_cancelled_while_the_disk_writes_has_a_whole_file_when_the_session_is_closed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The clock of this test jumps past the limit while the thread of the recording writes the last bytes."""
    cancelled, close = threading.Event(), FileWriter.close

    def slow(writer: FileWriter) -> None:
        assert cancelled.wait(60)
        time.sleep(0.1)
        close(writer)

    monkeypatch.setattr(FileWriter, "close", slow)
    async with lidario.open_lidar("sim://rplidar-s2?via=memory") as lidar:
        recording = lidar.record(tmp_path / "a.mcap")
        await recording.start()  # without a limit: the clock would jump past it while the file is made
        await lidar.scan()
        with pytest.raises(TimeoutError):
            async with asyncio.timeout(5.0):
                await recording.close()
        cancelled.set()
    assert lidario.summarize(tmp_path / "a.mcap").damage == ""


def test_a_recording_of_another_family_than_the_one_that_is_named(tmp_path: Path) -> None:
    path = record(tmp_path / "a.mcap", "sim://ydlidar-4ros", 2).path

    async def main() -> None:
        with pytest.raises(lidario.InvalidValue, match=r"'rplidar'.*'ydlidar'"):
            await lidario.open_lidar(path, family="rplidar")
        with refused("source", "family 'ydlidar'"):
            await lidario.open_lidar(f"{path}?family=rplidar")
        async with lidario.open_lidar(path, family="ydlidar") as lidar:
            assert lidar.info.family == "ydlidar"

    run_driven(main)
