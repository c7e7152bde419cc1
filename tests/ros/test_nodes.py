"""What nodes make of every LaserScan that lidario writes: slam_toolbox takes it, and all returns lie on the walls.

`tests.reference.nodes` has their rules. Here they are applied to files, and to what another client of the router
gets.
"""

import asyncio
import math
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from zenoh import ext

import lidario
from lidario.ros import Publisher
from lidario.ros.names import LASERSCAN, TF_MESSAGE, Node
from lidario.scans.beams import BeamOrder, Preset
from lidario.scans.scan import Scan
from lidario.testing import SimulatedLidar, make_scan
from tests.cli.processes import invoke
from tests.reference.nodes import SlamToolbox, laser_geometry, moved
from tests.support.loop import run_driven, until
from tests.support.messages import decoded, scans_of_file
from tests.support.network import Rig
from tests.support.router import Router, client
from tests.support.samples import MODELS, ONE_A_FAMILY, SOME_MODELS
from tests.support.walls import LONGEST_M, WALLS, from_walls, is_all_around

COUNT = 30
ORDERS: tuple[BeamOrder, ...] = ("counter-clockwise", "measured")
PRESETS: tuple[Preset, ...] = ("rep103", "vendor")
MUST_BE_NAMED = ("ydlidar-tx8", "neato-lds02rr", "neato-lds01rr")
"""They must be named, or units or the sense of rotation are those of another model."""
MOUNT = (0.3, -0.2, 0.7)
"""Of the lidar in the frame of its robot: metres ahead, metres to the left, radians."""


TROUBLE = {
    "none": {},
    "spin-up": {"spin_up": 2.0},
    "flip": {"fault": "flip:0.05%"},
    "drop": {"fault": "drop:0.05%"},
}
CASES = [("record", "spin-up"), ("export", "flip"), ("record", "drop"), ("topic", "spin-up")]
SOME_IN_EVERY_WAY = [(*case, model) for case in CASES for model in SOME_MODELS[:: len(CASES)]]
SOUND = 0.98
"""Share of the returns of a message, and on a damaged line of all: not every format has a check sum, and what is
read behind a byte that was lost, until the packets are found again, is anywhere."""
BEAMS = 1.0
"""By so many a return may be beside its direction: half a beam on the grid, half a beam where that begins."""


def in_turns(models: Sequence[str]) -> list[tuple[str, str, str]]:
    """Each model in one way, and ways in turns."""
    return [(*CASES[number % len(CASES)], model) for number, model in enumerate(models)]


def as_topics(models: Sequence[str]) -> list[tuple[str, str, str]]:
    return [("topic", "none", model) for model in models]


def scans_of(model: str, *, spin_up: float = 0.0, fault: str = "") -> list[Scan]:
    """What a lidar sees of the room, with every scan of the session."""

    async def main() -> list[Scan]:
        device = SimulatedLidar(model, walls=WALLS, spin_up=spin_up, fault=fault)
        async with (
            lidario.open_lidar(device, family=model.partition("-")[0]) as lidar,
            lidar.scans(depth=COUNT) as stream,
        ):
            return [await anext(stream) for _ in range(COUNT)]

    return run_driven(main)


async def published(router: Router, domain: int, scans: list[Scan], **options: Any) -> tuple[list[Any], list[Any]]:
    """The scans as they come from the network, and what comes of /tf_static."""
    node, came, frames = Node(domain=domain), list[Any](), list[Any]()
    async with Rig(router) as rig:
        reader = await rig.bus()
        reader.subscribe(node.data_key("/scan", LASERSCAN), came.append)
        lidar = await rig.enter_async_context(lidario.open_lidar(SimulatedLidar(pace=1.0)))
        publisher = Publisher(lidar, domain=domain, router=router.address, **options)
        async with publisher:
            await until(lambda: publisher.is_connected and publisher.is_read)
            for scan in scans:
                publisher.publish(scan)
                await until(lambda: len(came) == publisher.scans)
            # But for those that waited for the grid.
            assert len(came) > len(scans) / 3
            if "mount" in options:
                history = ext.HistoryConfig(detect_late_publishers=True)
                key = node.data_key("/tf_static", TF_MESSAGE)
                late = rig.enter_context(client(router.address))
                held = ext.declare_advanced_subscriber(late, key, frames.append, history=history)
                await until(lambda: frames)
                held.undeclare()  # type: ignore[no-untyped-call]
    transforms = [decoded(each.payload.to_bytes(), "tf2_msgs/msg/TFMessage").transforms[0] for each in frames]
    return [decoded(each.payload) for each in came], transforms


def on_walls(points: np.ndarray[Any, Any], message: Any) -> bool:
    """Whether all returns are where walls are, to half a beam and the rounding of the device."""
    return bool(from_walls(points).max() < abs(message.angle_increment) / 2 * LONGEST_M + 0.01)


def test_the_rules_themselves() -> None:
    laser = make_scan(np.radians(np.arange(0.0, 360.0)), 2.0).to_laserscan(360)
    others = replace(laser, ranges=laser.ranges[:-1]), replace(laser, angle_min=laser.angle_min + 0.1)
    message, shorter, turned = (decoded(each.to_cdr()) for each in (laser, *others))
    slam = SlamToolbox()
    points = slam.take(message)
    assert points is not None
    np.testing.assert_allclose(points, laser_geometry(message), atol=1e-5)
    assert slam.take(shorter) is None
    np.testing.assert_array_equal(slam.take(turned), points)
    assert slam.refused == 1
    assert np.abs(laser_geometry(turned) - points).max() > 0.1
    # A grid whose ends are one and the same direction, and one that leaves out its last beam.
    closed = replace(message, angle_min=0.0, angle_max=2 * np.pi, angle_increment=2 * np.pi / 359)
    opened = replace(message, angle_min=0.0, angle_max=2 * np.pi - 1e-3, angle_increment=2 * np.pi / 360)
    assert SlamToolbox().take(closed) is not None
    assert SlamToolbox().take(opened) is not None


