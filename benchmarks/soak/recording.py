"""A day of a recording in driven time: ``python -m benchmarks.soak.recording --hours 24 --seed 7``.

A lidar is recorded as by ``lidario record --reconnect --split 10min --keep``, while its line loses bytes, its cable
is pulled out, and it restarts. What the session gave is then compared with what the files hold: each scan behind
the first one that is kept must be there, the same, and no other. Ends with 1 where it is not so.
"""

from __future__ import annotations

import argparse
import asyncio
import math
import random
import sys
import tempfile
import time
from contextlib import suppress
from dataclasses import dataclass, field, replace
from hashlib import blake2b
from pathlib import Path
from struct import Struct
from typing import IO, Any

from mcap.reader import make_reader
from rosbags.rosbag2 import Reader

import lidario
from benchmarks.soak.line import BadLine
from benchmarks.usage import resident_mb
from lidario.recording.decode_file import FileDecoder
from tests.support.cable import Cable, cable_to
from tests.support.devices import make_rig
from tests.support.loop import driven_loop, run_driven

FAMILY = "ldrobot"
DAMAGE = "drop:0.001%"
MEAN_S = 600.0
"""Between two troubles."""
STEP_NS = 50_000_000
"""How often the device has something to say: a day of fewer deliveries is shorter."""
_SECOND = 200_000
"""Most bytes of a second: so much is written before the oldest file goes."""
_AS_LIVE_NS = 5_000_000
"""By so much a time may differ: where the time of a sample is measured, it depends on the files that went."""
_MOST_WAITING = 2 << 20
_SEEN = Struct("<qQ")
"""What is kept of a scan of the session: its stamp, and a check value so long that no two of a day are alike."""


@dataclass
class Day:
    """What became of it.

    Attributes:
        scans: Those of the session.
        kept: Those that the files hold.
        missing: Scans of the session behind the first kept byte that the files do not hold.
        other: Scans of the files that the session did not give, or not so; the last one may be one that was not
            complete for its reader.
        away_s: How long the lidar was away, by the files.
        losses: How often, by the files.
        reconnects: How often, by the session, in the whole time.
        largest: Most bytes of all files at once.
        memory_mb: Resident memory after each hour.
        files: How many were begun, and how many are kept.
        damage: What the reader says of the files.
        unreadable: Files that ``mcap`` or ``rosbags`` cannot read.
    """

    scans: int = 0
    kept: int = 0
    missing: int = 0
    other: int = 0
    away_s: float = 0.0
    losses: int = 0
    reconnects: int = 0
    largest: int = 0
    memory_mb: list[float] = field(default_factory=list)
    files: tuple[int, int] = (0, 0)
    damage: str = ""
    unreadable: list[str] = field(default_factory=list)


def live(
    folder: Path,
    seconds: float,
    *,
    seed: int,
    split_s: float,
    keep_bytes: int,
    family: str = FAMILY,
    mean_s: float = MEAN_S,
) -> Day:
    """Record for so many driven seconds, read what is kept, and compare."""
    day = Day()

    async def main() -> None:
        driven_loop().most_turns = math.inf
        rig = make_rig(family)
        line = BadLine(rig.device, STEP_NS)
        line.damage(DAMAGE, seed, 0)
        with cable_to(replace(rig, device=line)) as cable:
            async with lidario.open_lidar(line, reconnect=True) as lidar:
                # No disk is as fast as driven time.
                recording = lidar.record(folder / "day.mcap", sync=False, split_s=split_s, keep_bytes=keep_bytes)
                async with recording, lidar.scans(depth=64) as stream:
                    troubles = asyncio.create_task(_trouble(cable, rig.device, random.Random(seed), mean_s))
                    await _read(stream, recording, seconds, day, seen, folder)
                    troubles.cancel()
                    cable.device = line
                if recording.error is not None or recording.lost_bytes:
                    raise AssertionError(f"{recording.error}, {recording.lost_bytes} bytes lost")
                day.reconnects, day.files = lidar.stats.reconnects, (recording.files, 0)

    # What it gave is kept in a file, so that the memory of the comparison does not grow.
    with open(folder / "seen", "wb") as seen:
        run_driven(main)
    _compare(folder, day)
    return day


