"""A recording is played from a place within it: the scans behind that place, and no others."""

from __future__ import annotations

from pathlib import Path

import pytest

import lidario
from lidario.scan import Scan
from tests.support.loop import run_driven
from tests.support.recorded import Live, record, same_scan, take_scans


def replayed(path: Path, options: str, count: int | None = None) -> tuple[list[Scan], float | None]:
    """The scans, all of them or so many, and how long the recording is said to last."""

    async def main() -> tuple[list[Scan], float | None]:
        async with lidario.open_lidar(f"{path}?{options}") as lidar, lidar.scans() as stream:
            scans = list[Scan]()
            async for scan in stream:
                scans.append(scan)
                if len(scans) == count:
                    break
            return scans, lidar.length_s

    return run_driven(main)


@pytest.fixture(scope="module")
def live(tmp_path_factory: pytest.TempPathFactory) -> Live:
    return record(tmp_path_factory.mktemp("from") / "a.mcap", "sim://rplidar-s2", 20)


@pytest.mark.long
@pytest.mark.parametrize("source", ["sim://rplidar-s2", "sim://ydlidar-4ros", "sim://ldrobot-ld06"])
def test_the_scans_behind_that_place_are_those_of_the_whole(tmp_path: Path, source: str) -> None:
    live = record(tmp_path / "a.mcap", source, 16)
    everything, length_s = replayed(live.path, "rate=0")
    assert length_s is not None
    lasted_s = (everything[-1].stamp_ns + everything[-1].duration_ns - everything[0].stamp_ns) * 1e-9
    assert lasted_s <= length_s < lasted_s + 1
    begin_s = length_s / 2
    scans, _ = replayed(live.path, f"rate=0&from={begin_s:.3f}")
    # Samples, and the time at which they were measured. The revolution that the place lies in was cut.
    whole = {scan.stamp_ns // 1_000_000: scan for scan in everything}
    assert len(everything) // 2 - 2 <= len(scans) <= len(everything) // 2 + 2
    for scan in scans[1:]:
        there = next(
            whole[key]
            for key in range(scan.stamp_ns // 1_000_000 - 3, scan.stamp_ns // 1_000_000 + 4)
            if key in whole
        )
        assert scan.device_angles.tolist() == there.device_angles.tolist()
        assert scan.device_distances.tolist() == there.device_distances.tolist()
    assert scans[0].stamp_ns >= everything[0].stamp_ns + round(begin_s * 1e9) - 200_000_000
    assert not any(scan.lost_packets for scan in scans)


@pytest.mark.long
def test_a_place_in_a_later_stream_is_of_that_stream(tmp_path: Path) -> None:
    async def two_modes(lidar: lidario.Lidar, live: Live) -> None:
        await take_scans(lidar, live, 10, "DenseBoost")
        await take_scans(lidar, live, 10, "Standard")

    live = record(tmp_path / "a.mcap", "sim://rplidar-s2", act=two_modes)
    _, length_s = replayed(live.path, "rate=0")
    assert length_s is not None
    scans, _ = replayed(live.path, f"rate=0&from={length_s - 0.5:.3f}")
    assert {scan.mode for scan in scans} == {"Standard"}


@pytest.mark.long
def test_in_a_loop_only_the_first_time_begins_there(live: Live) -> None:
    everything, _ = replayed(live.path, "rate=0")
    scans, _ = replayed(live.path, "rate=0&loop=1&from=1.5", 20)
    assert len(scans) == 20
    assert any(scan.device_distances.tolist() == everything[0].device_distances.tolist() for scan in scans[1:])


@pytest.mark.long
def test_behind_the_end_and_without_times_it_is_refused(live: Live, tmp_path: Path) -> None:
    with pytest.raises(lidario.RecordingError, match=r"lasts .* s: from=99 is behind its end"):
        replayed(live.path, "from=99")
    (tmp_path / "raw.bin").write_bytes(b"".join(data for way, data, _ in live.chunks if way == "in"))
    with pytest.raises(lidario.RecordingError, match="tells no times"):
        replayed(tmp_path / "raw.bin", "from=1")
    for wrong in ("from=-1", "from=soon"):
        with pytest.raises(lidario.ConnectFailed, match="is not a number from 0 on"):
            replayed(live.path, wrong)


@pytest.mark.long
def test_from_the_beginning_nothing_changes(live: Live) -> None:
    plain, _ = replayed(live.path, "rate=0")
    scans, _ = replayed(live.path, "rate=0&from=0")
    assert len(plain) == len(scans)
    assert all(same_scan(one, other) for one, other in zip(plain, scans, strict=True))
