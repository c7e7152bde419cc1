"""Decoding alone: bytes in memory to scans, through `Link`, `Assembler` and the family's decoder.

Bytes arrive at the device's own pace as far as time stamps go, and as fast as they can be taken otherwise, in
chunks of six sizes. A decoded scan holds the device's degrees and millimetres; its radians and metres are made when
they are looked at, so chunks of 4 KiB are timed once more with a look at both. Whole files pass through
`lidario.decode`, which decodes several revolutions as one block. The other drivers get the same bytes
from a port in memory, through their own front door, and take them in pieces of their own choice. `pyrplidarsdk`
opens nothing but a real port: see `benchmarks.flatout`.

The formats of the relatives (`benchmarks.models`) are decoded in chunks of 4 KiB and as whole files. They have 400
to 2600 samples in a revolution, so the cost of a revolution that does not depend on its samples weighs more.
"""

from __future__ import annotations

import tempfile
import time
from pathlib import Path

import lidario
from benchmarks.contest import RIVALS
from benchmarks.models import FORMATS
from benchmarks.peers import package_of
from benchmarks.processes import Failed
from benchmarks.report import Result, Setting, Table, median, ratio, spread
from benchmarks.streams import KINDS, Kind, capture
from lidario.revolution.pipeline import Pipeline
from lidario.wire.link import Link

CHUNKS: tuple[int | None, ...] = (1, 16, 64, 1024, 4096, None)
"""Bytes a chunk; None for all at once."""
BASELINE = 4096
FILE = "file"
VENDOR_MB_PER_S = {
    "0x81 nodes": (120, 142),
    "0x82 express": (166, 180),
    "0x83 HQ": (120, 131),
    "0x84 ultra": (69, 99),
    "0x85 dense": (135, 168),
    "0x86 ultra-dense": (153, 188),
    "4ROS points": (41, 66),
}
"""What the vendors' C++ unpackers took, measured outside of this project and at another time, from slowest to
fastest run. They are constants: no package on PyPI lets the unpackers be called, so no run of this benchmark can
measure them."""
_FILE_S = 30.0
"""Of stream in a file. Not a loop: at its end the angle would leap, which no rotor does."""
CONVERTED = "4096, converted"

_PEERS = {
    "0x81 nodes": ("floor", *RIVALS["S2 Standard"]),
    "0x82 express": ("pyrplidar", "rplidar-roboticia"),
    "0x84 ultra": ("pyrplidar",),
    "0x85 dense": ("pyrplidar",),
    "4ROS points": RIVALS["4ROS"],
}
_TIMEOUT_S = 60.0
_PEER_ROUNDS = 3


def run(setting: Setting) -> Result:
    """Time everything, a round after the other."""
    rounds, seconds = (1, 0.6) if setting.quick else (5, 4.0)
    own: dict[str, dict[str, list[dict[str, float]]]] = {name: {} for name in KINDS}
    theirs: dict[str, dict[str, list[dict[str, float]]]] = {name: {} for name in KINDS}
    more: dict[str, dict[str, list[dict[str, float]]]] = {name: {} for name in FORMATS}
    absent: dict[str, str] = {}
    with tempfile.TemporaryDirectory() as folder:
        for number in range(rounds):
            setting.say(f"decode: round {number + 1} of {rounds}")
            for kind in KINDS.values():
                for chunk in CHUNKS:
                    # Small chunks take long, so they get less of the stream.
                    length = seconds if chunk is None or chunk >= 64 else max(seconds / 8, 0.6)
                    own[kind.name].setdefault(_label(chunk), []).append(_timed(kind, length, chunk))
                length = _FILE_S / 10 if setting.quick else _FILE_S
                own[kind.name].setdefault(FILE, []).append(_file(kind, length))
                own[kind.name].setdefault(CONVERTED, []).append(_timed(kind, seconds, BASELINE, convert=True))
                if setting.peers is not None and number < _PEER_ROUNDS:
                    _peers(setting, kind, Path(folder), seconds / 2, theirs[kind.name], absent)
            for kind in FORMATS.values():
                more[kind.name].setdefault(str(BASELINE), []).append(_timed(kind, 4 * seconds, BASELINE))
                more[kind.name].setdefault(FILE, []).append(_file(kind, length))
    data = {
        "lidario": own,
        "relatives": more,
        "peers": theirs,
        "absent": absent,
        "chunks": [_label(chunk) for chunk in CHUNKS],
    }
    return Result(
        "decode", [_table(own), _file_table(own), _relatives_table(more), *_peer_tables(own, theirs, absent)], data
    )


def _label(chunk: int | None) -> str:
    return "whole" if chunk is None else str(chunk)


def _timed(kind: Kind, seconds: float, chunk: int | None, *, convert: bool = False) -> dict[str, float]:
    """Decode `seconds` of stream, and perhaps look at radians and metres; what came out and how long it took."""
    raw = capture(kind, seconds)
    stream, link = kind.stream(), Link()
    link.send_request(kind.request(stream.format))
    pipeline = Pipeline(stream, link=link)
    step = chunk or len(raw)
    byte_ns = seconds * 1e9 / len(raw)
    scans = samples = 0
    start = time.perf_counter()
    for at in range(0, len(raw), step):
        for scan in pipeline.receive(raw[at : at + step], int((at + step) * byte_ns)):
            scans += 1
            samples += min(len(scan.angles), len(scan.ranges)) if convert else len(scan)
    took = time.perf_counter() - start
    return _figures(took, len(raw), scans, samples)


def _file(kind: Kind, seconds: float) -> dict[str, float]:
    """Decode a file that holds `seconds` of stream, as a user would."""
    raw = capture(kind, seconds)
    scans = samples = 0
    start = time.perf_counter()
    for scan in lidario.decode(raw, family=kind.family):
        scans += 1
        samples += len(scan)
    return _figures(time.perf_counter() - start, len(raw), scans, samples)


