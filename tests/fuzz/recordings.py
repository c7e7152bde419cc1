"""A recording that means harm: any bytes as a file, used in every way that a program can use it.

Bytes that begin as an MCAP file are one; all others are bare bytes of a device.

Promised: whatever cannot be read is a `LidarError` and no `InternalError`, whose text a terminal can show; scans
are what the documentation says; memory grows with the bytes that are there, and with nothing that they claim.
"""

from __future__ import annotations

import asyncio
import logging
import tempfile
import tracemalloc
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from zlib import crc32

import lidario
from lidario.basics.model import DeviceInfo, ScanMode
from lidario.families.registry import family_named
from lidario.recording.about import About
from lidario.recording.chronicle import Responded, StreamBegan, StreamEnded, ZeroOffsetSet, text_of
from lidario.recording.decode_file import FileDecoder
from lidario.recording.export import export_mcap, export_npz
from lidario.recording.mcap_records import MAGIC
from lidario.recording.played import PlayedDevice
from lidario.recording.read import StoredStreams
from lidario.recording.write import FileWriter
from tests.fuzz.checks import check_error, check_scan, check_text
from tests.fuzz.forged import ATTACKS, Part, forge
from tests.support.cases import CASES, Case
from tests.support.loop import run_driven

_MOST_KEPT = 24 << 20
"""What a block of 64 KiB becomes, with the arrays of its scans, and what is imported on the way."""
_KEPT_A_BYTE = 64
_MOST_FORGED = 64 << 20
"""A chunk of 16 MiB, which is the largest that is read, and what is made of it."""
_LONGEST_REPLAY_S = 600.0
_CHUNK, _CHUNK_NS = 512, 22_000_000
_STEPS = 300
_SHARE = {"rplidar": 0.2, "ydlidar": 0.57}
"""Of the golden streams, which have eleven turns and four."""


def open_recording(data: bytes) -> None:
    """Read the bytes as a recording, decode, play and export it."""
    logging.getLogger("lidario").setLevel(logging.CRITICAL + 1)
    # Memory is measured of one in four: it takes three times as long.
    measured = crc32(data) % 4 == 0
    if measured:
        tracemalloc.start()
    try:
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder, "a.mcap" if data.startswith(MAGIC) else "a.bin")
            path.write_bytes(data)
            _use(path)
        if measured:
            peak = tracemalloc.get_traced_memory()[1]
            assert peak < _MOST_KEPT + _KEPT_A_BYTE * len(data), f"{peak} bytes of memory for {len(data)}"
    finally:
        tracemalloc.stop()
        logging.getLogger("lidario").setLevel(logging.NOTSET)


def forged_recording(data: bytes) -> None:
    """One of the files of `tests.fuzz.forged`, with some bytes changed: two for the place, one for the value.

    Promised: it is told what is wrong, memory does not follow what is claimed, and no replay waits for long.
    """
    parts = list(list(ATTACKS.values())[data[0] % len(ATTACKS) if data else 0]())
    size = sum(len(part) for part in parts if isinstance(part, bytes))
    for at in range(1, len(data) - 2, 3):
        place = int.from_bytes(data[at : at + 2], "big") * size >> 16
        parts = _changed(parts, place, data[at + 2])
    logging.getLogger("lidario").setLevel(logging.CRITICAL + 1)
    tracemalloc.start()
    try:
        with tempfile.TemporaryDirectory() as folder:
            path = forge(Path(folder, "forged.mcap"), parts)
            _decode(path)
            assert tracemalloc.get_traced_memory()[1] < _MOST_FORGED
            run_driven(lambda: _replay(path, "", _LONGEST_REPLAY_S))
    finally:
        tracemalloc.stop()
        logging.getLogger("lidario").setLevel(logging.NOTSET)


def _changed(parts: list[Part], place: int, value: int) -> list[Part]:
    """The parts with another byte at this place, which counts no holes."""
    for number, part in enumerate(parts):
        if isinstance(part, bytes):
            if place < len(part):
                return [*parts[:number], part[:place] + bytes((value,)) + part[place + 1 :], *parts[number + 1 :]]
            place -= len(part)
    return parts


def _decode(path: Path) -> None:
    try:
        for scan in FileDecoder(path):
            check_scan(scan)
    except lidario.LidarError as error:
        check_error(error)


