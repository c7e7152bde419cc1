"""A recording in parts: each file is whole by itself, together they are what one file would be."""

import re
import shutil
import time
from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import replace
from heapq import merge
from itertools import chain, cycle, pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap.writer import CompressionType, Writer
from rosbags.rosbag2 import Reader

import lidario
from lidario.errors import InvalidValue, RecordingError
from lidario.recording.decode_file import FileDecoder
from lidario.recording.ros_messages import parse_raw
from lidario.recording.write import RAW_TOPIC
from lidario.scans.scan import Scan
from lidario.session.lidar import Lidar
from tests.support.loop import driven
from tests.support.recorded import Live, assert_same_scans, replayed
from tests.support.recorded import record as record_any

MODELS = ["rplidar-s2", "rplidar-a1", "ydlidar-4ros", "ldrobot-ld06"]
FAULTS = ["?fault=drop:0.1%25", "?fault=replug:4s", ""]
SCANS = 60
NAME = re.compile(r"run-\d{8}T\d{6}Z\.mcap")


def record(folder: Path, source: str, count: int = SCANS, **options: Any) -> Live:
    """Record in parts, of a second each unless the options say otherwise."""
    made = record_any(folder / "run.mcap", source, count, **{"split_s": 1.0, **options})
    if "keep_bytes" not in options:
        assert made.files == len(made.parts)
        assert made.size == sum(path.stat().st_size for path in made.parts)
    return made


@pytest.fixture(scope="module")
def six_files(tmp_path_factory: pytest.TempPathFactory) -> Live:
    """A second each."""
    return record(tmp_path_factory.mktemp("parts"), "sim://rplidar-s2")


@pytest.fixture
def copied(six_files: Live, tmp_path: Path) -> Live:
    """The same in the folder of a test, which may change it."""
    for path in six_files.parts:
        shutil.copy(path, tmp_path)
    return replace(six_files, path=tmp_path / "run.mcap", source=str(tmp_path / "run-*.mcap"))


def received_in(path: Path) -> bytes:
    """The received bytes of a file, as the package ``mcap`` reads it, with all check sums."""
    parts = []
    with open(path, "rb") as file:
        for _, _, message in make_reader(file, validate_crcs=True).iter_messages(topics=[RAW_TOPIC]):
            raw = parse_raw(memoryview(message.data))
            assert raw is not None
            if not raw[0]:
                parts.append(bytes(raw[1]))
    return b"".join(parts)


@pytest.mark.long
@pytest.mark.exhaustive(
    "source",
    sample=[model + fault for model, fault in zip(MODELS, cycle(FAULTS), strict=False)],
    full=[model + fault for model in MODELS for fault in FAULTS],
)
def test_together_they_are_what_one_file_would_be(tmp_path: Path, source: str) -> None:
    made = record(tmp_path, f"sim://{source}")
    assert len(made.parts) > 3
    assert all(NAME.fullmatch(path.name) for path in made.parts)
    decoder = FileDecoder(made.source)
    assert_same_scans(made.scans, list(decoder))
    assert decoder.recording.damage == ""
    assert_same_scans(made.scans, replayed(made.source))
    # No byte is missing or doubled.
    assert b"".join(map(received_in, made.parts)) in made.received


@pytest.mark.long
@pytest.mark.parametrize("model", MODELS)
def test_each_file_is_whole_by_itself(tmp_path: Path, model: str) -> None:
    made = record(tmp_path, f"sim://{model}", scans=True)
    alone, live = list[Scan](), {scan.device_distances.tobytes(): scan for scan in made.scans}
    for path in made.parts:
        with Reader(path) as reader:
            assert reader.message_count == sum(1 for _ in reader.messages()) > 1
        assert lidario.summarize(path).damage == ""
        alone += lidario.decode_file(path)
    # The revolutions at the edges have a part in each of two files. The last one was not complete for its reader.
    assert len(made.scans) >= len(alone) - 1 >= len(made.scans) - 2 * (len(made.parts) - 1)
    for scan in alone[:-1]:
        same = live[scan.device_distances.tobytes()]
        assert np.array_equal(scan.device_angles, same.device_angles)
        # Where the time of a sample is measured, less was measured.
        assert scan.stamp_ns == pytest.approx(same.stamp_ns, abs=3e6)


