"""Recordings for tests: simulated devices in memory, on a driven clock, recorded to a file."""

from collections.abc import Awaitable, Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from lidario.basics.model import DeviceInfo, Health, ScanMode, Stats
from lidario.scans.scan import Scan
from lidario.session.lidar import Lidar
from lidario.session.opening import open_lidar
from tests.support.loop import run_driven


@contextmanager
def thread_takes_no_time() -> Iterator[None]:
    """Where a fault comes at a given moment: a driven clock stands nearly still while the thread opens its file."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("lidario.recording.record.POLL_S", 1e-6)
        yield


@dataclass
class Live:
    """What a session gave while it was recorded, and what is said of the recording."""

    path: Path
    info: DeviceInfo
    health: Health
    modes: tuple[ScanMode, ...] = ()
    scans: list[Scan] = field(default_factory=list)
    chunks: list[tuple[str, bytes, int]] = field(default_factory=list)
    stats: Stats = field(default_factory=Stats)
    source: str = ""
    files: int = 0
    size: int = 0

    @property
    def received(self) -> bytes:
        """What came, also before the recording began and behind its end."""
        return b"".join(data for direction, data, _ in self.chunks if direction == "in")

    @property
    def parts(self) -> list[Path]:
        """The files that are there, of a recording in parts."""
        return sorted(self.path.parent.glob(f"{self.path.stem}-*.mcap"))


async def take_scans(lidar: Lidar, live: Live, count: int, mode: str | int | None = None) -> None:
    """Read `count` scans, none of which is dropped."""
    async with lidar.scans(mode, depth=64) as stream:
        for _ in range(count):
            live.scans.append(await anext(stream))


def record(
    path: Path,
    source: str,
    count: int = 12,
    *,
    act: Callable[[Lidar, Live], Awaitable[None]] | None = None,
    **options: Any,
) -> Live:
    """Record `count` scans of a simulated device, or what `act` does with it, without a loss.

    It is in memory unless its source says otherwise; path and options are as for `Lidar.record`. No disk is waited
    for: many a test records, and what a power cut leaves is tested for itself.
    """
    if "via=" not in source:
        source += f"{'&' if '?' in source else '?'}via=memory"

    async def main() -> Live:
        async with open_lidar(source, reconnect=True) as lidar:
            live = Live(path, lidar.info, lidar.health)
            lidar.tap(lambda direction, data, now: live.chunks.append((direction, data, now)))
            async with lidar.record(path, overwrite=True, **{"sync": False, **options}) as recording:
                if act is None:
                    await take_scans(lidar, live, count)
                else:
                    await act(lidar, live)
            assert recording.error is None
            assert not recording.lost_bytes
            live.source, live.files, live.size = recording.source, recording.files, recording.size
            live.stats, live.modes = lidar.stats, await lidar.get_modes()
            return live

    with thread_takes_no_time():
        return run_driven(main)


def replayed(path: Path | str, options: str = "rate=0", count: int | None = None) -> list[Scan]:
    """What a session gets that plays the file: all of it, or so many scans."""

    async def main() -> list[Scan]:
        async with open_lidar(f"{path}?{options}") as lidar, lidar.scans() as stream:
            if count is None:
                return [scan async for scan in stream]
            return [await anext(stream) for _ in range(count)]

    return run_driven(main)


def same_scan(one: Scan, other: Scan) -> bool:
    """Whether two scans are equal in everything but what a reader missed before."""
    plain = ("stamp_ns", "wall_stamp_ns", "time_increment_ns", "duration_ns", "seq", "lost_packets", "mode",
             "max_range", "seam")  # fmt: skip
    if any(getattr(one, name) != getattr(other, name) for name in plain):
        return False
    # Where sectors were handed out, the step of the angle is the mean of several pieces.
    return bool(np.isclose(one.rpm, other.rpm, rtol=1e-12, atol=0.0, equal_nan=True)) and same_points(one, other)


def same_points(one: Scan, other: Scan) -> bool:
    """Whether two scans have the same points."""
    pairs = ((one.device_angles, other.device_angles), (one.device_distances, other.device_distances))
    if any(not np.array_equal(a, b, equal_nan=True) for a, b in pairs):
        return False
    if one.intensities is None or other.intensities is None:
        return one.intensities is other.intensities
    return bool(np.array_equal(one.intensities, other.intensities))


def assert_same_scans(live: list[Scan], replayed: list[Scan]) -> None:
    """Point for point and stamp for stamp; one more may come, which was not complete when its reader left."""
    assert len(live) <= len(replayed)
    for number, (one, other) in enumerate(zip(live, replayed, strict=False)):
        assert same_scan(one, other), f"scan {number}: {one} {one.stamp_ns} is not {other} {other.stamp_ns}"
