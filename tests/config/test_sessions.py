"""The settings in a session: mode, speed and filters, for every reader and in a recording."""

from __future__ import annotations

import asyncio
from itertools import chain
from pathlib import Path

import numpy as np
import pytest

import lidario
from lidario import InvalidValue, Unsupported, decode_file
from lidario.recording.decode_file import FileDecoder
from lidario.testing import SimulatedLidar
from tests.cli.processes import invoke
from tests.support.messages import scans_of_file

SERIAL = "AB" * 16
HALF = f"""
[lidars.{SERIAL}]
mode = "Standard"
speed_rpm = 480
frame = "front"
mount = {{ x = 0.5 }}
[[lidars.{SERIAL}.filters]]
filter = "AngularBoundsFilter"
windows = [[-1.5, 1.5]]
"""


@pytest.fixture
def settings(tmp_path: Path) -> Path:
    path = tmp_path / "lidario.toml"
    path.write_text(HALF)
    return path


@pytest.mark.long
async def test_a_session_honours_them(settings: Path, tmp_path: Path) -> None:
    lidar = SimulatedLidar("rplidar-s2", serial=SERIAL)
    async with lidario.open_lidar(lidar, config=settings) as session:
        assert session.config.frame == "front"
        assert session.config.mount == lidario.Mount(0.5)
        async with session.record(tmp_path / "a.mcap", scans=True) as recording, session.scans() as scans:
            for _ in range(4):
                scan = await anext(scans)
                assert scan.mode == "Standard"
                assert abs(scan.angles[scan.valid]).max() <= 1.5
                assert scan.left_out.sum() > 0.4 * len(scan)
            async with session.sectors(90) as sectors:
                behind = [each for each in [await anext(sectors) for _ in range(4)] if each.index in (1, 2)]
                assert all(abs(each.angles[each.valid]).max(initial=0.0) <= 1.5 for each in behind)
            assert scan.rpm == pytest.approx(480, rel=0.02)
        assert recording.error is None
        async with session.scans("DenseBoost") as dense:
            assert (await anext(dense)).mode == "DenseBoost"
    assert {each.name for each in lidar.log if not each.obeyed} == set()
    # The bytes are those of the device; a reader of the file gets all of them.
    raw = next(iter(decode_file(tmp_path / "a.mcap")))
    assert abs(raw.angles[raw.valid]).max() > 3.0
    async with lidario.open_lidar(tmp_path / "a.mcap", config=settings) as played:
        again = await played.scan()
    assert abs(again.angles[again.valid]).max() <= 1.5
    decoder = FileDecoder(tmp_path / "a.mcap")
    decoder.filters = lidario.read_config(settings).of(SERIAL).filters
    for one in decoder:
        assert abs(one.angles[one.valid]).max() <= 1.5


async def test_the_mode_is_that_of_each_reader_that_asks_for_none(settings: Path) -> None:
    lidar = SimulatedLidar("rplidar-s2", serial=SERIAL)
    async with lidario.open_lidar(lidar, config=settings) as session:
        first, second = (asyncio.create_task(session.scan()) for _ in range(2))
        await asyncio.sleep(0)
        first.cancel()
        scans = [await second, await session.scan(), await session.scan()]
    assert [scan.mode for scan in scans] == ["Standard"] * 3


async def test_a_mode_that_the_device_lacks_is_told_as_that_of_the_settings(tmp_path: Path) -> None:
    """Nobody has named one where it is read."""
    path = tmp_path / "x.toml"
    path.write_text("[default]\nmode = 'nix'\n")
    async with lidario.open_lidar(SimulatedLidar("rplidar-s2"), config=path) as session:
        with pytest.raises(Unsupported, match=r"^mode = 'nix' of the settings: this device has no"):
            await session.scan()
        with pytest.raises(Unsupported, match="no scan mode 'other'"):
            await session.scan("other")
        assert (await session.scan("Standard")).mode == "Standard"