def _use(path: Path) -> None:
    try:
        decoder = FileDecoder(path)
        scans = 0
        for scan in decoder:
            check_scan(scan)
            scans += 1
        recording = decoder.recording
    except lidario.LidarError as error:
        check_error(error)
        return
    about = recording.about
    for text in (about.info.model, about.info.serial, about.info.firmware, about.source, about.lidario):
        check_text(text)
    for stream in recording.streams:
        check_text(stream.began.mode.name)
    _play(recording)
    run_driven(lambda: _replay(path))
    for write, name in ((export_npz, "b.npz"), (export_mcap, "b.mcap")):
        out = path.with_name(name)
        try:
            written = write(FileDecoder(path), out)
        except lidario.LidarError as error:
            check_error(error)
        else:
            assert written <= scans, f"{written} of {scans} scans in {name}"
    assert lidario.summarize(path).scans == scans


def _play(recording: StoredStreams) -> None:
    """Another driver asks for everything that the recording knows, and reads for a while."""
    device = PlayedDevice(recording)
    now = 0
    for request in (*recording.responses, *(stream.began.request for stream in recording.streams)):
        device.receive(request, now)
        for _ in range(_STEPS):
            at = device.wakeup(now)
            if at is None:
                break
            now = max(now, at)
            device.transmit(now)
        device.receive(_stop_of(recording), now)


def _stop_of(recording: StoredStreams) -> bytes:
    """The request that stops such a device."""
    return recording.streams[0].family.device().stop().data


async def _replay(path: Path, options: str = "?rate=0", most_s: float = 1e9) -> None:
    try:
        async with asyncio.timeout(most_s), lidario.open_lidar(f"{path}{options}") as lidar:
            for call in (lidar.get_info, lidar.get_health, lidar.get_modes, lidar.get_sample_rate,
                         lidar.get_scan_frequency, lidar.get_zero_offset):  # fmt: skip
                with suppress(lidario.Unsupported):
                    await call()
            for mode in await lidar.get_modes():
                check_text(mode.name)
            async with lidar.scans() as scans:
                async for scan in scans:
                    check_scan(scan)
    except lidario.LidarError as error:
        check_error(error)


def recording_seeds() -> list[bytes]:
    """Bare bytes and MCAP files of every format, with some turns; and files that were cut or are none."""
    small = [case for case in CASES if "9k" in case.name or case.name == "ydlidar_4ros_wrap"]
    bare = [case.descriptor + b"".join(_some(case)) for case in small]
    files = [_mcap(case) for case in small]
    return [*bare, *files, files[0][:900], files[-1][:3000], MAGIC, MAGIC + b"\x06" + b"\xff" * 40]


def _some(case: Case) -> tuple[bytes, ...]:
    """Two turns and a bit."""
    return case.packets[: round(len(case.packets) * _SHARE[case.truth.family])]


def _mcap(case: Case) -> bytes:
    """A recording with two streams: the first one is interrupted for a response."""
    family = case.truth.family
    packets = _some(case)
    data = b"".join(packets)
    half = len(b"".join(packets[: len(packets) // 2]))
    info = DeviceInfo(family, "Model", 24, "1.02", 18, "AB" * 16)
    mode = ScanMode(1, "Mode", case.sample_us, 30.0, case.response_type, typical=True)
    request = case.request(case.make_format()).data
    began = StreamBegan(0, request, mode, len(packets[0]), case.sample_us * 1e3, 1.0, 1_000_000, 10**18, 0.0)
    device = family_named(family).device()
    answered = [Responded(next(script).data, 4, bytes(20)) for script in (device.identify(), device.health())]
    about = About(info, source="sim://x", baudrate=1_000_000, clock_offset_ns=10**18, events=(*answered, began))
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, "seed.mcap")
        writer = FileWriter(path, about)
        at_ns = 10**18
        for at in range(0, len(data), _CHUNK):
            chunk = data[at : at + _CHUNK]
            at_ns += _CHUNK_NS
            writer.add_chunk(at_ns, False, chunk)
            if at <= half < at + _CHUNK:
                writer.add_event(at_ns, text_of(ZeroOffsetSet(half - 100, 10.5, behind=True)))
                writer.add_event(at_ns, text_of(StreamEnded(half)))
                writer.add_event(at_ns, text_of(Responded(request, 6, bytes(3))))
                writer.add_event(at_ns, text_of(replace(began, at=half)))
                writer.flush()
        writer.close()
        return path.read_bytes()