async def _trouble(cable: Cable, device: Any, random_: random.Random, mean_s: float) -> None:
    while True:
        await asyncio.sleep(random_.expovariate(1 / mean_s))
        kind = random_.choice(["cable", "cable", "reboot"])
        if kind == "cable":
            cable.pull()
            await asyncio.sleep(random_.uniform(0.1, 0.1 * mean_s))
            cable.plug(boots=False)
        device.reboot(round(asyncio.get_running_loop().time() * 1e9))


async def _read(
    stream: lidario.ScanStream,
    recording: lidario.Recording,
    seconds: float,
    day: Day,
    seen: IO[bytes],
    folder: Path,
) -> None:
    clock = asyncio.get_running_loop().time
    began, hour = clock(), 1
    async for scan in stream:
        day.scans += 1
        seen.write(_SEEN.pack(scan.stamp_ns, sum_of(scan)))
        while recording.is_running and recording._seen - recording._taken > _MOST_WAITING:  # noqa: SLF001
            # Driven time is much faster than any disk.
            time.sleep(0.01)  # noqa: ASYNC251
        passed = clock() - began
        if day.scans % 500 == 0:
            day.largest = max(day.largest, _size_of(folder))
        if passed >= 3600 * hour:
            hour += 1
            day.memory_mb.append(resident_mb())
            print(f"hour {hour - 1}: {day.scans} scans, {day.memory_mb[-1]:.0f} MB", file=sys.stderr)
        if passed >= seconds:
            break


def _size_of(folder: Path) -> int:
    size = 0
    for path in folder.glob("day-*.mcap"):
        with suppress(FileNotFoundError):  # it has just gone
            size += path.stat().st_size
    return size


def _compare(folder: Path, day: Day) -> None:
    paths = sorted(folder.glob("day-*.mcap"))
    day.files = (day.files[0], len(paths))
    for path in paths:
        try:
            with open(path, "rb") as file:
                counted = sum(1 for _ in make_reader(file, validate_crcs=True).iter_messages())
            with Reader(path) as bag:
                if bag.message_count != counted:
                    day.unreadable.append(path.name)
        except Exception as error:
            day.unreadable.append(f"{path.name}: {error!r}")
    decoder = FileDecoder(folder / "day-*.mcap")
    known = {sum_: stamp for stamp, sum_ in _SEEN.iter_unpack((folder / "seen").read_bytes())}
    found, first = 0, 0
    for scan in decoder:
        first = first or scan.stamp_ns
        found += 1
        day.other += abs(known.pop(sum_of(scan), 0) - scan.stamp_ns) > _AS_LIVE_NS
    day.kept = found
    day.missing = sum(stamp > first + _AS_LIVE_NS for stamp in known.values())
    day.damage = decoder.recording.damage
    day.losses, day.away_s = len(decoder.recording.away_ns), sum(decoder.recording.away_ns) * 1e-9


def sum_of(scan: lidario.Scan) -> int:
    """The check value of a scan; no two of a day have the same."""
    found = blake2b(scan.device_angles.tobytes(), digest_size=8)
    found.update(scan.device_distances.tobytes())
    return int.from_bytes(found.digest(), "little")


def main() -> int:
    """Live a day, and print what became of it."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--hours", type=float, default=24.0)
    parser.add_argument("--family", default=FAMILY)
    parser.add_argument("--seed", type=int, default=7)
    parser.add_argument("--keep", type=int, default=400_000_000, help="bytes")
    told = parser.parse_args()
    began = time.monotonic()
    with tempfile.TemporaryDirectory() as folder:
        day = live(
            Path(folder), 3600 * told.hours, seed=told.seed, split_s=600.0, keep_bytes=told.keep, family=told.family
        )
    print(f"{told.hours:g} hours, seed {told.seed}, in {time.monotonic() - began:.0f} s")
    print(f"scans: {day.scans}; in the files: {day.kept}, missing {day.missing}, other {day.other}")
    print(f"away: {day.reconnects} times; by the files that are kept {day.losses} times, {day.away_s:.0f} s")
    print(
        f"files: {day.files[0]} begun, {day.files[1]} kept, {len(day.unreadable)} unreadable {day.unreadable[:3]}"
    )
    print(f"largest: {day.largest / 1e6:.1f} MB of {told.keep / 1e6:.1f} MB; damage: {day.damage or 'none'}")
    print("memory after each hour, MB: " + " ".join(f"{each:.0f}" for each in day.memory_mb))
    return int(
        bool(day.missing or day.other > 1 or day.unreadable or day.damage or day.largest > told.keep + _SECOND)
    )


if __name__ == "__main__":
    sys.exit(main())
