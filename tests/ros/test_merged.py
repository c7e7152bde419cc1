"""Several lidars as one publisher, and settings that a subscriber sees."""

from __future__ import annotations

import asyncio
import signal
from contextlib import AsyncExitStack
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rosbags.typesys import Stores, get_typestore

import lidario
from lidario import InvalidValue, Mount
from lidario.network.bus import Bus
from lidario.ros import MergedPublisher
from lidario.ros.names import DIAGNOSTICS, LASERSCAN, POINTCLOUD2, Node
from lidario.testing import make_scan
from tests.cli.processes import BOUND, invoke, started
from tests.support.network import until
from tests.support.router import Router
from tests.test_examples import load

STORE = get_typestore(Stores.ROS2_JAZZY)
ONE, TWO = (f"sim://rplidar-c1?via=memory&serial={each * 32}" for each in "AB")
BODY = "".join(
    f"""
[lidars.{each * 32}]
mount = {{ x = {x}, yaw_deg = {yaw} }}
[[lidars.{each * 32}.filters]]
filter = "BoxFilter"
min_x = -3.0
max_x = 3.0
min_y = 0.0
max_y = 9.0
"""
    for each, x, yaw in (("A", 0.2, 0), ("B", -0.2, 180))
)
"""All on the left of the robot is left out, and all in front on the right is not."""


class Heard:
    """What is published in a domain."""

    def __init__(self, bus: Bus, domain: int) -> None:
        node = Node(domain=domain)
        self.scans: list[Any] = []
        self.clouds: list[Any] = []
        self.health: list[Any] = []
        bus.subscribe(node.data_key("/scan", LASERSCAN), self.scans.append)
        bus.subscribe(node.data_key("/cloud", POINTCLOUD2), self.clouds.append)
        bus.subscribe(node.data_key("/diagnostics", DIAGNOSTICS), self.health.append)

    def check(self, frame: str = "base_link") -> None:
        cloud: Any = STORE.deserialize_cdr(self.clouds[-1].payload, "sensor_msgs/msg/PointCloud2")
        points = np.frombuffer(cloud.data, [(each, "<f4") for each in ("x", "y", "z", "i")] + [("t", "<u4")])
        assert (cloud.header.frame_id, cloud.width) == (frame, len(points))
        left = (abs(points["x"]) < 2.99) & (points["y"] > 0.01)
        assert not left.any()
        assert (points["y"] < -0.5).sum() > 100
        scan: Any = STORE.deserialize_cdr(self.scans[-1].payload, "sensor_msgs/msg/LaserScan")
        assert scan.header.frame_id == frame
        assert len(scan.ranges) == 720
        turned = scan.angle_min + scan.angle_increment * np.arange(720)
        assert np.isinf(scan.ranges[abs(turned - 1.57) < 0.3]).all()
        assert np.isfinite(scan.ranges[abs(turned + 1.57) < 0.3]).any()


@pytest.fixture
def settings(tmp_path: Path) -> Path:
    path = tmp_path / "lidario.toml"
    path.write_text(BODY.replace("mount =", 'frame = "front"\nmount ='))
    return path


async def test_masked_robot(router: Router, settings: Path) -> None:
    """The program of the docs."""
    async with AsyncExitStack() as stack:
        bus = await Bus.open(router.address)
        stack.push_async_callback(bus.close)
        heard = Heard(bus, 0)
        await load("masked_robot").main(ONE, TWO, str(settings), 5, router.address)
        await until(lambda: len(heard.scans) >= 4 and len(heard.clouds) >= 4)
        heard.check()
        names = {
            status.name
            for each in heard.health
            for status in STORE.deserialize_cdr(each.payload, "diagnostic_msgs/msg/DiagnosticArray").status  # type: ignore[attr-defined]
        }
        assert {name.split()[-1] for name in names} == {"A" * 32, "B" * 32}


async def test_the_command_publishes_two_as_one(router: Router, settings: Path) -> None:
    async with AsyncExitStack() as stack:
        bus = await Bus.open(router.address)
        stack.push_async_callback(bus.close)
        heard = Heard(bus, 31)
        arguments = ("--ros", "--domain", "31", "--router", router.address, "--config", str(settings))
        with started("publish", ONE, TWO, *arguments, "--base-frame", "base") as process:
            await until(lambda: len(heard.scans) > 3 and len(heard.clouds) > 3)
            process.send_signal(signal.SIGINT)
            _, said = await asyncio.to_thread(process.communicate, timeout=BOUND)
        heard.check("base")
        assert process.returncode == 0, said


async def test_settings_of_one_are_seen_by_a_subscriber(router: Router, settings: Path) -> None:
    async with AsyncExitStack() as stack:
        bus = await Bus.open(router.address)
        stack.push_async_callback(bus.close)
        heard = Heard(bus, 32)
        arguments = ("--ros", "--domain", "32", "--router", router.address, "--config", str(settings))
        with started("publish", ONE, *arguments) as process:
            await until(lambda: len(heard.scans) > 3)
            process.send_signal(signal.SIGINT)
            await asyncio.to_thread(process.communicate, timeout=BOUND)
    scan: Any = STORE.deserialize_cdr(heard.scans[-1].payload, "sensor_msgs/msg/LaserScan")
    assert scan.header.frame_id == "front"
    turned = scan.angle_min + scan.angle_increment * np.arange(len(scan.ranges))
    assert not np.isfinite(scan.ranges[abs(turned - 1.57) < 0.3]).any()


async def test_what_is_no_cloud(router: Router) -> None:
    async with lidario.open_lidar(ONE) as lidar:
        publisher = MergedPublisher([lidar], mounts=[Mount()], router=router.address)
        with pytest.raises(InvalidValue, match=r"takes what lidario\.merged\(\) gives"):
            publisher.publish(make_scan([0.0], [1.0]))


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("--zenoh", "a"), "several lidars become one with --ros"),
        (("--ros", "--mount", "0,0,0"), "there are 2 lidars and 1 mounts"),
        (("--ros", "--mount-yaw", "3"), "--mount-yaw is for one lidar"),
        (("--ros", "--frame", "x"), "--frame is for one lidar"),
    ],
)
def test_options_that_do_not_go_with_several(arguments: tuple[str, ...], words: str) -> None:
    done = invoke("publish", ONE, TWO, *arguments)
    assert done.exit_code == 2
    assert words in done.stderr.replace("\n", " ")
