"""Recordings that mean harm, file by file: what each may cost, and that it is told."""

import asyncio
import os
import random
import sys
import tracemalloc
from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from types import FrameType

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap.records import ChunkIndex

import lidario
from lidario.recording.decode_file import FileDecoder
from lidario.recording.export import export_mcap
from lidario.recording.files import open_stored
from lidario.recording.played import PlayedDevice
from lidario.recording.write import FileWriter
from lidario.session.lidar import Lidar
from tests.fuzz.forged import ATTACKS, forge
from tests.reference.golden import load
from tests.support.children import ended
from tests.support.loop import driven, run_driven
from tests.support.recorded import Live, record, take_scans

MOST_BYTES = 64 << 20
MOST_CALLS = 1_000_000


def bounded(work: Callable[[], object]) -> None:
    """Do it, and fail where it calls too many functions: a measure of time that no busy machine changes."""
    count = 0

    def note(frame: FrameType, event: str, argument: object) -> None:
        nonlocal count
        count += event in ("call", "c_call")
        assert count <= MOST_CALLS, f"more than {MOST_CALLS} calls"

    sys.setprofile(note)
    try:
        work()
    finally:
        sys.setprofile(None)


async def played_for(path: Path) -> float:
    """Seconds for which a reader of a replay at true pace waits until its end."""
    began = asyncio.get_running_loop().time()
    async with lidario.open_lidar(path) as lidar, lidar.scans() as scans:
        async for _ in scans:
            pass
    return asyncio.get_running_loop().time() - began


@pytest.mark.long
@pytest.mark.parametrize("name", ATTACKS)
def test_a_forged_file_costs_little_and_is_told(name: str, tmp_path: Path) -> None:
    path = forge(tmp_path / "forged.mcap", ATTACKS[name]())
    told = ""

    def use() -> None:
        nonlocal told
        try:
            decoder = FileDecoder(path)
            assert sum(1 for _ in decoder) < 10
            told = decoder.recording.damage
        except lidario.RecordingError as error:
            told = str(error)

    tracemalloc.start()
    try:
        bounded(use)
        assert tracemalloc.get_traced_memory()[1] < MOST_BYTES
    finally:
        tracemalloc.stop()
    assert told
    assert len(told) < 1000
    assert told.isprintable()
    with suppress(lidario.RecordingError):
        assert run_driven(lambda: played_for(path)) < 30


@pytest.fixture(scope="module")
def live(tmp_path_factory: pytest.TempPathFactory) -> Live:
    return record(tmp_path_factory.mktemp("attacks") / "a.mcap", "sim://ydlidar-4ros", 30)


def figures(path: Path) -> tuple[object, ...]:
    """Everything that a user of the file sees."""
    decoder = FileDecoder(path)
    scans = list(decoder)
    about = decoder.recording.about
    return (
        about.info, about.source, about.health, decoder.recording.duration_ns,
        [(scan.stamp_ns, scan.wall_stamp_ns, scan.lost_packets, scan.mode, scan.seq) for scan in scans],
        np.concatenate([scan.device_distances for scan in scans]).tobytes(),
        np.concatenate([scan.device_angles for scan in scans]).tobytes(),
        sorted((each.request, each.payload) for each in decoder.recording.responses.values()),
    )  # fmt: skip


@pytest.mark.long
@pytest.mark.exhaustive("tries", sample=[60], full=[600])
def test_no_flipped_bit_passes_without_a_word(live: Live, tmp_path: Path, tries: int) -> None:
    whole, right = live.path.read_bytes(), figures(live.path)
    assert open_stored(live.path).damage == ""
    flipped = tmp_path / "flipped.mcap"
    draw = random.Random(7)
    for number in range(tries):
        data = bytearray(whole)
        # Heads and tails, where lengths, times and opcodes are dense, more often than the rest.
        at = draw.randrange(len(data)) if number % 3 else draw.choice([1, -1]) * draw.randrange(1, 4000)
        data[at] ^= 1 << draw.randrange(8)
        flipped.write_bytes(data)
        try:
            damage = open_stored(flipped).damage
        except (lidario.RecordingError, lidario.ConnectFailed):
            continue
        assert damage or figures(flipped) == right, at


def chunks_of(path: Path) -> list[ChunkIndex]:
    """As the index of the file tells them."""
    with path.open("rb") as file:
        summary = make_reader(file).get_summary()
    assert summary is not None
    return summary.chunk_indexes


def pieces_of(path: Path) -> dict[int, bytes]:
    """The pieces of a recording by the times at which they came."""
    return {piece.at_ns: piece.data for piece in open_stored(path).pieces()}


