"""Every LaserScan that lidario writes, of lidars that speed up and of damaged lines, as slam_toolbox takes it.

A topic, `record --scans` and `export` have one grid each: as many beams in each message, at the same angles, since
slam_toolbox knows both of the first message alone.
"""

import asyncio
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import lidario
from lidario.testing import SimulatedLidar
from tests.cli.processes import invoke
from tests.reference.nodes import SlamToolbox, laser_geometry
from tests.ros.test_nodes import COUNT, MUST_BE_NAMED, published, scans_of
from tests.support.loop import run_driven
from tests.support.messages import scans_of_file
from tests.support.router import Router
from tests.support.samples import ONE_A_FAMILY, SOME_MODELS
from tests.support.walls import LONGEST_M, WALLS, from_walls, is_all_around

TROUBLE = {
    "none": {},
    "spin-up": {"spin_up": 2.0},
    "flip": {"fault": "flip:0.05%"},
    "drop": {"fault": "drop:0.05%"},
}
CASES = [("record", "spin-up"), ("topic", "none"), ("export", "flip"), ("record", "drop"), ("topic", "spin-up")]


def in_turns(models: Sequence[str]) -> list[tuple[str, str, str]]:
    """Each model in one way, and ways in turns."""
    return [(*CASES[number % len(CASES)], model) for number, model in enumerate(models)]


SOME_IN_EVERY_WAY = [(*case, model) for case in CASES for model in SOME_MODELS[:: len(CASES)]]
SOUND = 0.98
"""Share of the returns of a message, and on a damaged line of all: not every format has a check sum, and what is
read behind a byte that was lost, until the packets are found again, is anywhere."""
BEAMS = 1.0
"""By so many a return may be beside its direction: half a beam on the grid, half a beam where that begins."""


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
    if way == "topic":
        scans = await asyncio.to_thread(scans_of, model, **TROUBLE[trouble])  # type: ignore[arg-type]
        messages, _ = await published(router, 43, [scan for scan in scans if len(scan)])
        return messages
    path = folder / "recorded.mcap"
    await asyncio.to_thread(recorded, path, model, trouble, scans=way == "record")
    if way == "export":
        done = await asyncio.to_thread(invoke, "export", str(path), str(folder / "exported.mcap"))
        assert done.exit_code == 0, done.stderr
        path = folder / "exported.mcap"
    return scans_of_file(path)


@pytest.mark.long
@pytest.mark.exhaustive("what", sample=in_turns(ONE_A_FAMILY), full=[*in_turns(SOME_MODELS), *SOME_IN_EVERY_WAY])
async def test_slam_toolbox_takes_all_and_finds_the_walls(
    what: tuple[str, str, str], router: Router, tmp_path: Path
) -> None:
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
    for reader, each in near.items():
        parts = [np.concatenate(each)] if trouble in ("flip", "drop") else each
        worst = min(float(part.mean()) for part in parts)
        assert worst > SOUND, f"{reader}: {worst:.1%} of the returns are where walls are"
    assert is_all_around(np.concatenate([each for each in taken if each is not None])) or trouble in (
        "flip",
        "drop",
    )