@pytest.mark.long
@pytest.mark.usefixtures("calibrated")
def test_a_zero_offset_that_is_set_at_a_seam(tmp_path: Path) -> None:
    async def turn(lidar: Lidar, live: Live) -> None:
        async with lidar.scans(depth=64) as stream:
            for number in range(SCANS):
                live.scans.append(await anext(stream))
                if number % 7 == 3:
                    await lidar.set_zero_offset(number % 2 == 0)

    made = record(tmp_path, "sim://ydlidar-4ros", act=turn)
    assert len({scan.seam for scan in made.scans}) == 2
    assert_same_scans(made.scans, list(FileDecoder(made.source)))
    seams = {scan.stamp_ns: scan.seam for scan in made.scans}
    alone = [scan for path in made.parts for scan in FileDecoder(path) if scan.stamp_ns in seams]
    assert len(alone) > len(made.scans) / 2
    assert all(scan.seam == seams[scan.stamp_ns] for scan in alone)


@pytest.mark.long
def test_by_size(tmp_path: Path) -> None:
    made = record(tmp_path, "sim://rplidar-s2", split_s=None, split_bytes=200_000)
    sizes = [path.stat().st_size for path in made.parts]
    assert len(sizes) > 1
    # A second has some 100 kB.
    assert all(200_000 <= size < 400_000 for size in sizes[:-1])
    assert_same_scans(made.scans, list(FileDecoder(made.source)))


@pytest.mark.long
def test_the_oldest_go_and_nothing_else(tmp_path: Path) -> None:
    older, strange = tmp_path / "run-20200101T000000Z.mcap", tmp_path / "run-20200101T000000Z.mcap.bak"
    other = tmp_path / "running-20200101T000000Z.mcap"
    for path in (older, strange, other):
        path.write_bytes(bytes(1000))
    made = record(tmp_path, "sim://rplidar-s2", keep_bytes=350_000)
    assert not older.exists()
    assert strange.exists()
    assert other.exists()
    assert sum(path.stat().st_size for path in made.parts) <= 350_000
    scans = list(FileDecoder(made.source))
    assert 5 < len(scans) < len(made.scans)
    assert_same_rest(made.scans, scans)


def assert_same_rest(live: list[Scan], scans: list[Scan]) -> None:
    """The scans are the last ones of the session; numbers begin with the first of them."""
    by_stamp = {scan.stamp_ns: scan for scan in live}
    for scan in scans[:-1]:
        assert np.array_equal(scan.device_distances, by_stamp[scan.stamp_ns].device_distances)


@pytest.mark.long
def test_a_file_in_the_middle_is_missing(copied: Live) -> None:
    gone, behind = copied.parts[2:4]
    missing = len(list(FileDecoder(gone)))
    gone.unlink()
    decoder = FileDecoder(copied.source)
    scans = list(decoder)
    assert decoder.recording.damage == f"{behind.name}: bytes are missing"
    assert_same_rest(copied.scans, scans)
    # The revolutions at both edges are missing, too.
    assert missing > 5
    assert len(copied.scans) - missing - 4 <= len(scans) <= len(copied.scans) - missing


@pytest.mark.long
@pytest.mark.parametrize("number", [0, 2, -1])
@pytest.mark.parametrize(("size", "why"), [(0, "it does not begin as an MCAP file"), (100, "the file was cut")])
def test_a_file_of_which_nothing_is_left(copied: Live, number: int, size: int, why: str) -> None:
    """As a full disk or a power cut leaves it."""
    path = copied.parts[number]
    path.write_bytes(path.read_bytes()[:size])
    decoder = FileDecoder(copied.source)
    scans = list(decoder)
    assert f"{path.name}: {why}" in decoder.recording.damage.split("; ")
    path.unlink()
    assert_same_scans(list(FileDecoder(copied.source)), scans)


