"""Raw bytes to scans: what the live way makes of them, whoever's bytes they are, whatever is wrong with them."""

import asyncio
import math
import mmap
import os
import pickle
import random
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import lidario
from benchmarks.streams import KINDS as LIVE
from benchmarks.streams import capture
from benchmarks.truth_cases import CASES as CASES_OF_LINES
from benchmarks.truth_cases import happen
from benchmarks.truth_forms import FORMATS
from benchmarks.truth_score import score
from benchmarks.truth_ways import receive
from lidario.errors import ConnectFailed, InvalidValue, RecordingError
from lidario.families.base import Family, Known, RawStream
from lidario.families.registry import FAMILIES
from lidario.recording.decode_file import FileDecoder
from lidario.recording.export import export_mcap
from lidario.recording.offline import OfflineDecoder
from lidario.wire.envelope import DESCRIPTOR_SIZE
from tests.support.cases import CASES, EVEN, KINDS, Case
from tests.support.children import ended
from tests.support.ledger import PACKETS, assert_link_closes
from tests.support.loop import driven
from tests.support.recorded import record, same_points
from tests.support.streams import assembled

every_kind = pytest.mark.exhaustive("case", sample=KINDS)

INFO = bytes.fromhex("a55a1400000004") + bytes(range(20))
HEALTH = bytes.fromhex("a55a03000000060000 00".replace(" ", ""))


def whole(case: Case) -> bytes:
    return case.told + case.descriptor + case.raw


@every_kind
def test_scans_are_those_of_the_live_way(case: Case) -> None:
    expected = assembled(case, case.raw).scans
    model = "ld08" if "ld08" in case.name else None
    scans = list(lidario.decode(whole(case), model=model, sample_us=case.sample_us))
    assert len(scans) == len(expected) >= 2
    for scan, live in zip(scans, expected, strict=True):
        assert same_points(scan, live)
        assert (scan.seq, scan.lost_packets) == (live.seq, 0)


@pytest.mark.exhaustive("case", sample=EVEN)
def test_stamps_count_samples_from_the_begin_of_the_stream(case: Case) -> None:
    scans = list(lidario.decode(whole(case), sample_us=100.0))
    first = next(at for at, sample in enumerate(case.samples) if sample is case.turns[0][0])
    begins = [first + sum(len(turn) for turn in case.turns[:at]) for at in range(len(case.turns))]
    # The first packet may be one whose length is only known by those behind it: nothing of that is in the time.
    assert [scan.stamp_ns for scan in scans] == [at * 100_000 for at in begins]
    assert [scan.wall_stamp_ns for scan in scans] == [scan.stamp_ns for scan in scans]
    assert {scan.time_increment_ns for scan in scans} == {100_000}


@every_kind
def test_arrays_are_the_scans_back_to_back(case: Case) -> None:
    scans = list(lidario.decode(whole(case)))
    arrays = lidario.decode_arrays(whole(case))
    assert arrays.starts.tolist() == np.cumsum([0, *map(len, scans)]).tolist()
    for scan, (begin, end) in zip(scans, pairwise(arrays.starts.tolist()), strict=True):
        np.testing.assert_array_equal(arrays.device_angles[begin:end], scan.device_angles)
        np.testing.assert_array_equal(arrays.device_distances[begin:end], scan.device_distances)
        if scan.intensities is None:
            assert arrays.intensities is None
        else:
            assert arrays.intensities is not None
            np.testing.assert_array_equal(arrays.intensities[begin:end], scan.intensities)
    assert arrays.stamps_ns.tolist() == [scan.stamp_ns for scan in scans]
    assert arrays.lost_packets.tolist() == [0] * len(scans)
    kinds = {arrays.device_angles.dtype, arrays.device_distances.dtype}
    assert kinds == {np.dtype(np.float32)}
    assert {arrays.starts.dtype, arrays.stamps_ns.dtype, arrays.lost_packets.dtype} == {np.dtype(np.int64)}


