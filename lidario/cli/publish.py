"""``lidario publish``: a lidar on the network, as a topic of ROS 2 or under a key of zenoh's, until Ctrl-C.

Nothing of ROS is needed on this machine: a zenoh router carries it, `lidario router` or ROS 2's ``rmw_zenohd``.
"""

from __future__ import annotations

import asyncio
from contextlib import AsyncExitStack, suppress
from typing import Any, Final

import click

import lidario
import lidario.ros
from lidario.basics.words import counted
from lidario.cli.errors import need
from lidario.cli.laserscans import arguments_of, laserscan_options
from lidario.cli.parameters import WholeRange, as_duration, as_place, guard_option, mode_option, sources_argument
from lidario.cli.running import run_until_stopped
from lidario.cli.settings import config_option, is_given, only_with, settings_of_file
from lidario.cli.streams import ReaderGone, beside, emit, message

ROUTER: Final = "tcp/localhost:7447"
BEAMS: Final = 720
"""Of several lidars, where the user says nothing: half a degree each."""


@click.command()
@sources_argument
@click.option("--ros", is_flag=True, help="As a topic of ROS 2, for nodes that run rmw_zenoh_cpp.")
@click.option("--zenoh", "key", metavar="KEY", help="Under this key, for those without ROS: robots/r7/scan.")
@click.option("--raw", is_flag=True, help="With --zenoh: the bytes of the device, a quarter of the size.")
@click.option("--router", default=ROUTER, show_default=True, metavar="ADDRESS", help="The zenoh router.")
@click.option("--robot", metavar="NAME", help="Name of this robot in `lidario devices --zenoh`.  [this machine's]")
@click.option("--topic", default="scan", show_default=True, metavar="NAME", help="Topic of the scans.")
@laserscan_options
@click.option("--domain", default=0, show_default=True, type=WholeRange(0, 232), metavar="N",
              help="ROS_DOMAIN_ID.")  # fmt: skip
@click.option("--distro", default="jazzy", show_default=True,
              type=click.Choice(["humble", "jazzy", "kilted", "lyrical"]),
              help="Release of the other nodes; humble has other keys than all later ones.")  # fmt: skip
@click.option("--namespace", default="/", show_default=True, metavar="NAME", help="Namespace of the node.")
@click.option("--node", default="lidario", show_default=True, metavar="NAME", help="Name of the node.")
@click.option("--mount", "mounts", type=as_place, multiple=True, metavar="X,Y,YAW",
              help="Where the lidar is on the robot, published on /tf_static: metres forward, metres left, degrees "
                   "counter-clockwise. Not needed with a robot description. Of several, once each.")  # fmt: skip
@click.option("--cloud", default="cloud", show_default=True, metavar="NAME",
              help="Of several: topic of the cloud.")  # fmt: skip
@click.option("--base-frame", default="base_link", show_default=True, metavar="NAME",
              help="Coordinate frame of the robot, for --mount and for several lidars.")  # fmt: skip
@click.option("--stamps", type=click.Choice(["now", "recorded"]),
              help="Of a recording: as if it were measured now, or as it was, with /clock for nodes that have "
                   "use_sim_time.  [now]")  # fmt: skip
@click.option("--idle-stop", type=as_duration, metavar="TIME",
              help="Stop laser and motor after this time without a reader, until one comes: 10s.")  # fmt: skip
@config_option
@mode_option
@click.option("--reconnect/--no-reconnect", default=True, show_default=True,
              help="Come back when the lidar is unplugged or restarts.")  # fmt: skip
@guard_option
def publish(
    sources: tuple[str, ...],
    ros: bool,
    key: str | None,
    raw: bool,
    router: str,
    robot: str | None,
    mode: str | int | None,
    idle_stop: float | None,
    reconnect: bool,
    guard: bool,
    **of_ros: Any,
) -> None:
    """Publish live scans over zenoh, until Ctrl-C.

    Either --ros, and `ros2 topic list` shows the topic, or --zenoh KEY, and zenoh:KEY is a SOURCE on every other
    machine. The key is printed. Several lidars, with their mounts, become one scan and one cloud. It waits for a
    router that is not there yet, and goes on when the router restarts.
    """
    sources = sources or ("auto",)
    is_recorded = _check_choice(sources, ros, key, raw, of_ros)
    stamps = of_ros.pop("stamps")
    need("zenoh", "zenoh", "eclipse-zenoh")
    config = settings_of_file()
    told: list[lidario.ros.Publisher | lidario.ros.Share] = []

    async def work() -> None:
        async with AsyncExitStack() as opened:
            openings = [
                lidario.open_lidar(each, reconnect=reconnect, guard=guard, config=config) for each in sources
            ]
            lidars = [await opened.enter_async_context(each) for each in openings]
            publisher: lidario.ros.Publisher | lidario.ros.Share
            if key is not None:
                publisher = lidario.ros.Share(lidars[0], key, raw=raw, router=router, robot=robot)
            else:
                options = {**of_ros, "router": router, "robot": robot}
                publisher = _ros_publisher(lidars, options, stamps, is_recorded=is_recorded)
            names = " and ".join(f"{lidar.info.model} {lidar.info.serial}" for lidar in lidars)
            began = f"publishing {names} through {router}; Ctrl-C ends it"
            await _publish(publisher, mode, idle_stop, began, told)

    try:
        run_until_stopped(work)
    finally:
        for each in told:
            lost = f"; {each.unsent} not sent, because there was no router" if each.unsent else ""
            message(f"{counted(each.scans, 'scan')} published{lost}")


