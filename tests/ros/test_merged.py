"""Several lidars as one publisher, and settings that a subscriber sees."""

import asyncio
import math
import signal
from collections.abc import Awaitable, Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import lidario
from lidario import InvalidValue, Mount, read_config
from lidario.basics.model import DeviceInfo, Health, HealthStatus
from lidario.filters import BoxFilter
from lidario.network.bus import Bus
from lidario.ros import MergedPublisher
from lidario.ros.names import DIAGNOSTICS, LASERSCAN, POINTCLOUD2, Node
from lidario.sim.faults import Faults
from lidario.testing import make_scan
from lidario.web.feed import Feed
from lidario.web.masks import Masks
from tests.cli.processes import started
from tests.support.children import BOUND
from tests.support.loop import until
from tests.support.messages import decoded
from tests.support.network import Rig
from tests.support.pages import blocks
from tests.support.router import Router

ONE, TWO = (f"sim://rplidar-c1?via=memory&serial={each * 32}" for each in "AB")
SHOWN = blocks((Path(__file__).parents[2] / "docs" / "several-lidars.md").read_text(encoding="utf-8"))


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
        cloud = decoded(self.clouds[-1].payload, "sensor_msgs/msg/PointCloud2")
        points = np.frombuffer(cloud.data, [(each, "<f4") for each in ("x", "y", "z", "i")] + [("t", "<u4")])
        assert (cloud.header.frame_id, cloud.width) == (frame, len(points))
        left = (abs(points["x"]) < 2.99) & (points["y"] > 0.01)
        assert not left.any()
        assert (points["y"] < -0.5).sum() > 100
        scan = decoded(self.scans[-1].payload)
        assert scan.header.frame_id == frame
        assert len(scan.ranges) == 720
        turned = scan.angle_min + scan.angle_increment * np.arange(720)
        # What filters took out is unknown, and not free.
        assert np.isnan(scan.ranges[abs(turned - 1.57) < 0.3]).all()
        assert np.isfinite(scan.ranges[abs(turned + 1.57) < 0.3]).any()


@pytest.fixture
def settings(tmp_path: Path) -> Path:
    """What a viewer has saved: all on the left of the robot is left out, and all in front on the right is not."""
    path = tmp_path / "lidario.toml"
    path.write_text("".join(f'[lidars.{each * 32}]\nframe = "front"\n' for each in "AB"))
    feeds = [Feed("A", mount=Mount(0.2)), Feed("B", mount=Mount(-0.2, 0.0, math.pi))]
    for feed in feeds:
        feed.info = DeviceInfo("rplidar", "C1M1", 1, "1.0", 1, feed.source * 32)
    masks = Masks(feeds, path)
    assert masks.receive("b-3.000 3.000 0.000 9.000")
    assert masks.receive("save")
    assert masks.said == f"saved in {path}"
    return path


def whole_program(router: Router, settings: Path, front: str, rear: str) -> Callable[[], Awaitable[None]]:
    """The `main` of docs/several-lidars.md, for these lidars."""
    (program,) = (block for block in SHOWN if block.title == "masked_robot.py")
    assert len(program.text.splitlines()) < 30
    text = program.text.removesuffix("lidario.run(main())\n")
    for old, new in (
        ("/dev/ttyUSB0", front),
        ("/dev/ttyUSB1", rear),
        ("lidario.toml", str(settings)),
        ("[front, rear])", f"[front, rear], router={router.address!r})"),
    ):
        assert old in text
        text = text.replace(old, new)
    names: dict[str, Any] = {}
    exec(compile(text, program.title, "exec"), names)
    main: Callable[[], Awaitable[None]] = names["main"]
    return main


@pytest.mark.long
async def test_the_program_of_the_docs(router: Router, settings: Path, capsys: pytest.CaptureFixture[str]) -> None:
    said = list[str]()

    def drives() -> bool:
        # The second lidar may begin later than the first one.
        said.append(capsys.readouterr().out)
        return "drive: " in "".join(said)

    async with Rig(router) as rig:
        heard = Heard(await rig.bus(), 0)
        running = asyncio.ensure_future(whole_program(router, settings, ONE, TWO)())
        await until(lambda: drives() and len(heard.scans) >= 4 and len(heard.clouds) >= 4 and bool(heard.health))
        running.cancel()
        await asyncio.wait([running])
        heard.check()
        names = {
            status.name
            for each in heard.health
            for status in decoded(each.payload, "diagnostic_msgs/msg/DiagnosticArray").status
        }
        assert {name.split()[-1] for name in names} == {"A" * 32, "B" * 32}
    assert capsys.readouterr().out.endswith("stop: the program ends\n")


