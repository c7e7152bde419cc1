"""A replay gives what the live session gave, in the same session, with the same stamps."""

import asyncio
import time
from pathlib import Path

import pytest

import lidario
from lidario.basics.model import ScanMode
from lidario.families.registry import family_named
from lidario.recording import files
from lidario.recording.played import PlayedDevice
from lidario.scans.scan import Scan
from lidario.session.lidar import Lidar
from lidario.wire.envelope import encode_descriptor
from lidario.wire.events import Descriptor
from tests.reference.golden import NAMES, load
from tests.support.cases import ALL
from tests.support.devices import some
from tests.support.loop import driven, now, run_driven
from tests.support.recorded import (
    Live,
    assert_same_scans,
    record,
    replayed,
    same_points,
    take_scans,
)

CLEAN, OTHER = "sim://rplidar-s2", "sim://ydlidar-4ros"
OTHER_DAMAGED = f"{OTHER}?fault=flip:0.02%25"
UNEVEN_NS = {case.name: 4e3 * case.sample_us for case in ALL if not case.even}
"""Of streams whose packets tell the speed: a sample."""


@pytest.fixture(scope="module")
def live(tmp_path_factory: pytest.TempPathFactory) -> Live:
    return record(tmp_path_factory.mktemp("replay") / "a.mcap", CLEAN, 10)


@pytest.mark.long
def test_scans_at_true_pace_with_a_thread_that_reads(tmp_path: Path) -> None:
    """Through a terminal bytes are held, handed over together, and read by a thread while the loop is blocked."""

    async def main() -> tuple[list[Scan], list[Scan]]:
        live: list[Scan] = []
        async with (
            lidario.open_lidar("sim://rplidar-s2") as lidar,
            lidar.record(tmp_path / "a.mcap"),
            lidar.scans(depth=64) as stream,
        ):
            async for scan in stream:
                live.append(scan)
                if len(live) == 3:
                    time.sleep(0.25)  # noqa: ASYNC251 - a program that blocks its loop
                elif len(live) == 7:
                    await lidar.get_health()
                elif len(live) == 9:
                    break
        async with lidario.open_lidar(f"{tmp_path / 'a.mcap'}?rate=0") as lidar:
            return live, [scan async for scan in lidar.scans()]

    live, scans = asyncio.run(main())
    assert_same_scans(live, scans)


async def ask_in_between(lidar: Lidar, live: Live) -> None:
    """Interrupted twice, and the mode is changed, on a computer that has run for a day."""
    await asyncio.sleep(1e5)
    async with lidar.scans(depth=64) as stream:
        for _ in range(3):
            live.scans.append(await anext(stream))
            assert (await lidar.get_health()).ok
        live.scans.append(await anext(stream))
    modes = await lidar.get_modes()
    await take_scans(lidar, live, 3, modes[0].id)


def played(live: Live) -> tuple[list[Scan], float]:
    """The scans of a replay as fast as it can be, and how long that took by the clock of the loop."""

    async def main() -> tuple[list[Scan], float]:
        began = now()
        async with lidario.open_lidar(f"{live.path}?rate=0") as lidar, lidar.scans() as stream:
            return [scan async for scan in stream], now() - began

    return run_driven(main)


@pytest.mark.long
@pytest.mark.parametrize("source", [CLEAN, OTHER_DAMAGED])
def test_interruptions_and_changes_of_the_mode_are_replayed(tmp_path: Path, source: str) -> None:
    """The clock of the recording says nothing of how long the session that plays it waits for a quiet line."""
    live = record(tmp_path / "a.mcap", source, act=ask_in_between)
    scans, took = played(live)
    assert len({scan.mode for scan in live.scans}) == (2 if "s2" in source else 1)
    assert_same_scans(live.scans, scans)
    assert took < 1.0


@pytest.mark.long
def test_a_computer_that_has_run_for_longer_made_it(tmp_path: Path) -> None:
    """The clock of a recording says nothing of how long the session waits where a stream ends in it."""

    async def act(lidar: Lidar, live: Live) -> None:
        await asyncio.sleep(1e5)
        await ask_in_between(lidar, live)

    live = record(tmp_path / "a.mcap", CLEAN, act=act)
    scans, took = played(live)
    assert_same_scans(live.scans, scans)
    assert took < 1.0