async def test_where_it_is_mounted_is_known_to_those_who_merge(tmp_path: Path) -> None:
    path = tmp_path / "x.toml"
    path.write_text("[default]\nmount = { x = 100.0 }\n")
    lidar = SimulatedLidar("rplidar-s2")
    async with lidario.open_lidar(lidar, config=path) as session, lidario.merged(session) as clouds:
        cloud = await anext(clouds)
    assert len(cloud)
    assert cloud.points.xy[:, 0].min() > 50


async def test_another_lidar_is_left_as_it_is(settings: Path) -> None:
    async with lidario.open_lidar(SimulatedLidar("rplidar-s2", serial="CD" * 16), config=settings) as session:
        scan = await session.scan()
    assert scan.mode == "DenseBoost"
    assert not scan.left_out.any()


async def test_a_speed_that_cannot_be_set_names_the_file(tmp_path: Path) -> None:
    path = tmp_path / "x.toml"
    path.write_text("[default]\nspeed_rpm = 100000\n")
    lidar = SimulatedLidar("rplidar-s2")
    with pytest.raises((InvalidValue, Unsupported), match=r"x\.toml: speed_rpm = 100000: "):
        async with lidario.open_lidar(lidar, config=path):
            raise AssertionError
    assert lidar.is_still


def test_what_is_wrong_is_told_before_anything_is_opened(tmp_path: Path) -> None:
    with pytest.raises(InvalidValue, match="cannot be read"):
        lidario.open_lidar("/dev/nosuchport", config=tmp_path / "none.toml")


@pytest.mark.long
def test_the_command_finds_the_file(settings: Path, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    source = f"sim://rplidar-s2?via=memory&serial={SERIAL}"
    empty = tmp_path / "empty"
    empty.mkdir()
    monkeypatch.chdir(empty)
    named = invoke("scan", source, "--config", str(settings), "--json")
    monkeypatch.setenv("LIDARIO_CONFIG", str(settings))
    by_variable = invoke("scan", source, "--json")
    monkeypatch.delenv("LIDARIO_CONFIG")
    none = invoke("scan", source, "--json")
    monkeypatch.chdir(tmp_path)
    here = invoke("scan", source, "--json")
    not_here = invoke("scan", source, "--json", "--config", "/dev/null")
    for done in (named, by_variable, here):
        assert '"Standard"' in done.stdout, done.stderr
    for done in (none, not_here):
        assert '"DenseBoost"' in done.stdout, done.stderr
    assert "settings of lidario.toml\n" in here.stderr
    assert "settings of" not in named.stderr + none.stderr
    wrong = invoke("scan", source, "--config", "none.toml", code=2)
    assert "none.toml: the file of settings cannot be read" in wrong.stderr


@pytest.mark.long
def test_recordings_and_exports_honour_it(settings: Path, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.chdir(tmp_path)
    source = f"sim://rplidar-s2?via=memory&serial={SERIAL}"
    assert invoke("record", source, "-o", "run.mcap", "-n", "3", "--scans").exit_code == 0
    assert invoke("export", "run.mcap", "out.mcap").exit_code == 0
    assert invoke("export", "run.mcap", "out.npz").exit_code == 0
    # What is typed goes before what the settings say.
    assert invoke("export", "run.mcap", "named.mcap", "--frame", "mine").exit_code == 0
    assert {scan.header.frame_id for scan in scans_of_file(Path("named.mcap"))} == {"mine"}
    for scan in chain.from_iterable(scans_of_file(Path(name)) for name in ("run.mcap", "out.mcap")):
        assert scan.header.frame_id == "front"
        turned = scan.angle_min + np.arange(len(scan.ranges)) * scan.angle_increment
        angles = (turned + np.pi) % (2 * np.pi) - np.pi
        assert np.isnan(scan.ranges[abs(angles) > 1.52]).all()
        assert (scan.ranges[abs(angles) < 1.48] > 0).any()
    with np.load("out.npz") as arrays:
        clockwise = (arrays["device_angles"] + 180.0) % 360.0 - 180.0
        assert not arrays["device_distances"][abs(clockwise) > 86.5].any()