def _ros_publisher(
    lidars: list[lidario.Lidar], options: dict[str, Any], stamps: str | None, *, is_recorded: bool
) -> lidario.ros.Publisher:
    """The publisher of these lidars on topics of ROS 2; `options` are those of --ros, --router and --robot."""
    (lidar, *others), own = lidars, lidars[0].config
    options = arguments_of(options, own.frame)
    mounts, cloud = options.pop("mounts"), options.pop("cloud")
    if others:
        for name in ("order", "preset", "mount_yaw"):
            options.pop(name)
        options["frame_id"] = options.pop("base_frame")
        options["beams"] = options["beams"] or BEAMS
        return lidario.ros.MergedPublisher(lidars, mounts=mounts or None, cloud_topic=cloud, **options)
    mount = mounts[0] if mounts else own.mount
    options["mount"] = mount and (mount.x, mount.y, mount.yaw)
    options["stamps"] = "now" if is_recorded and stamps != "recorded" else "measured"
    return lidario.ros.Publisher(lidar, clock=stamps == "recorded", **options)


async def _publish(
    publisher: lidario.ros.Publisher | lidario.ros.Share,
    mode: str | int | None,
    idle_stop: float | None,
    began: str,
    told: list[lidario.ros.Publisher | lidario.ros.Share],
) -> None:
    there = asyncio.Event()

    def changed(connected: bool) -> None:
        message(publisher.news)
        if connected:
            there.set()

    def named() -> None:
        # Robots need the scans, whether or not somebody reads the key here.
        with suppress(ReaderGone, OSError):
            emit(f"{publisher.key}\n")

    publisher.on_change = changed
    async with publisher:
        if publisher.is_connected:
            there.set()
        told.append(publisher)
        beside(named)
        message(began)
        checking = asyncio.create_task(_check(publisher, there))
        try:
            await publisher.run(mode, idle_stop=idle_stop)
        finally:
            checking.cancel()
            await asyncio.wait([checking])


def _check_choice(sources: tuple[str, ...], ros: bool, key: str | None, raw: bool, of_ros: dict[str, Any]) -> bool:
    """Refuse what does not fit together; whether a recording is published."""
    from lidario.recording.files import file_source

    is_recorded = any(file_source(source) is not None for source in sources)
    _refuse_if(ros == (key is not None), "say one of --ros and --zenoh KEY")
    _refuse_if(raw and ros, "--raw belongs to --zenoh KEY; a topic of ROS 2 has scans")
    only_with("--ros", of_ros, ros)
    only_with("several lidars", ("cloud",), len(sources) > 1)
    mounts = len(of_ros["mounts"])
    _refuse_if(
        of_ros["stamps"] is not None and not is_recorded,
        "--stamps is for a recording: a lidar's stamps are those of its measurements",
    )
    if len(sources) > 1:
        _check_several(len(sources), ros, mounts)
        _refuse_if(is_recorded, "a recording is of another time than the others: publish it alone")
    _refuse_if(len(sources) == 1 and mounts > 1, "more mounts than sources")
    return is_recorded


def _check_several(count: int, ros: bool, mounts: int) -> None:
    _refuse_if(not ros, "several lidars become one with --ros; of --zenoh, publish each under its key")
    _refuse_if(
        mounts not in (0, count), f"{counted(count, 'lidar')} and {counted(mounts, 'mount')}: once --mount for each"
    )
    for name in ("frame", "order", "preset", "mount_yaw", "stamps"):
        said = f"--{name.replace('_', '-')}"
        _refuse_if(is_given(name), f"{said} is for one lidar; several are in the frame of the robot, --base-frame")


def _refuse_if(is_wrong: bool, why: str) -> None:
    if is_wrong:
        raise click.UsageError(why)


async def _check(publisher: lidario.ros.Publisher | lidario.ros.Share, there: asyncio.Event) -> None:
    """Say so where nobody gets what is published, once the router is there."""
    await there.wait()
    if not await publisher.is_passed_on() and publisher.is_connected:
        message(
            f"the router passes nothing on that is published under {publisher.key}: do its access rules let this "
            "robot publish there, and hear that itself?"
        )