def _figures(seconds: float, size: int, scans: float, samples: float) -> dict[str, float]:
    return {
        "seconds": seconds,
        "scans": scans,
        "samples": samples,
        "mb_per_s": size / seconds / 1e6,
        "samples_per_s": samples / seconds,
        "us_per_revolution": seconds / scans * 1e6 if scans else 0.0,
    }


def _peers(
    setting: Setting,
    kind: Kind,
    folder: Path,
    seconds: float,
    into: dict[str, list[dict[str, float]]],
    absent: dict[str, str],
) -> None:
    raw = capture(kind, seconds)
    path = folder / f"{kind.name}.bin"
    path.write_bytes(raw)
    mode = 0 if kind.mode.response_type == 0x81 else 1
    for name in _PEERS.get(kind.name, ()):
        who = f"{package_of(name)}, {kind.name}"
        if who in absent:
            continue
        try:
            got = setting.ask_peer(name, "decode", {"stream": str(path), "mode": mode}, timeout=_TIMEOUT_S)
        except Failed as failed:
            absent[who] = str(failed)
            continue
        into.setdefault(name, []).append(_figures(got["seconds"], len(raw), got["scans"], got["samples"]))


def _table(own: dict[str, dict[str, list[dict[str, float]]]]) -> Table:
    columns = [
        "format, chunk of",
        *(f"{_label(chunk)} B" if chunk else "whole" for chunk in CHUNKS),
        "4096 B, rad, m",
    ]
    table = Table("decode: lidario, by format and size of the chunks", columns)
    for name, by_chunk in own.items():
        for what, digits, scale in (("MB/s", 1, 1.0), ("Msamples/s", 2, 1e-6), ("µs/rev", 0, 1.0)):
            key = {"MB/s": "mb_per_s", "Msamples/s": "samples_per_s", "µs/rev": "us_per_revolution"}[what]
            timings = (*(by_chunk[_label(chunk)] for chunk in CHUNKS), by_chunk[CONVERTED])
            cells = [spread([each[key] * scale for each in rounds], digits) for rounds in timings]
            table.add(f"{name}, {what}", *cells)
    table.notes.append("median (smallest–largest) of the rounds; 3200 samples a revolution, 4ROS 2857")
    table.notes.append("degrees and millimetres, as the device has them; last column: and radians and metres")
    return table


def _file_table(own: dict[str, dict[str, list[dict[str, float]]]]) -> Table:
    columns = ["format", "MB/s", "Msamples/s", "µs/rev", "C++ unpacker, MB/s (not measured here)", "ratio to it"]
    table = Table("decode: whole files, lidario.decode", columns)
    for name, by_chunk in own.items():
        rounds = by_chunk[FILE]
        slowest, fastest = VENDOR_MB_PER_S[name]
        speed = median([each["mb_per_s"] for each in rounds])
        table.add(
            name,
            spread([each["mb_per_s"] for each in rounds], 1),
            spread([each["samples_per_s"] * 1e-6 for each in rounds], 2),
            spread([each["us_per_revolution"] for each in rounds], 0),
            f"{slowest}–{fastest}",
            f"{speed / fastest:.2f}–{speed / slowest:.2f}",
        )
    table.notes.append(
        "the figures of C++ are constants, from such a machine at another time: no package lets its unpackers be "
        "called; so the ratio holds only where this machine is as fast as that one was"
    )
    return table


def _relatives_table(more: dict[str, dict[str, list[dict[str, float]]]]) -> Table:
    columns = ["format", "samples a revolution", f"{BASELINE} B, MB/s", "µs/rev", "whole file, MB/s", "Msamples/s"]
    table = Table("decode: the formats of the relatives", columns)
    for name, by_chunk in more.items():
        live, whole = by_chunk[str(BASELINE)], by_chunk[FILE]
        table.add(
            name,
            f"{median([each['samples'] / each['scans'] for each in whole]):.0f}",
            spread([each["mb_per_s"] for each in live], 1),
            spread([each["us_per_revolution"] for each in live], 0),
            spread([each["mb_per_s"] for each in whole], 1),
            spread([each["samples_per_s"] * 1e-6 for each in whole], 2),
        )
    return table


def _peer_tables(
    own: dict[str, dict[str, list[dict[str, float]]]],
    theirs: dict[str, dict[str, list[dict[str, float]]]],
    absent: dict[str, str],
) -> list[Table]:
    columns = ["format, driver", "Msamples/s", "MB/s", f"speed, lidario at {BASELINE} B = 1", "scans"]
    table = Table("decode: other drivers, from a port in memory", columns)
    for name, by_peer in theirs.items():
        if not by_peer:
            continue
        mine = own[name][str(BASELINE)]
        for contestant, rounds in {f"lidario, {BASELINE} B": mine, **by_peer}.items():
            speeds = [each["mb_per_s"] for each in rounds]
            table.add(
                f"{name}, {contestant}",
                spread([each["samples_per_s"] / 1e6 for each in rounds], 2),
                spread(speeds, 2),
                ratio(speeds, [each["mb_per_s"] for each in mine]),
                f"{median([each['scans'] for each in rounds]):.0f}",
            )
    table.notes += [
        "floor: a bare loop over read(5), which decodes nothing",
        "the other drivers are given half as long a stream; most leave out samples without a return",
        "PyLidar3 delivers 360 means for each 6000 bytes, so its samples are not samples",
        "formats without a line are read by no other driver; pyrplidarsdk opens only a real port",
    ]
    table.note_absent(absent)
    return [table] if absent or any(theirs.values()) else []