@pytest.mark.long
@pytest.mark.parametrize("behind", [1.0, 0.5, 0.0])
def test_what_stands_behind_the_end_of_a_file_is_told(live: Live, tmp_path: Path, behind: float) -> None:
    """As of two recordings that `cat` has joined, the second one whole, cut, or only a few bytes."""
    data = live.path.read_bytes()
    path = tmp_path / "joined.mcap"
    path.write_bytes(data + (data[: int(behind * len(data))] or b"\0\0\0"))
    recording = open_stored(path)
    assert recording.damage == "what stands behind its end was left out"
    assert len(list(FileDecoder(path))) == len(list(FileDecoder(live.path)))
    # That of an index which is only cut is another sentence.
    path.write_bytes(data[:-20])
    assert open_stored(path).damage == "its index is cut or damaged"


@pytest.mark.long
@pytest.mark.parametrize("number", range(4))
def test_a_damaged_chunk_takes_only_its_own_bytes_with_it(live: Live, tmp_path: Path, number: int) -> None:
    """Also the one in which the stream began, and the channels were told."""
    data = bytearray(live.path.read_bytes())
    chunk = chunks_of(live.path)[number]
    data[chunk.chunk_start_offset + chunk.chunk_length // 2] ^= 1
    damaged, copy = tmp_path / "damaged.mcap", tmp_path / "copy.mcap"
    damaged.write_bytes(data)
    assert "a chunk is damaged" in open_stored(damaged).damage
    before, after = pieces_of(live.path), pieces_of(damaged)
    offset_ns = open_stored(live.path).about.clock_offset_ns
    begin, end = chunk.message_start_time - offset_ns, chunk.message_end_time - offset_ns
    assert after == {at_ns: data for at_ns, data in before.items() if not begin <= at_ns <= end}
    assert len(after) > 50
    # What is exported of it stands where it stood.
    export_mcap(FileDecoder(damaged), copy)
    assert pieces_of(copy) == after


async def change_the_mode(lidar: Lidar, live: Live) -> None:
    """Three streams, one behind the other, each longer than a chunk."""
    modes = await lidar.get_modes()
    for mode in (modes[0], modes[-1], modes[0]):
        await take_scans(lidar, live, 20, mode.id)


@pytest.mark.long
def test_streams_that_begin_and_end_in_damaged_chunks_are_told_apart(tmp_path: Path) -> None:
    live = record(tmp_path / "a.mcap", "sim://rplidar-s2", act=change_the_mode)
    right = {scan.stamp_ns: scan for scan in lidario.decode_file(live.path)}
    damaged = tmp_path / "damaged.mcap"
    for chunk in chunks_of(live.path):
        data = bytearray(live.path.read_bytes())
        data[chunk.chunk_start_offset + chunk.chunk_length // 2] ^= 1
        damaged.write_bytes(data)
        found = list(lidario.decode_file(damaged))
        assert len(found) >= len(right) - 20
        for scan in found:
            if scan.stamp_ns in right:
                whole = right[scan.stamp_ns]
                assert scan.mode == whole.mode
                # Of a revolution that the damaged chunk cuts the beginning is delivered, unless a turn hides there.
                assert scan.lost_packets or len(scan) == len(whole)
                np.testing.assert_array_equal(scan.device_distances, whole.device_distances[: len(scan)])
        assert sum(scan.stamp_ns in right for scan in found) >= len(found) - 4


def test_a_file_is_cut_while_it_is_decoded(tmp_path: Path) -> None:
    """Mapped, it would kill the program."""
    golden = load("ydlidar_4ros_room10")
    path = tmp_path / "raw.bin"
    path.write_bytes(golden.raw * 200)
    scans = lidario.decode_file(path, family=golden.family)
    next(scans)
    os.truncate(path, 5000)
    with pytest.raises(lidario.RecordingError, match="was cut while it was read"):
        list(scans)
    os.truncate(path, 0)
    with pytest.raises(lidario.RecordingError):
        list(lidario.decode_file(path, family=golden.family))


@pytest.mark.long
def test_a_recording_is_cut_while_it_is_used(tmp_path: Path, live: Live) -> None:
    path = tmp_path / "a.mcap"

    async def replay() -> None:
        async with lidario.open_lidar(f"{path}?rate=0") as lidar, lidar.scans() as scans:
            async for _ in scans:
                os.truncate(path, 40_000)

    path.write_bytes(live.path.read_bytes())
    with pytest.raises(lidario.DeviceLost, match="was cut while it was read"):
        run_driven(replay)
    path.write_bytes(live.path.read_bytes())
    decoder = FileDecoder(path)
    os.truncate(path, 40_000)
    with pytest.raises(lidario.RecordingError, match="was cut"):
        list(decoder)
    path.write_bytes(live.path.read_bytes())
    stored = open_stored(path)
    os.truncate(path, 40_000)
    device = PlayedDevice(stored)
    for now in range(0, 10**10, 10**8):
        device.receive(stored.streams[0].began.request, now)
        device.transmit(now)
        device.wakeup(now)
    assert "was cut" in str(device.error)
    assert device.finished


def test_what_grows_while_it_is_read_has_an_end(tmp_path: Path) -> None:
    golden = load("ydlidar_4ros_room10")
    path = tmp_path / "raw.bin"
    path.write_bytes(golden.raw * 20)
    right = len(list(lidario.decode_file(path, family=golden.family)))
    found = 0
    for _ in lidario.decode_file(path, family=golden.family):
        found += 1
        with path.open("ab") as file:
            file.write(golden.raw)
    assert found <= right


def test_a_recording_that_goes_on_is_read_as_far_as_it_went_when_it_was_opened(tmp_path: Path, live: Live) -> None:
    """Streams that began since then are not known: their bytes would be taken for those of the last one."""
    whole, path = live.path.read_bytes(), tmp_path / "a.mcap"
    path.write_bytes(whole[: len(whole) // 2])
    stored = open_stored(path)
    before = list(stored.pieces())
    path.write_bytes(whole)
    assert list(stored.pieces()) == before
    assert len(list(open_stored(path).pieces())) > len(before)


@pytest.mark.long
def test_a_flood_ends_a_chunk_before_its_second_is_over(tmp_path: Path, live: Live) -> None:
    path = tmp_path / "flood.mcap"
    about = open_stored(live.path).about
    writer = FileWriter(path, replace(about, events=(*about.events, open_stored(live.path).streams[0].began)))
    for number in range(20):
        writer.add_chunk(number, False, bytes(1 << 20))
    writer.close()
    stored = open_stored(path)
    assert stored.damage == ""
    assert sum(len(piece.data) for piece in stored.pieces()) > 19 << 20
    assert all(chunk.chunk_length < 6 << 20 for chunk in chunks_of(path))


PATHS = """
import os, socket, sys
from tests.cli.processes import invoke
folder = sys.argv[1]
os.chdir(folder)
os.mkfifo("a.mcap"), os.mkfifo("a.bin"), os.mkfifo("a.npz"), os.mkfifo("a.svg"), os.mkfifo("port")
os.mkdir("b.mcap"), os.symlink("/dev/null", "c.npz")
for name in ("c.bin", "c.mcap", "c.svg"):
    os.symlink("/dev/zero", name)
with open("d.mcap", "wb") as file:
    file.truncate(1 << 40)
with open("d.bin", "wb") as file:
    file.truncate(1 << 40)
listening = socket.socket(socket.AF_UNIX)
listening.bind("e.mcap")
for path in ("a.mcap", "a.bin", "b.mcap", "c.bin", "c.mcap", "d.mcap", "d.bin", "e.mcap", "port"):
    for verb in (f"info {path}", f"scan {path} -n 1", f"stats {path} -t 1s", f"plot {path} -o p.svg",
                 f"export {path} x.npz", f"play {path}", f"doctor {path}", f"view {path} --port 0",
                 f"record {path} -o y.mcap", f"watch {path}"):
        done = invoke(*verb.split())
        told = (done.stderr or done.stdout).strip()
        assert done.exit_code and isinstance(done.exception, SystemExit), (verb, done.exception)
        assert told and "Traceback" not in told, (verb, told)
memory = "sim://rplidar-s2?via=memory"
for verb in (f"record {memory} -n 1 -o a.mcap", f"record {memory} -n 1 -o a.mcap --force",
             f"plot {memory} -o a.svg",
             f"record {memory} -n 1 -o c.mcap --force", f"plot {memory} -o c.svg",
             f"export {sys.argv[2]} a.npz --force", f"export {sys.argv[2]} c.npz --force",
             f"export {sys.argv[2]} c.mcap --force", f"export {sys.argv[2]} a.mcap"):
    done = invoke(*verb.split())
    assert done.exit_code and isinstance(done.exception, SystemExit), (verb, done.exception, done.output)
print("all refused")
"""


@pytest.mark.long
def test_what_is_no_file_is_refused_by_every_verb(tmp_path: Path, live: Live) -> None:
    """A pipe that nobody writes to, a device without an end, a folder, a socket, a file that is a hole."""
    done = ended(PATHS, str(tmp_path), str(live.path))
    assert done.stdout.endswith("all refused\n"), done.stderr


@driven
async def test_what_is_no_file_is_refused_by_every_function(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "a.mcap")
    for call in (lidario.decode_file, lidario.decode_file_arrays, lidario.summarize):
        with pytest.raises(lidario.RecordingError, match="it is a pipe"):
            call(tmp_path / "a.mcap")
        with pytest.raises(lidario.RecordingError, match="it is a device"):
            call("/dev/zero")
    with pytest.raises(lidario.RecordingError, match="it is a pipe"):
        await lidario.open_lidar(tmp_path / "a.mcap")
    with pytest.raises(lidario.InvalidValue, match="it is a pipe"):
        lidario.read_config(tmp_path / "a.mcap")


def test_settings_may_come_through_a_pipe_of_the_shell() -> None:
    """As `--config <(…)`: its other end writes, and is closed."""
    reading, writing = os.pipe()
    os.write(writing, b"[default]\nframe = 'front'\n")
    os.close(writing)
    assert lidario.read_config(f"/dev/fd/{reading}").default.frame == "front"
    os.close(reading)