def test_a_stream_is_looked_for_once_and_not_in_families_behind_the_one_it_is_of(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Each family would search all of the bytes for its packets: that took longer than decoding a short file."""
    searched = list[str]()

    def counting(family: Family) -> Family:
        def find_stream(data: memoryview, known: Known) -> RawStream | None:
            searched.append(family.name)
            return family.find_stream(data, known)

        return replace(family, find_stream=find_stream)

    monkeypatch.setattr("lidario.recording.offline.FAMILIES", tuple(map(counting, FAMILIES)))
    case = next(case for case in CASES if case.response_type == 0x85)
    path = tmp_path / "run.bin"
    path.write_bytes(whole(case))
    assert len(list(lidario.decode_file(path))) >= 2
    assert searched == ["rplidar"]


@every_kind
def test_whose_bytes_they_are_is_told_by_what_follows(case: Case) -> None:
    assert OfflineDecoder(whole(case)).family.name == case.truth.family
    assert OfflineDecoder(INFO + HEALTH + whole(case)).stream.format.name == case.make_format().name
    plain = lidario.decode_arrays(whole(case))
    behind = lidario.decode_arrays(INFO + HEALTH + whole(case), family=case.truth.family)
    np.testing.assert_array_equal(behind.device_distances, plain.device_distances)
    assert behind.stamps_ns.tolist() == plain.stamps_ns.tolist()


@every_kind
def test_usual_rates_are_told_by_the_format(case: Case) -> None:
    usual = {0x81: 62.5, 0x82: 125, 0x83: 100, 0x84: 62.5, 0x85: 31.25, 0x86: 31.25}
    four_ros = case.truth.family == "ydlidar" and not case.told
    expected = 50.0 if four_ros else usual.get(case.response_type, case.sample_us)
    # Where packets tell angles and speed, these tell the rate, as exactly as the first packets do.
    exact = case.response_type in usual
    assert OfflineDecoder(whole(case)).stream.mode.sample_us == pytest.approx(expected, rel=0 if exact else 0.01)
    assert OfflineDecoder(whole(case), Known(sample_us=7)).stream.sample_ns == 7000


@pytest.mark.parametrize("made", [bytes, bytearray, memoryview, partial(np.frombuffer, dtype=np.uint8)])
def test_any_bytes_will_do(made: Callable[[bytes], Any]) -> None:
    case = KINDS[4]
    arrays = lidario.decode_arrays(made(whole(case)))
    np.testing.assert_array_equal(arrays.device_distances, lidario.decode_arrays(whole(case)).device_distances)


def test_a_mapped_file_is_read_in_place(tmp_path: Path) -> None:
    path = tmp_path / "raw.bin"
    path.write_bytes(whole(KINDS[0]))
    with path.open("rb") as file, mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as mapped:
        count = len(list(lidario.decode(mapped)))  # type: ignore[arg-type]
    assert count == len(KINDS[0].turns)


@every_kind
def test_damage_is_counted_and_raises_nothing(case: Case) -> None:
    random_bytes = random.Random(3)
    damaged = bytearray(case.raw)
    for _ in range(12):
        damaged[random_bytes.randrange(len(damaged))] ^= 1 << random_bytes.randrange(8)
    del damaged[len(damaged) // 2 : len(damaged) // 2 + 7]
    decoder = OfflineDecoder(case.descriptor + damaged, Known(case.truth.family))
    scans = list(decoder)
    assert len(scans) >= len(case.turns) - 2
    assert decoder.pipeline.link.stats.skipped_bytes > 0
    assert decoder.pipeline.stats.lost_packets > 0
    assert all(earlier.stamp_ns < later.stamp_ns for earlier, later in pairwise(scans))
    link = decoder.pipeline.link
    assert_link_closes(link)
    assert sum(getattr(decoder.pipeline.stats, name) for name in PACKETS) == link.stats.packets
    assert decoder.pipeline.stats.unfinished_packets == 0


@pytest.mark.exhaustive(
    "case",
    # The packets of an LDS-01 are believed by those behind them, until their check value is known.
    sample=[case for case in KINDS if case.make_format().longest > 5 and case.truth.family != "hlds"],
)
def test_noise_in_place_of_each_second_packet_hides_no_stream(case: Case) -> None:
    noise = random.Random(case.name)
    packets = [noise.randbytes(len(each)) if number % 2 else each for number, each in enumerate(case.packets)]
    decoder, clean = OfflineDecoder(case.descriptor + b"".join(packets)), OfflineDecoder(whole(case))
    assert (decoder.family, decoder.title) == (clean.family, clean.title)
    assert sum(map(len, decoder)) > 0.4 * sum(map(len, clean))


def test_damaged_bytes_take_the_time_of_the_samples_they_held() -> None:
    case = KINDS[4]
    intact = [scan.stamp_ns for scan in lidario.decode(whole(case))]
    damaged = bytearray(whole(case))
    damaged[7 + 84 * 100 + 50] ^= 0xFF
    assert [scan.stamp_ns for scan in lidario.decode(damaged)] == intact


@pytest.mark.long
@pytest.mark.parametrize("name", FORMATS)
def test_a_scan_does_not_begin_before_the_one_before_has_ended(name: str) -> None:
    """Also where packets are missing without a trace, which bytes alone do not tell."""
    stream, line = happen(CASES_OF_LINES["40 % of the packets gone"], FORMATS[name])
    found = score(stream, line, receive(stream, line, "file"), timed=False)
    assert found.delivered > 35
    assert found.told > 0.9 * found.missing
    assert found.overlap_ms < 0.001


NO_STREAM = (b"", b"\xa5", b"\x00" * 5000, bytes(range(256)) * 40, INFO + HEALTH)


@pytest.mark.parametrize(
    ("data", "known", "error", "why"),
    [
        *((data, {}, RecordingError, "no measurement stream") for data in NO_STREAM),
        (whole(KINDS[4]), {"family": "ydlidar"}, RecordingError, "ydlidar"),
        (whole(KINDS[4]), {"family": "velodyne"}, ConnectFailed, "no lidar family"),
        *(
            (whole(KINDS[4]), {"sample_us": sample_us}, InvalidValue, "sample_us")
            for sample_us in (0, -1.0, math.nan, math.inf, 1e7, "31")
        ),
        ("raw.bin", {}, InvalidValue, ""),
    ],
)
@pytest.mark.parametrize("decode", [lidario.decode, lidario.decode_arrays])
def test_what_cannot_be_decoded_is_refused_when_asked(
    decode: Callable[..., object], data: Any, known: dict[str, Any], error: type[Exception], why: str
) -> None:
    with pytest.raises(error, match=why or None):
        decode(data, **known)


def test_a_descriptor_with_nothing_behind_it_has_no_scans() -> None:
    arrays = lidario.decode_arrays(KINDS[4].descriptor, family="rplidar")
    assert (len(arrays.device_angles), arrays.starts.tolist(), len(arrays.stamps_ns)) == (0, [0], 0)


def test_what_goes_in_and_comes_out_can_be_pickled() -> None:
    function, arguments = pickle.loads(pickle.dumps((lidario.decode_arrays, (whole(KINDS[5]),))))
    arrays = pickle.loads(pickle.dumps(function(*arguments)))
    np.testing.assert_array_equal(arrays.starts, lidario.decode_arrays(whole(KINDS[5])).starts)


@pytest.mark.long
def test_no_event_loop_is_loaded_for_it() -> None:
    program = "import sys, lidario; lidario.decode; print('asyncio' in sys.modules or 'serial' in sys.modules)"
    done = ended(program)
    assert done.stdout.strip() == "False"


@driven
async def test_a_source_whose_name_is_no_text_is_recorded_and_exported(tmp_path: Path) -> None:
    """The system allows any bytes in the name of a file; Python reads those that are no text as lone surrogates."""
    raw = tmp_path / os.fsdecode(b"\xff.bin")
    raw.write_bytes(whole(KINDS[4]))
    async with lidario.open_lidar(f"{raw}?rate=0") as lidar, lidar.record(tmp_path / "a.mcap") as recording:
        await lidar.scan()
    assert recording.error is None
    assert lidario.summarize(tmp_path / "a.mcap").source.endswith("?.bin?rate=0")
    assert export_mcap(FileDecoder(raw), tmp_path / "b.mcap") == lidario.summarize(raw).scans


@pytest.mark.parametrize("name", ["a.bin", "a.mcap"])
def test_a_file_that_is_gone_before_it_was_decoded(name: str, tmp_path: Path) -> None:
    path = tmp_path / name
    if name.endswith(".bin"):
        path.write_bytes(whole(KINDS[4]))
    else:
        record(path, "sim://rplidar-s2", 2)
    scans = lidario.decode_file(path)
    path.unlink()
    with pytest.raises(RecordingError, match="cannot be read: no such file"):
        next(scans)


@pytest.mark.parametrize("source", ["sim://rplidar-s2", "tcp://192.168.1.7:2000", "zenoh:robots/7/scan"])
def test_a_lidar_is_no_recording(source: str) -> None:
    with pytest.raises(
        RecordingError, match="names a lidar, and a recording is a file: `lidario record` makes one"
    ):
        next(lidario.decode_file(source))


@pytest.mark.parametrize("options", ["", "?loop=1", "?loop=1&rate=0", "?loop=1&rate=50"])
@driven
async def test_a_recording_without_a_full_revolution_ends_also_in_a_loop(options: str, tmp_path: Path) -> None:
    raw = tmp_path / "raw.bin"
    raw.write_bytes(whole(KINDS[4])[:700])
    async with asyncio.timeout(30), lidario.open_lidar(f"{raw}{options}") as lidar:
        for _ in range(2):
            async for _ in lidar.scans():
                raise AssertionError("never here")


def test_packets_that_left_no_trace_say_nothing_of_the_sample_time(caplog: pytest.LogCaptureFixture) -> None:
    """Times of bare bytes are made from the sample time, so they cannot speak against it."""
    raw, size = capture(LIVE["0x85 dense"], 8.0), 84
    packets = [raw[at : at + size] for at in range(DESCRIPTOR_SIZE, len(raw), size)]
    gone = np.random.default_rng(5).random(len(packets)) < 0.2
    kept = b"".join(packet for packet, is_gone in zip(packets, gone.tolist(), strict=True) if not is_gone)
    decoder = OfflineDecoder(raw[:DESCRIPTOR_SIZE] + kept)
    scans = list(decoder)
    assert len(scans) > 50
    assert {scan.time_increment_ns for scan in scans} == {31_250}
    assert not caplog.records
