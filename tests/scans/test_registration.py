"""Laying clouds on each other: ten poses in the simulated room, and the verb that writes them down."""

import math
import random
from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
import small_gicp

import lidario
from lidario import InvalidValue, Mount, looseness, read_config, register
from lidario.basics.source import Source
from tests.cli.processes import invoke, invoke_driven
from tests.support.loop import driven

DRAW = random.Random(29)
POSES = [(DRAW.uniform(-0.3, 0.3), DRAW.uniform(-0.3, 0.3), DRAW.uniform(-math.pi, math.pi)) for _ in range(10)]


async def seen(pose: tuple[float, float, float], model: str = "rplidar-c1", seed: int = 0) -> np.ndarray:
    x, y, yaw = pose
    source = f"sim://{model}?via=memory&pose={x:.6f},{y:.6f},{math.degrees(yaw):.6f}&seed={seed}"
    async with lidario.open_lidar(source) as lidar, lidar.scans(depth=3) as scans:
        return np.concatenate([(await anext(scans)).points().xy for _ in range(3)])


@pytest.mark.long
@pytest.mark.exhaustive("pose", sample=POSES[:2], full=POSES)
@driven
async def test_ten_poses(pose: tuple[float, float, float]) -> None:
    pose = tuple(round(each, 6) for each in pose)  # type: ignore[assignment]
    clouds = await seen((0.0, 0.0, 0.0)), await seen(pose, seed=3)
    found = register(*clouds)
    assert math.hypot(found.mount.x - pose[0], found.mount.y - pose[1]) < 0.005
    assert abs(math.degrees(math.remainder(found.mount.yaw - pose[2], math.tau))) < 0.2
    assert found.residual < 0.01
    assert found.share > 0.7 > found.rival
    assert looseness(*clouds, found) < 0.8


@pytest.mark.long
async def test_a_guess_is_enough_where_the_room_looks_alike() -> None:
    corners = [(2.0, 1.5), (-2.0, 1.5), (-2.0, -1.5), (2.0, -1.5), (2.0, 1.5)]
    walls = np.concatenate([np.linspace(a, b, 300) for a, b in pairwise(corners)])
    turned = (walls - [0.1, 0.0]) @ [[0.0, -1.0], [1.0, 0.0]]
    asked = register(walls, turned)
    assert asked.rival > 0.85 * asked.share
    found = register(walls, turned, guess=Mount(0.0, 0.0, math.radians(80)))
    assert (found.mount.x, found.mount.y) == pytest.approx((0.1, 0.0), abs=1e-3)
    assert found.mount.yaw == pytest.approx(math.pi / 2, abs=1e-3)


WAYS = np.exp(1j * (np.arange(2000) + 0.5) * (math.tau / 2000))


def corridor_of(y: float, far: float = 12.0) -> np.ndarray:
    """What is seen between walls at 1 m on both sides, from so far beside their middle."""
    ranges = (np.sign(WAYS.imag) - y) / WAYS.imag
    ranges += np.random.default_rng(round(1000 * y)).normal(0.0, 0.005, len(ranges))
    return np.compress(ranges < far, WAYS * ranges)


def left_of(room: np.ndarray) -> np.ndarray:
    return np.compress(room.imag > 0, room)


def plane(room: np.ndarray) -> np.ndarray:
    return np.stack((room.real, room.imag), axis=1)


ROUND = 3 * WAYS + np.random.default_rng(7).normal(0.0, 0.005, len(WAYS)) * WAYS


@pytest.mark.long
@pytest.mark.parametrize(
    ("first", "second"),
    [
        (corridor_of(0.0), corridor_of(0.1)),
        (left_of(corridor_of(0.0)), left_of(corridor_of(0.1))),
        (ROUND, (ROUND * 1j)[::-1] + 0.1),
    ],
    ids=["corridor", "wall", "round"],
)
def test_a_room_that_does_not_hold_a_lidar(first: np.ndarray, second: np.ndarray) -> None:
    found = register(plane(first), plane(second), guess=Mount())
    assert found.share > 0.8
    assert found.residual < 0.02
    assert looseness(plane(first), plane(second), found) > 0.9


@pytest.mark.long
def test_many_scans_cost_hardly_more_than_a_few(monkeypatch: pytest.MonkeyPatch) -> None:
    """They show the same walls. Twenty scans of a fast lidar took a minute, or several on a robot's computer."""
    searched: list[int] = []

    def counted(tree: object, points: np.ndarray) -> object:
        searched.append(len(points))
        return search(tree, points)

    search = small_gicp.KdTree.batch_nearest_neighbor_search
    monkeypatch.setattr(small_gicp.KdTree, "batch_nearest_neighbor_search", counted)
    corners = [(3.0, 1.5), (-2.0, 1.5), (-2.0, -1.5), (2.0, -1.5), (3.0, 1.5)]
    walls = np.concatenate([np.linspace(a, b, 300) for a, b in pairwise(corners)])
    used, noise = [], np.random.default_rng(3)
    for times in (1, 40):
        shown = (np.tile(each, (times, 1)) for each in (walls, walls - [0.1, 0.0]))
        clouds = [each + noise.normal(0.0, 0.003, each.shape) for each in shown]
        searched.clear()
        found = register(*clouds)
        used.append(sum(searched))
        assert found.mount.x == pytest.approx(0.1, abs=1e-3)
        assert found.share == 1.0
    assert used[1] < 5 * used[0]