@pytest.mark.exhaustive("number", sample=[0], full=[0, 2, -1])
@pytest.mark.parametrize("name", [b"model", b"serial"])
def test_a_file_that_names_another_lidar_by_a_flipped_bit(copied: Live, number: int, name: bytes) -> None:
    path = copied.parts[number]
    before, behind = path.read_bytes().split(name, 1)
    # Behind the length of the text, which has four bytes.
    path.write_bytes(before + name + behind[:4] + bytes([behind[4] ^ 2]) + behind[5:])
    decoder = FileDecoder(copied.source)
    assert_same_scans(copied.scans, list(decoder))
    assert decoder.recording.damage == f"{path.name}: bytes outside of its chunks were changed"


def test_a_file_that_is_there_twice_is_read_once(copied: Live) -> None:
    shutil.copy(copied.parts[1], copied.parts[1].with_name("run-a-copy.mcap"))
    decoder = FileDecoder(copied.source)
    assert_same_scans(copied.scans, list(decoder))
    assert "holds what another file holds" in decoder.recording.damage


@pytest.mark.long
def test_recordings_of_one_lidar_follow_each_other(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Each in its own program: their clocks have nothing in common but the time of day."""
    scans = list[Scan]()
    for name, day_s in (("b", 1_900_000_000), ("a", 1_900_000_060)):
        ahead_ns = day_s * 10**9 - time.monotonic_ns()
        monkeypatch.setattr("time.time_ns", lambda ahead_ns=ahead_ns: time.monotonic_ns() + ahead_ns)
        (tmp_path / name).mkdir()
        scans += record(tmp_path / name, "sim://rplidar-s2", 15).scans
    found = list(FileDecoder(str(tmp_path / "*" / "run-*.mcap")))
    assert [
        scan.wall_stamp_ns for scan in found if scan.wall_stamp_ns in {each.wall_stamp_ns for each in scans}
    ] == [scan.wall_stamp_ns for scan in scans]
    assert len(found) - len(scans) <= 2
    assert all(a.stamp_ns < b.stamp_ns for a, b in pairwise(found))


@pytest.mark.long
@pytest.mark.parametrize(
    ("models", "why"),
    [(("rplidar-s2", "rplidar-s2"), "of the same time"), (("rplidar-s2", "ldrobot-ld06"), "several lidars")],
)
def test_recordings_of_the_same_time_or_of_two_lidars_are_not_one(
    tmp_path: Path, models: tuple[str, ...], why: str
) -> None:
    for number, model in enumerate(models):
        (tmp_path / str(number)).mkdir()
        record(tmp_path / str(number), f"sim://{model}", 15)
    with pytest.raises(RecordingError, match=why):
        lidario.summarize(tmp_path / "*" / "run-*.mcap")


@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        ({"split_s": 0.5}, "split_s is 1 to 1000000000 seconds"),
        ({"split_s": float("nan")}, "split_s"),
        ({"split_bytes": 1000}, "split_bytes is 100000 bytes or more"),
        ({"keep_bytes": 10**9}, "split_s or split_bytes"),
        ({"keep_bytes": 10**6, "split_bytes": 10**6}, "keep_bytes is 2000000 bytes or more"),
    ],
)
@driven
async def test_figures_that_cannot_be(tmp_path: Path, arguments: dict[str, float], text: str) -> None:
    async with lidario.open_lidar("sim://rplidar-s2?via=memory") as lidar:
        with pytest.raises(InvalidValue, match=text):
            lidar.record(tmp_path / "run.mcap", **arguments)  # type: ignore[arg-type]


@pytest.mark.long
def test_a_name_with_brackets_is_no_pattern(tmp_path: Path) -> None:
    """Some patterns have them for one of several letters."""
    folder = tmp_path / "site[3]"
    folder.mkdir()
    made = record_any(folder / "[run].mcap", "sim://rplidar-s2", 15, split_s=1.0)
    assert len(list(folder.iterdir())) == made.files > 1
    assert_same_scans(made.scans, list(FileDecoder(made.source)))
    assert_same_scans(made.scans, replayed(made.source))


@pytest.mark.parametrize(
    ("names", "why"),
    # As where the disk was full: a file has its name and nothing else.
    [
        (("run-1.mcap", "run-2.mcap"), "2 files, and none begins as MCAP does: they are empty"),
        ((), "fits this pattern"),
    ],
)
def test_a_pattern_of_files_of_which_none_is_mcap(tmp_path: Path, names: tuple[str, ...], why: str) -> None:
    for name in names:
        (tmp_path / name).touch()
    with pytest.raises(RecordingError, match=why):
        lidario.summarize(tmp_path / "run-*.mcap")


def merged(paths: Sequence[Path], into: Path, *, once: bool = False) -> Path:
    """The messages of files in the order of their times, as other programs merge files: with all metadata.

    Or with what is alike `once`: topics and metadata.
    """
    with ExitStack() as files:
        readers = [make_reader(files.enter_context(open(path, "rb"))) for path in paths]
        writer = Writer(files.enter_context(open(into, "wb")), compression=CompressionType.NONE)
        writer.start("ros2")
        for metadata in chain.from_iterable(reader.iter_metadata() for reader in readers[: 1 if once else None]):
            writer.add_metadata(metadata.name, metadata.metadata)
        channels: dict[tuple[int, int], int] = {}
        numbered = (
            [(0 if once else n, *each) for each in reader.iter_messages()] for n, reader in enumerate(readers)
        )
        for number, schema, channel, message in merge(*numbered, key=lambda each: each[3].log_time):
            if (number, channel.id) not in channels:
                assert schema is not None
                kind = writer.register_schema(schema.name, schema.encoding, schema.data)
                made = writer.register_channel(channel.topic, channel.message_encoding, kind)
                channels[number, channel.id] = made
            writer.add_message(channels[number, channel.id], message.log_time, message.data, message.publish_time)
        writer.finish()  # type: ignore[no-untyped-call]
    return into


@pytest.mark.long
@pytest.mark.parametrize("models", [("rplidar-s2", "ydlidar-4ros"), ("rplidar-s2", "rplidar-s2")], ids="+".join)
def test_a_file_that_was_merged_of_several_recordings_says_so(tmp_path: Path, models: tuple[str, ...]) -> None:
    """The bytes of the second one were lost, or mixed with those of the first, without a word."""
    files = [
        record_any(tmp_path / f"{n}.mcap", f"sim://{model}?seed={n}", 5).path for n, model in enumerate(models)
    ]
    with pytest.raises(RecordingError, match=r"both.mcap was merged of several recordings"):
        lidario.summarize(merged(files, tmp_path / "both.mcap"))


@pytest.mark.long
@pytest.mark.parametrize("once", [False, True])
def test_a_recording_that_was_merged_with_its_copy_says_so(copied: Live, once: bool, tmp_path: Path) -> None:
    """Nearly all of it was told as damage."""
    whole = merged(copied.parts, tmp_path / "whole.mcap")
    for path in (whole, copied.parts[0]):
        with pytest.raises(RecordingError, match="was merged with a copy of itself"):
            lidario.summarize(merged([path, path], tmp_path / "twice.mcap", once=once))


@pytest.mark.long
def test_a_file_that_was_merged_of_the_parts_of_one_recording_is_read(copied: Live, tmp_path: Path) -> None:
    assert_same_scans(copied.scans, list(FileDecoder(merged(copied.parts, tmp_path / "whole.mcap"))))
