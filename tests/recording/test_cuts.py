"""Files that were cut, damaged or made to harm: what can be read is read, and nothing else happens."""

import asyncio
import random
import struct
from collections import Counter
from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

import pytest
from mcap.reader import SeekingReader, make_reader
from mcap.writer import Writer

import lidario
from lidario.recording.chronicle import text_of
from lidario.recording.decode_file import FileDecoder
from lidario.recording.export import export_mcap, export_npz
from lidario.recording.files import open_stored
from lidario.recording.mcap_records import MAGIC, Damage, read_records
from lidario.recording.opened import StoredFile
from lidario.recording.read import McapRecording
from lidario.recording.ros_messages import parse_raw
from lidario.recording.write import RAW_TOPIC, FileWriter
from tests.cli.processes import invoke
from tests.support.loop import driven
from tests.support.recorded import Live, assert_same_scans, record, replayed

SOURCES = ("sim://rplidar-s2", "sim://ydlidar-4ros")


@pytest.fixture(scope="module", params=SOURCES)
def live(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Live:
    return record(tmp_path_factory.mktemp("cuts") / "a.mcap", request.param, 15)


def received(path: Path) -> bytes:
    """The bytes of its streams."""
    return b"".join(piece.data for piece in open_stored(path).pieces())


@pytest.mark.long
@pytest.mark.exhaustive("cuts", sample=[25], full=[200])
def test_a_file_cut_anywhere_loses_only_what_was_cut_off(live: Live, tmp_path: Path, cuts: int) -> None:
    """Not even the last second: of the chunk that was cut, every whole message is read."""
    whole, every = live.path.read_bytes(), received(live.path)
    behind: list[tuple[int, int]] = []  # in the file, and in the bytes of the streams
    for piece in open_stored(live.path).pieces():
        at, got = behind[-1] if behind else (0, 0)
        behind.append((whole.index(piece.data, at) + len(piece.data), got + len(piece.data)))
    draw = random.Random(1)
    cut = tmp_path / "cut.mcap"
    for _ in range(cuts):
        size = draw.randrange(len(whole))
        cut.write_bytes(whole[:size])
        complete = max((got for at, got in behind if at <= size), default=0)
        if not complete:
            continue
        found = received(cut)
        assert found[:complete] == every[:complete]
        # Where the end of the stream was cut off, what the device had still to send follows.
        assert len(found) - complete < 3_000


@pytest.mark.long
def test_export_makes_a_whole_file_of_one_that_was_cut(live: Live, tmp_path: Path) -> None:
    """Every reader of MCAP finds it whole."""
    content, draw = live.path.read_bytes(), random.Random(2)
    cut, made = tmp_path / "cut.mcap", tmp_path / "made.mcap"
    for _ in range(3):
        cut.write_bytes(content[: draw.randrange(len(content) // 3, len(content) - 1)])
        assert lidario.summarize(cut).damage
        invoke("export", str(cut), str(made), "--force", code=0)
        assert lidario.summarize(made).damage == ""
        scans, again = list(lidario.decode_file(cut)), list(lidario.decode_file(made))
        assert_same_scans(scans, again)
        assert len(again) == len(scans) > 2
        assert received(cut) == received(made)
        with made.open("rb") as file:
            # It reads by the index at the end alone.
            reader = SeekingReader(file, validate_crcs=True)
            summary = reader.get_summary()
            assert summary is not None
            assert summary.statistics is not None
            assert summary.chunk_indexes
            topics = Counter(channel.topic for _, channel, _ in reader.iter_messages())
        assert topics.total() == summary.statistics.message_count
        assert topics["/scan"] == len(scans)
        assert topics.keys() <= {channel.topic for channel in summary.channels.values()}


@pytest.mark.parametrize("size", [0, 5, 30, 200, 800])
def test_a_file_cut_before_its_first_packet_is_said(live: Live, tmp_path: Path, size: int) -> None:
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(live.path.read_bytes()[:size])
    with pytest.raises(lidario.RecordingError):
        open_stored(cut)


@pytest.mark.parametrize("there", [0, 8, 22, 39])
@pytest.mark.parametrize("opcode", [0x04, 0x05, 0x0C])
def test_of_a_record_that_was_cut_nothing_is_taken(tmp_path: Path, opcode: int, there: int) -> None:
    """A channel, a message or metadata of 40 bytes, that does not stand in a chunk."""
    path = tmp_path / "cut.mcap"
    path.write_bytes(MAGIC + struct.pack("<BQ", opcode, 40) + bytes(there))
    with StoredFile(path) as file:
        assert list(read_records(file)) == [Damage("the file was cut")]
    path.write_bytes(MAGIC + struct.pack("<BQ", opcode, 40) + bytes(40))
    with StoredFile(path) as file:
        record, cut = read_records(file)
    assert not isinstance(record, Damage)
    assert cut == Damage("the file was cut")


@pytest.mark.parametrize("content", [b"", b"x", MAGIC, bytes(5000), b"\x80\x04cos\nsystem\n(S'true'\ntR."])
def test_what_is_no_recording_is_said(tmp_path: Path, content: bytes) -> None:
    for name in ("a.mcap", "a.bin"):
        (tmp_path / name).write_bytes(content)
        with pytest.raises(lidario.RecordingError):
            open_stored(tmp_path / name)
    with pytest.raises(lidario.RecordingError, match="cannot be read: no such file"):
        open_stored(tmp_path / "nothing.mcap")
    with pytest.raises(lidario.RecordingError, match="directory"):
        open_stored(tmp_path)


def test_a_compressed_file_says_what_makes_it_readable(live: Live, tmp_path: Path) -> None:
    packed = tmp_path / "packed.mcap"
    with open(live.path, "rb") as source, open(packed, "wb") as target:
        reader, writer = make_reader(source), Writer(target)
        writer.start()
        for metadata in reader.iter_metadata():
            writer.add_metadata(metadata.name, metadata.metadata)
        for schema, channel, message in reader.iter_messages():
            assert schema is not None
            number = writer.register_schema(schema.name, schema.encoding, schema.data)
            topic = writer.register_channel(channel.topic, channel.message_encoding, number)
            writer.add_message(topic, message.log_time, message.data, message.publish_time)
        writer.finish()  # type: ignore[no-untyped-call]
    with pytest.raises(lidario.RecordingError, match="mcap decompress"):
        open_stored(packed)


EXTREME = {
    "as it is": {},
    "no time of a sample": {"sample_ns": 0.0},
    "the shortest sample": {"sample_ns": 5e-324},
    "the longest sample": {"sample_ns": 1e300},
    "no revolution": {"slowest_turn_s": 0.0},
    "an endless revolution": {"slowest_turn_s": 1e300},
    "a slow line": {"baudrate": 1},
    "far future": {"wall_offset_ns": 2**80},
    "far past": {"wall_offset_ns": -(2**80)},
    "turned": {"zero_offset_deg": 1e300},
}
CLOCKS: dict[str, Callable[[int], int]] = {
    "true": lambda at_ns: at_ns,
    "still": lambda at_ns: 5,
    "backwards": lambda at_ns: 2**63 - at_ns,
    "the end of time": lambda at_ns: 2**64 - 1,
}


EITHER = [(claim, "true") for claim in EXTREME] + [("as it is", clock) for clock in CLOCKS]


@pytest.fixture(scope="module", params=SOURCES)
def tiny(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Live:
    return record(tmp_path_factory.mktemp("tiny") / "a.mcap", request.param, 3)


@pytest.mark.exhaustive("which", sample=EITHER, full=[(claim, clock) for claim in EXTREME for clock in CLOCKS])
def test_impossible_figures_never_raise_anything_foreign(
    tiny: Live, tmp_path: Path, which: tuple[str, str]
) -> None:
    live, claims, clock = tiny, EXTREME[which[0]], CLOCKS[which[1]]
    forged = tmp_path / "forged.mcap"
    recording = McapRecording(live.path)
    writer = FileWriter(forged, replace(recording.about, events=()))
    writer.add_event(clock(0), text_of(replace(recording.streams[0].began, **claims)))  # type: ignore[arg-type]
    with open(live.path, "rb") as file:
        for _, _, message in make_reader(file).iter_messages(topics=[RAW_TOPIC]):
            raw = parse_raw(message.data)
            assert raw is not None
            writer.add_chunk(clock(message.log_time), *raw)
    writer.close()
    for form, export in (("npz", export_npz), ("mcap", export_mcap)):
        try:
            export(FileDecoder(forged), tmp_path / f"out.{form}")
        except lidario.RecordingError:
            assert claims
    with suppress(lidario.RecordingError):
        assert all(len(scan.to_laserscan().ranges) > 0 for scan in replayed(forged))


@pytest.mark.parametrize("payload", [b"", b"\0", bytes(300), b"\xff" * 20])
@driven
async def test_responses_that_cannot_be_right_are_said(live: Live, tmp_path: Path, payload: bytes) -> None:
    forged = tmp_path / "forged.mcap"
    recording = McapRecording(live.path)
    events = [replace(each, payload=payload) for each in recording.responses.values()]
    writer = FileWriter(forged, replace(recording.about, events=(*events, recording.streams[0].began)))
    writer.add_chunk(1, False, b"x" * (recording.streams[0].began.at + 5))
    writer.close()
    async with lidario.open_lidar(forged) as lidar:
        assert lidar.info.family == live.info.family
        for ask in (lidar.get_health, lidar.get_modes, lidar.get_scan_frequency, lidar.get_sample_rate):
            with suppress(lidario.LidarError):
                await ask()


def test_texts_of_a_file_are_made_printable(tmp_path: Path, live: Live) -> None:
    path = tmp_path / "evil.mcap"
    # A terminal would obey it, if it were printed as it stands.
    path.write_bytes(live.path.read_bytes().replace(live.info.model[:4].encode(), b"\x1b[2J"))
    assert open_stored(path).about.info.model.isprintable()


@driven
async def test_a_recording_without_a_byte_ends_also_in_a_loop(live: Live, tmp_path: Path) -> None:
    stored = open_stored(live.path)
    path = tmp_path / "empty.mcap"
    events = (*stored.about.events, stored.streams[0].began)
    FileWriter(path, replace(stored.about, events=events)).close()
    for options in ("", "?loop=1", "?loop=1&rate=0"):
        async with asyncio.timeout(10), lidario.open_lidar(f"{path}{options}") as lidar:
            async for _ in lidar.scans():
                raise AssertionError("never here")