def recorded(path: Path, model: str, trouble: str, *, scans: bool) -> None:
    async def main() -> None:
        device = SimulatedLidar(model, walls=WALLS, **TROUBLE[trouble])  # type: ignore[arg-type]
        async with (
            lidario.open_lidar(device, family=model.partition("-")[0]) as lidar,
            lidar.record(path, scans=scans) as recording,
            lidar.scans(depth=COUNT) as stream,
        ):
            async for _ in stream:
                if recording.scans >= COUNT:
                    break

    run_driven(main)


async def messages_of(way: str, model: str, trouble: str, folder: Path, router: Router) -> list[Any]:
    """What is written; the returns of a topic without trouble lie on the walls, beam for beam."""
    if way == "topic":
        scans = await asyncio.to_thread(scans_of, model, **TROUBLE[trouble])  # type: ignore[arg-type]
        scans = [scan for scan in scans if len(scan)]
        messages, _ = await published(router, 43, scans)
        if trouble == "none":
            seen = list[Any]()
            # Those that waited for the grid were not sent.
            for scan, message in zip(scans[-len(messages) :], messages, strict=True):
                # Not every format has a check sum, and the model of a device that tells nothing is a guess.
                if from_walls(scan.xy()[scan.valid]).max() < 0.03:
                    # The beams at both ends have samples of a moment before and after the revolution, too.
                    between = np.concatenate([[np.nan], message.ranges[1:-1], [np.nan]])
                    seen.append(laser_geometry(replace(message, ranges=between)))
                    assert on_walls(seen[-1], message)
            assert model in MUST_BE_NAMED or is_all_around(np.concatenate(seen))
        return messages
    path = folder / "recorded.mcap"
    await asyncio.to_thread(recorded, path, model, trouble, scans=way == "record")
    if way == "export":
        await asyncio.to_thread(invoke, "export", str(path), str(folder / "exported.mcap"), code=0)
        path = folder / "exported.mcap"
    return scans_of_file(path)


@pytest.mark.long
@pytest.mark.exhaustive(
    "what",
    sample=[*as_topics(ONE_A_FAMILY), *in_turns(ONE_A_FAMILY)],
    full=[*as_topics(MODELS), *in_turns(SOME_MODELS), *SOME_IN_EVERY_WAY],
)
async def test_slam_toolbox_takes_all_and_finds_the_walls(
    what: tuple[str, str, str], router: Router, tmp_path: Path
) -> None:
    """Of lidars that speed up and of damaged lines, too.

    A topic, `record --scans` and `export` have one grid each: as many beams in each message, at the same angles,
    since slam_toolbox knows both of the first message alone.
    """
    way, trouble, model = what
    messages = await messages_of(way, model, trouble, tmp_path, router)
    assert len(messages) > COUNT / 3
    slam = SlamToolbox()
    taken = [slam.take(message) for message in messages]
    assert slam.refused == 0, f"{slam.refused} of {len(messages)} have another number of beams than the first one"
    if model in MUST_BE_NAMED:
        return
    near: dict[str, list[Any]] = {"slam_toolbox": [], "laser_geometry": []}
    for message, points in zip(messages, taken, strict=True):
        for reader, found in (("slam_toolbox", points), ("laser_geometry", laser_geometry(message))):
            assert found is not None
            near[reader].append(from_walls(found) < BEAMS * abs(message.angle_increment) * LONGEST_M + 0.03)
    is_damaged = trouble in ("flip", "drop")
    for reader, each in near.items():
        parts = [np.concatenate(each)] if is_damaged else each
        worst = min(float(part.mean()) for part in parts)
        assert worst > SOUND, f"{reader}: {worst:.1%} of the returns are where walls are"
    assert is_damaged or is_all_around(np.concatenate([each for each in taken if each is not None]))


@pytest.mark.long
@pytest.mark.parametrize(("preset", "mounted"), [(PRESETS[0], False), (PRESETS[0], True), (PRESETS[1], False)])
@pytest.mark.parametrize("order", ORDERS)
async def test_walls_are_where_they_are(router: Router, order: BeamOrder, preset: Preset, mounted: bool) -> None:
    """With ``--mount`` in the frame of the robot, whatever the beams begin with and wherever their 0 is."""
    scans = await asyncio.to_thread(scans_of, "rplidar-s2")
    options: dict[str, Any] = {"mount": MOUNT} if mounted else {}
    messages, transforms = await published(router, 42, scans[:3], order=order, preset=preset, **options)
    for message in messages:
        points = laser_geometry(message)
        if mounted:
            # From the frame of the robot back to the walls, which are around the lidar as it is mounted.
            points = moved(points, transforms[0]) - MOUNT[:2]
            turn = np.array([[math.cos(MOUNT[2]), -math.sin(MOUNT[2])], [math.sin(MOUNT[2]), math.cos(MOUNT[2])]])
            points = points @ turn
        elif preset == "vendor":
            # Its 0 is behind the lidar.
            points = -points
        assert is_all_around(points)
        assert on_walls(points, message)
