"""A simulated lidar that is published through a router, and its readers."""

import asyncio
from collections.abc import Coroutine, Iterable
from contextlib import AsyncExitStack
from typing import Any

import pytest

import lidario
from lidario.families.ydlidar.simulated.device import Simulated4Ros
from lidario.network.bus import Bus
from lidario.network.keys import Sender
from lidario.ros import Publisher, Share
from lidario.scans.scan import Scan
from tests.support.router import Router

BOUND_S = 30.0
MODELS = {"rplidar": "rplidar-s2", "ydlidar": "ydlidar-4ros"}


def zid_in(tokens: Iterable[str]) -> str:
    """The id of the session that has declared a token of ROS 2, as zenoh prints it."""
    return next(iter(tokens)).split("/")[2]


def publisher_of(lidar: lidario.Lidar, form: str, key: str, router: str) -> Publisher | Share:
    """What publishes under that key, or as a topic of that name: "scan", "raw" or "ros"."""
    if form == "ros":
        return Publisher(lidar, topic=key, router=router)
    return Share(lidar, key, raw=form == "raw", router=router)


def publish_in_vain(publisher: Publisher | Share, scan: Scan) -> None:
    """Publish a scan that is lost on its way: zenoh drops it without a word, as it does where a line is busy."""

    def send(sender: Sender, payload: bytes) -> bool:
        sender.sent += 1
        return True

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Sender, "send", send)
        publisher.publish(scan)


class Rig(AsyncExitStack):
    """A simulated lidar that is open, and a list of its scans; what is entered and opened ends with it."""

    def __init__(self, router: Router) -> None:
        super().__init__()
        self.router = router.address
        self.sent: list[Scan] = []

    async def bus(self) -> Bus:
        """Another client of the router."""
        bus = await Bus.open(self.router)
        self.push_async_callback(bus.close)
        return bus

    async def open(self, device: str | lidario.SimulatedDevice = "rplidar") -> lidario.Lidar:
        """Of a family, or this one."""
        if isinstance(device, str):
            device = lidario.simulate(MODELS[device], spin_up=0)
            if isinstance(device, Simulated4Ros):
                device.zero_offset = 42
        return await self.enter_async_context(lidario.open_lidar(device))

    def work(self, doing: Coroutine[Any, Any, None]) -> asyncio.Task[None]:
        """Do this in a task, until the end."""
        task = asyncio.create_task(doing)

        async def end() -> None:
            task.cancel()
            await asyncio.wait([task])

        self.push_async_callback(end)
        return task

    def run(self, publisher: Publisher | Share) -> None:
        """Publish all scans of its lidar in a task."""

        async def publish() -> None:
            async with publisher.lidar.scans(depth=64) as stream:
                async for scan in stream:
                    self.sent.append(scan)
                    publisher.publish(scan)

        self.work(publish())

    async def share(self, key: str, *, raw: bool = False, lidar: lidario.Lidar | None = None) -> Share:
        """Publish this lidar under ``KEY``, or one that is opened for it; `run` publishes its scans."""
        lidar = await self.open() if lidar is None else lidar
        return await self.enter_async_context(Share(lidar, key, raw=raw, router=self.router))

    async def remote(self, key: str, *, reconnect: bool = False) -> lidario.Lidar:
        """A session with ``zenoh:KEY``."""
        source = f"zenoh:{key}?router={self.router}"
        return await self.enter_async_context(lidario.open_lidar(source, reconnect=reconnect))

    async def read(self, key: str, *, reconnect: bool = False) -> tuple[lidario.Lidar, lidario.ScanStream]:
        """A session with ``zenoh:KEY``, and a stream of it."""
        lidar = await self.remote(key, reconnect=reconnect)
        return lidar, await self.enter_async_context(lidar.scans(depth=64))

    async def take(self, key: str, count: int) -> tuple[lidario.Lidar, list[Scan]]:
        """So many scans of ``zenoh:KEY``."""
        lidar, stream = await self.read(key)
        async with asyncio.timeout(BOUND_S):
            return lidar, [await anext(stream) for _ in range(count)]