def test_what_is_no_cloud() -> None:
    cloud = np.random.default_rng(1).uniform(-1, 1, (100, 2))
    with pytest.raises(InvalidValue, match="the second cloud has 29 points, and 30 are needed"):
        register(cloud, cloud[:29])
    with pytest.raises(InvalidValue, match="the first cloud is finite metres"):
        register(cloud * np.nan, cloud)
    with pytest.raises(InvalidValue, match="found is what register"):
        looseness(cloud, cloud, Mount())  # type: ignore[arg-type]
    with pytest.raises(InvalidValue, match="guess is a Mount"):
        register(cloud, cloud, guess=3)  # type: ignore[arg-type]


@pytest.mark.long
def test_the_verb_writes_the_mount(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    here, there = "AA" * 16, "BB" * 16
    sources = (
        f"sim://rplidar-c1?via=memory&serial={here}",
        f"sim://rplidar-c1?via=memory&serial={there}&pose=0.25,-0.1,120&seed=2",
    )
    Path("lidario.toml").write_text(f"[lidars.{here}]\nmount = {{ x = 0.2, yaw_deg = 90 }}\n")
    invoke_driven("calibrate", *sources, "-n", "2", "--dry-run", code=0)
    assert read_config("lidario.toml").of(there).mount is None
    done = invoke_driven("calibrate", *sources, "-n", "2", "--picture", "both.svg", code=0)
    assert "written into lidario.toml" in done.stderr
    mount = read_config("lidario.toml").of(there).mount
    assert mount is not None
    assert (mount.x, mount.y) == pytest.approx((0.3, 0.25), abs=0.005)
    assert math.degrees(mount.yaw) == pytest.approx(-150.0, abs=0.2)
    assert Path("both.svg").read_text().startswith("<svg")
    round_room = [f"sim://rplidar-c1?via=memory&world=circle&serial={each * 32}" for each in "EF"]
    alike = invoke_driven("calibrate", *round_room, "-n", "2", code=1)
    assert "looks alike from several sides" in alike.stderr
    loose = invoke_driven("calibrate", *round_room, "-n", "2", "--guess=0,0,10", code=1)
    assert "does not hold B in its place" in loose.stderr
    same = invoke_driven("calibrate", sources[0], sources[0].replace("c1?", "c1?pose=0.1,0,0&"), "-n", "2", code=2)
    assert "cannot tell them apart" in same.stderr


def test_two_alike_are_told_before_anything_is_measured(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Both stand on tables of their own, where nothing is seen: what is measured would not do either."""
    monkeypatch.chdir(tmp_path)
    sources = [f"sim://rplidar-c1?via=memory&world=empty&seed={seed}&serial={'AB' * 16}" for seed in (1, 2)]
    told = invoke_driven("calibrate", *sources, "-n", "2")
    assert (told.exit_code, told.stdout) == (2, "")
    assert "cannot tell them apart" in told.stderr


def in_metres(walls: Sequence[Sequence[complex]]) -> list[tuple[tuple[float, float], tuple[float, float]]]:
    return [((begin.real, begin.imag), (end.real, end.imag)) for begin, end in walls]


@pytest.mark.long
def test_a_lidar_that_hangs_upside_down_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    room = [-3 - 2j, 4 - 2j, 4 + 2.5j, -3 + 2.5j, -3 - 2j]
    cupboard = [1 - 1j, 1.5 - 1j, 1.5 - 0.2j, 1 - 0.2j, 1 - 1j]
    walls = [*pairwise(room), *pairwise(cupboard), (-3 + 1j, -1.5 + 2.5j)]
    # B is 0.5 m ahead of A, 0.5 m to its right, and turned. Upside down, its left is its right.
    upright = [[(end - (0.5 - 0.5j)) * np.exp(-2j) for end in wall] for wall in walls]
    upside_down = [[end.conjugate() for end in wall] for wall in upright]
    worlds = [in_metres(each) for each in (walls, upright, upside_down)]

    def make(source: Source) -> tuple[lidario.SimulatedDevice, None]:
        number = int(source.options["seed"])
        return lidario.simulate("rplidar-c1", world=worlds[number], serial=f"{number:02X}" * 16), None

    monkeypatch.setattr("lidario.port.simulated.make_device", make)
    a, *others = (f"sim://rplidar-c1?via=memory&seed={number}" for number in range(3))
    good, told = (
        invoke_driven("calibrate", a, each, "-n", "2", "--dry-run", "--config", "/dev/null") for each in others
    )
    assert good.exit_code == 0, good.stderr
    assert "yaw = 114." in good.stdout
    assert (told.exit_code, told.stdout) == (1, "")
    assert "upside down" in told.stderr


@pytest.mark.parametrize(
    ("options", "named"), [((), "lidario.toml"), (("--dry-run", "--picture", "both.svg"), "both.svg")]
)
def test_that_nothing_can_be_written_is_told_before_a_lidar_is_asked(
    options: tuple[str, ...], named: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir("/proc")  # where nobody may make a file, not even root
    told = invoke("calibrate", "/dev/no-lidar-is-here", "/dev/nor-here", *options)
    assert (told.exit_code, told.stdout) == (4, "")
    assert told.stderr.startswith(f"error: {named} cannot be written: ")