@driven
async def test_a_recording_that_begins_in_mid_stream(tmp_path: Path) -> None:
    async with lidario.open_lidar("sim://rplidar-s2?via=memory") as lidar, lidar.scans(depth=64) as stream:
        await anext(stream)
        async with lidar.record(tmp_path / "a.mcap"):
            live = await some(stream, 6)
    async with lidario.open_lidar(f"{tmp_path / 'a.mcap'}?rate=0") as lidar, lidar.scans() as stream:
        scans = [scan async for scan in stream]
    # The revolutions before the first whole one of the file are missing.
    first = [scan.stamp_ns for scan in live].index(scans[0].stamp_ns)
    assert first <= 2
    for one, other in zip(live[first:], scans, strict=False):
        assert (one.stamp_ns, one.wall_stamp_ns, one.lost_packets) == (
            other.stamp_ns, other.wall_stamp_ns, other.lost_packets,
        )  # fmt: skip
        assert same_points(one, other)


@pytest.mark.parametrize("source", [CLEAN, OTHER])
def test_the_device_responds_what_it_had_responded(tmp_path: Path, source: str) -> None:
    live = record(tmp_path / "a.mcap", source, 2)

    async def main() -> None:
        async with lidario.open_lidar(tmp_path / "a.mcap") as lidar:
            assert (lidar.info, lidar.health) == (live.info, live.health)
            assert await lidar.get_modes() == live.modes
            assert (await lidar.get_info(), await lidar.get_health()) == (live.info, live.health)
            with pytest.raises(lidario.Unsupported, match="recording"):
                await lidar.set_scan_frequency(7.0)
            with pytest.raises(lidario.Unsupported, match="recording"):
                await lidar.set_power_down_protection(True)
            with pytest.raises(lidario.Unsupported):
                await lidar.get_zero_offset()
            with pytest.raises(lidario.Unsupported, match="no scan mode 99"):
                await anext(lidar.scans(99))
            assert (await lidar.reset()).ok
            assert (await lidar.scan()).stamp_ns == live.scans[0].stamp_ns

    run_driven(main)