@pytest.mark.long
@pytest.mark.parametrize(
    ("one", "two", "words"), [("unplug", "", "silent: (0,)"), ("unplug", "silent", "both lidars are silent")]
)
async def test_the_robot_of_the_docs_stands_where_a_lidar_has_failed(
    one: str,
    two: str,
    words: str,
    router: Router,
    settings: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """They fail when it drives, however long that takes."""
    found, begin, said = dict[int, Faults](), Faults.begin, ""

    def begin_noted(faults: Faults, now: int) -> None:
        found[id(faults)] = faults
        begin(faults, now)

    monkeypatch.setattr(Faults, "begin", begin_noted)
    front, rear = (each and f"&fault={each}:1000s" for each in (one, two))
    running = asyncio.ensure_future(whole_program(router, settings, ONE + front, TWO + rear)())
    async with asyncio.timeout(BOUND):
        while "drive: " not in said or words not in said.rpartition("drive: ")[2]:
            await asyncio.sleep(0.1)
            said += capsys.readouterr().out
            if "drive: " in said:
                for each in found.values():
                    each.unplug_s, each.silent_s = each.unplug_s and 0.0, each.silent_s and 0.0
    running.cancel()
    await asyncio.wait([running])


def test_the_settings_of_the_docs_mask_the_body_for_both(tmp_path: Path) -> None:
    (shown,) = (block for block in SHOWN if block.title == "lidario.toml")
    path = tmp_path / shown.title
    path.write_text(shown.text)
    config = read_config(path)
    body = (-0.3, 0.3, -0.25, 0.25)
    for serial, mount in (("AB" * 16, Mount(0.2)), ("CD" * 16, Mount(-0.2, 0.0, math.pi))):
        assert config.of(serial).filters == (BoxFilter(*body, mount=mount),)


@pytest.mark.long
@pytest.mark.parametrize("sources", [(ONE,), (ONE, TWO)], ids=["one", "two"])
async def test_the_command_publishes_with_settings(
    router: Router, settings: Path, sources: tuple[str, ...]
) -> None:
    domain = str(30 + len(sources))
    async with Rig(router) as rig:
        heard = Heard(await rig.bus(), int(domain))
        arguments = ["--ros", "--domain", domain, "--router", router.address, "--config", str(settings)]
        arguments += ["--base-frame", "base"] if len(sources) > 1 else []
        with started("publish", *sources, *arguments) as process:
            await until(lambda: len(heard.scans) > 3 and (len(heard.clouds) > 3 or len(sources) == 1))
            process.send_signal(signal.SIGINT)
            _, said = await asyncio.to_thread(process.communicate, timeout=BOUND)
    assert process.returncode == 0, said
    if len(sources) > 1:
        heard.check("base")
        return
    scan = decoded(heard.scans[-1].payload)
    assert scan.header.frame_id == "front"
    turned = scan.angle_min + scan.angle_increment * np.arange(len(scan.ranges))
    assert not np.isfinite(scan.ranges[abs(turned - 1.57) < 0.3]).any()


@pytest.mark.long
async def test_the_list_of_a_fleet_names_both_and_who_is_away(monkeypatch: pytest.MonkeyPatch) -> None:
    async with lidario.open_lidar(ONE) as one, lidario.open_lidar(TWO + "&fault=unplug:1s", reconnect=True) as two:
        publisher, one_health = MergedPublisher([one, two], mounts=[Mount(), Mount()]), one.health
        info = publisher.status().about.info
        assert (info.model, info.serial) == (f"{one.info.model} and {two.info.model}", f"{'A' * 32} and {'B' * 32}")
        assert publisher.status().lost == ""
        async with two.scans():
            await until(lambda: not two.is_connected)
        assert publisher.status().lost == f"{'B' * 32} is away from its publisher"
        sick = Health(HealthStatus.ERROR, 3)
        monkeypatch.setattr(lidario.Lidar, "health", property(lambda of: sick if of is two else one_health))
        assert publisher.status().about.health == sick


@pytest.mark.long
async def test_who_reads_the_cloud_alone_is_a_reader(router: Router) -> None:
    node, clouds = Node(domain=33), list[Any]()
    async with Rig(router) as rig:
        lidars = [await rig.enter_async_context(lidario.open_lidar(each)) for each in (ONE, TWO)]
        publisher = MergedPublisher(lidars, mounts=[Mount(), Mount()], domain=33, router=router.address)
        await rig.enter_async_context(publisher)
        rig.work(publisher.run(idle_stop=0.2))
        await until(lambda: publisher.scans and lidars[0].mode is None)
        both = await rig.bus()
        leave_cloud = both.subscribe(node.data_key("/cloud", POINTCLOUD2), clouds.append)
        leave_scan = both.subscribe(publisher.key, lambda _: None)
        await until(lambda: len(clouds) > 5)
        leave_scan()
        seen = len(clouds)
        # Three times as long as they would scan for nobody.
        await until(lambda: len(clouds) > seen + 8)
        leave_cloud()
        await until(lambda: lidars[0].mode is None)
        both.subscribe(node.data_key("/cloud", POINTCLOUD2), clouds.append)
        seen = len(clouds)
        await until(lambda: len(clouds) > seen)


async def test_what_is_no_cloud(router: Router) -> None:
    async with lidario.open_lidar(ONE) as lidar:
        publisher = MergedPublisher([lidar], mounts=[Mount()], router=router.address)
        with pytest.raises(InvalidValue, match=r"takes what lidario\.merged\(\) gives"):
            publisher.publish(make_scan([0.0], [1.0]))
