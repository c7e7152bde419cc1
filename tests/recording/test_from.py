"""A recording is played from a place within it: the scans behind that place, and no others."""

from pathlib import Path

import pytest

import lidario
from lidario.recording.port import LOOP_GAP_NS
from tests.support.loop import driven, run_driven
from tests.support.recorded import Live, record, replayed, same_scan, take_scans

pytestmark = pytest.mark.long


def length_of(path: Path) -> float:
    async def main() -> float | None:
        async with lidario.open_lidar(path) as lidar:
            return lidar.length_s

    length_s = run_driven(main)
    assert length_s is not None
    return length_s


@pytest.fixture(scope="module")
def live(tmp_path_factory: pytest.TempPathFactory) -> Live:
    return record(tmp_path_factory.mktemp("from") / "a.mcap", "sim://rplidar-s2", 20)


@pytest.mark.parametrize("source", ["sim://rplidar-s2", "sim://ydlidar-4ros", "sim://ldrobot-ld06"])
def test_the_scans_behind_that_place_are_those_of_the_whole(tmp_path: Path, source: str) -> None:
    live = record(tmp_path / "a.mcap", source, 16)
    everything, length_s = replayed(live.path), length_of(live.path)
    lasted_s = (everything[-1].stamp_ns + everything[-1].duration_ns - everything[0].stamp_ns) * 1e-9
    assert lasted_s <= length_s < lasted_s + 1
    begin_s = length_s / 2
    scans = replayed(live.path, f"rate=0&from={begin_s:.3f}")
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


def test_a_place_in_a_later_stream_is_of_that_stream(tmp_path: Path) -> None:
    async def two_modes(lidar: lidario.Lidar, live: Live) -> None:
        await take_scans(lidar, live, 10, "DenseBoost")
        await take_scans(lidar, live, 10, "Standard")

    live = record(tmp_path / "a.mcap", "sim://rplidar-s2", act=two_modes)
    scans = replayed(live.path, f"rate=0&from={length_of(live.path) - 0.5:.3f}")
    assert {scan.mode for scan in scans} == {"Standard"}


def test_in_a_loop_only_the_first_time_begins_there(live: Live) -> None:
    everything = replayed(live.path)
    scans = replayed(live.path, "rate=0&loop=1&from=1.5", 20)
    assert len(scans) == 20
    assert any(scan.device_distances.tolist() == everything[0].device_distances.tolist() for scan in scans[1:])


def test_behind_the_end_and_without_times_it_is_refused(live: Live, tmp_path: Path) -> None:
    with pytest.raises(lidario.RecordingError, match=r"lasts .* s: from=99 is behind its end"):
        replayed(live.path, "from=99")
    (tmp_path / "raw.bin").write_bytes(b"".join(data for way, data, _ in live.chunks if way == "in"))
    with pytest.raises(lidario.RecordingError, match="tells no times"):
        replayed(tmp_path / "raw.bin", "from=1")
    for wrong in ("from=-1", "from=soon"):
        with pytest.raises(lidario.ConnectFailed, match="is not a number from 0 on"):
            replayed(live.path, wrong)


@pytest.mark.parametrize(("options", "begin_s"), [("rate=0", 0.0), ("rate=0&from=1", 1.0), ("rate=0&loop=1", 0.0)])
@driven
async def test_it_is_told_how_much_was_played(live: Live, options: str, begin_s: float) -> None:
    seen: list[tuple[float, float, int]] = []
    async with lidario.open_lidar(f"{live.path}?{options}") as lidar, lidar.scans() as scans:
        for _ in range(25 if "loop" in options else 8):
            scan = await anext(scans)
            assert lidar.reached_s is not None
            assert lidar.length_s is not None
            seen.append((lidar.reached_s, lidar.length_s, scan.stamp_ns + scan.duration_ns))
    # As it began: within the revolution that is cut, and the next. From there on with the scans.
    assert begin_s < seen[0][0] < begin_s + 0.35
    first, _, stamp_ns = seen[0]
    for reached, length, now_ns in seen:
        since = (now_ns - stamp_ns) * 1e-9
        assert reached == pytest.approx((first + since) % (length + LOOP_GAP_NS * 1e-9), abs=0.05)


@driven
async def test_a_lidar_has_no_length() -> None:
    async with lidario.open_lidar("sim://rplidar-s2?via=memory") as lidar:
        assert (lidar.length_s, lidar.reached_s) == (None, None)


def test_from_the_beginning_nothing_changes(live: Live) -> None:
    plain = replayed(live.path)
    scans = replayed(live.path, "rate=0&from=0")
    assert len(plain) == len(scans)
    assert all(same_scan(one, other) for one, other in zip(plain, scans, strict=True))