@driven
async def test_what_was_recorded_until_a_lidar_failed_is_played(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    """The last that it said of itself is an error. No device is there that a reset would cure."""
    device = lidario.simulate("rplidar-s2", spin_up=0)
    async with lidario.open_lidar(device) as lidar, lidar.record(tmp_path / "a.mcap"):
        with pytest.raises(lidario.DeviceFault):
            async for scan in lidar.scans():
                assert len(scan)
                device.protection_stop(0x8001)  # type: ignore[attr-defined]
        failed = lidar.health
    caplog.clear()
    async with lidario.open_lidar(tmp_path / "a.mcap") as lidar:
        assert lidar.health == failed
        assert not failed.ok
        assert len(await lidar.scan())
    played = PlayedDevice(files.open_stored(tmp_path / "a.mcap"))
    async with lidario.open_lidar(played) as lidar:  # it is as it was when the recording began
        assert lidar.health.ok
        assert len(await lidar.scan())
    assert "is reset" not in caplog.text


@pytest.mark.parametrize("model", ["ldrobot-ld06", "neato-xv11"])
def test_a_speed_that_cannot_be_set_has_no_range_in_a_replay_either(tmp_path: Path, model: str) -> None:
    async def check() -> None:
        async with lidario.open_lidar(path) as lidar:
            with pytest.raises(lidario.Unsupported, match="cannot be set"):
                await lidar.get_scan_frequency_range()

    path = record(tmp_path / "a.mcap", f"sim://{model}", 2).path
    run_driven(check)


@pytest.mark.long
@driven
async def test_pace(live: Live) -> None:
    async def took(options: str, slow: float = 0.0) -> tuple[float, list[Scan]]:
        found: list[Scan] = []
        async with lidario.open_lidar(f"{live.path}?{options}") as lidar, lidar.scans() as stream:
            began = now()
            async for scan in stream:
                found.append(scan)
                await asyncio.sleep(slow)
        return now() - began, found

    seconds, scans = await took("rate=1")
    assert seconds == pytest.approx(1.1, abs=0.15)
    assert_same_scans(live.scans, scans)
    seconds, scans = await took("rate=10")
    assert seconds == pytest.approx(0.11, abs=0.08)
    # A reader that needs two seconds for each scan gets each one, where it decides the pace.
    seconds, scans = await took("rate=0", slow=2.0)
    assert seconds >= 20
    assert_same_scans(live.scans, scans)
    # At true pace the latest one wins, as live.
    _, scans = await took("rate=1", slow=0.25)
    assert sum(scan.dropped_before for scan in scans) > 3


@driven
async def test_a_loop_goes_on_and_time_with_it(live: Live) -> None:
    async with lidario.open_lidar(f"{live.path}?rate=0&loop=1") as lidar, lidar.scans() as stream:
        scans = [await anext(stream) for _ in range(25)]
    assert [scan.stamp_ns for scan in scans] == sorted({scan.stamp_ns for scan in scans})
    assert [scan.seq for scan in scans] == list(range(25))


@driven
async def test_who_reads_again_gets_it_from_its_beginning(live: Live) -> None:
    async with lidario.open_lidar(f"{live.path}?rate=0") as lidar:
        for _ in range(2):
            stamps = [scan.stamp_ns async for scan in lidar.scans()]
            assert stamps[:10] == [scan.stamp_ns for scan in live.scans]


@driven
async def test_one_that_leaves_where_readers_say_when_to_go_on_holds_up_nobody(live: Live) -> None:
    """What it has not taken was waited for."""
    stamps: list[int] = []

    async def read(stream: lidario.ScanStream) -> None:
        async for scan in stream:
            stamps.append(scan.stamp_ns)

    async with lidario.open_lidar(f"{live.path}?rate=0") as lidar, lidar.scans() as goes_on:
        async with lidar.scans() as leaves:
            reading = asyncio.create_task(read(goes_on))
            await anext(leaves)
            await asyncio.sleep(1.0)
            assert not reading.done()
            assert len(stamps) < 10
        async with asyncio.timeout(1.0):
            await reading
    assert stamps[:10] == [scan.stamp_ns for scan in live.scans]


@pytest.mark.long
def test_a_replay_can_be_recorded(live: Live, tmp_path: Path) -> None:
    async def main() -> None:
        async with lidario.open_lidar(f"{live.path}?rate=0") as lidar, lidar.record(tmp_path / "b.mcap"):
            async for _ in lidar.scans():
                pass

    run_driven(main)
    assert_same_scans(live.scans, replayed(tmp_path / "b.mcap"))


@pytest.mark.exhaustive("name", sample=NAMES)
def test_bare_bytes_are_played_as_they_are_decoded(tmp_path: Path, name: str) -> None:
    golden = load(name)
    if golden.response_type is not None:
        found = family_named(golden.family).stream_in(ScanMode(0, "", 0.0, 0.0, golden.response_type))
        assert found is not None
        head = encode_descriptor(Descriptor(golden.response_type, found[0].shortest, True))
    else:
        head = b""
    (tmp_path / "raw.bin").write_bytes(b"boot" + head + golden.raw)
    decoded = list(lidario.decode((tmp_path / "raw.bin").read_bytes(), family=golden.family))
    scans = replayed(tmp_path / "raw.bin", f"rate=0&family={golden.family}")
    assert len(decoded) == len(scans) >= 2
    for one, other in zip(decoded, scans, strict=True):
        # Rounded in other places; where packets tell the speed, by how the bytes are read: four samples, and what
        # their speeds are rounded by, which adds up.
        rounded_ns = 1e-3 * one.stamp_ns if name in UNEVEN_NS else 0
        assert abs(one.stamp_ns - other.stamp_ns) <= UNEVEN_NS.get(name, 1) + rounded_ns
        assert same_points(one, other)
