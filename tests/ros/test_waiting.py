"""Robots and routers are started in any order: a publisher waits for a router that is not there yet."""

import asyncio
import logging
import os
import re
import signal
from collections.abc import Iterator
from typing import Any

import pytest

import lidario
from lidario.errors import ConnectFailed, LocalProtocolError
from lidario.network.bus import Bus
from lidario.ros import Share
from tests.cli.processes import invoke, served
from tests.scans.test_scan import FOUR
from tests.support import children
from tests.support.children import BOUND, line_of
from tests.support.children import until as soon
from tests.support.loop import until
from tests.support.network import publisher_of
from tests.support.router import Router

SIM = "sim://rplidar-s2?via=memory"
UNKNOWN = f"tcp/{'a' * 64}:7447"
"""No name has a part as long as this one, so that no network is asked."""


@pytest.fixture
def absent() -> Iterator[Router]:
    """A router that is not there yet; the test starts it."""
    made = Router()
    made.stop()
    yield made
    made.stop()


@pytest.mark.long
@pytest.mark.parametrize("form", ["ros", "scan", "raw"])
async def test_a_publisher_waits_for_its_router(absent: Router, form: str) -> None:
    device = lidario.simulate("rplidar-s2", spin_up=0)
    changes: list[tuple[bool, str]] = []
    async with lidario.open_lidar(device) as lidar:
        publisher = publisher_of(lidar, form, "late/scan", absent.address)
        publisher.on_change = lambda connected: changes.append((connected, publisher.news))
        async with publisher:
            assert changes == [
                (
                    False,
                    f"no zenoh router responds at {absent.address}. Start one: lidario router, or ros2 run "
                    "rmw_zenoh_cpp rmw_zenohd\nScans are not sent until it is there.",
                )
            ]
            assert not publisher.is_connected
            running = asyncio.create_task(publisher.run())
            await until(lambda: publisher.unsent >= 2)
            assert publisher.scans == 0
            absent.start()
            await until(lambda: publisher.scans)
            assert changes[1:] == [(True, f"the zenoh router at {absent.address} is there")]
            remote = await lidario.open_lidar(f"zenoh:{publisher.key}?router={absent.address}")
            async with remote, remote.scans() as scans, asyncio.timeout(BOUND):
                assert len(await anext(scans)) > 1000
            with pytest.raises(LocalProtocolError, match="can be started once"):
                await publisher.start()
            running.cancel()
            await asyncio.wait([running])


async def test_nobody_listens_to_the_news(absent: Router, caplog: pytest.LogCaptureFixture) -> None:
    """Closing ends the waiting; a scan that was not sent is counted."""
    async with lidario.open_lidar(SIM) as lidar:
        before = asyncio.all_tasks()
        with caplog.at_level(logging.WARNING, "lidario"):
            async with Share(lidar, "late/scan", router=absent.address) as share:
                share.publish(FOUR)
        assert (share.scans, share.unsent) == (0, 1)
        (told,) = caplog.messages
        assert told.startswith("no zenoh router responds at")
        assert told.endswith("rmw_zenohd. Scans are not sent until it is there.")
        assert asyncio.all_tasks() == before
        await share.close()


@pytest.mark.long
async def test_what_is_not_declared_leaves_no_connection(absent: Router, monkeypatch: pytest.MonkeyPatch) -> None:
    """The router went away between the two steps: it is waited for, and nothing stays open of the first attempt."""
    absent.start()
    closed: list[Bus] = []
    close_soon, token = Bus.close_soon, Bus.token

    def close(bus: Bus) -> None:
        closed.append(bus)
        close_soon(bus)

    monkeypatch.setattr(Bus, "close_soon", close)
    attempts = iter([False])

    def fail(bus: Bus, key: str) -> None:
        if next(attempts, True):
            token(bus, key)
        else:
            raise ConnectFailed("the zenoh session failed", reason="refused")

    monkeypatch.setattr(Bus, "token", fail)
    async with lidario.open_lidar(SIM) as lidar:
        async with Share(lidar, "late/again", raw=True, router=absent.address) as share:
            assert not share.is_connected
            assert len(closed) == 1
            await until(lambda: share.is_connected)
        assert len(closed) == 1


@pytest.mark.parametrize("words", ["devices --zenoh --router {}", "info zenoh:a?router={}"])
def test_no_router_is_told_with_its_cure(words: str) -> None:
    address = "tcp/127.0.0.1:1"
    done = invoke(*words.format(address).split(), code=3)
    assert done.stderr.startswith(f"error: no zenoh router responds at {address}. Start one: lidario router")


def test_the_command_ends_where_the_host_is_unknown() -> None:
    done = invoke("publish", SIM, "--ros", "--router", UNKNOWN, code=3)
    assert done.stderr.startswith("error: ")
    assert "host" in done.stderr


@pytest.mark.long
@pytest.mark.parametrize("unread", ["", "stdout", "stderr"])
def test_ctrl_c_while_it_waits_leaves_laser_and_motor_off(absent: Router, unread: str) -> None:
    """Also where nobody reads what is said: on a pipe without a reader, as of a script, and on a full disk."""
    reader, writer = os.pipe()
    os.close(reader)
    with served("rplidar-s2") as server, open("/dev/full", "wb", buffering=0) as full:
        command = ("-m", "lidario", "publish", server.path, "--zenoh", "late/scan", "--router", absent.address)
        streams: dict[str, Any] = {unread: writer if unread == "stdout" else full} if unread else {}
        with children.started(*command, **streams) as process:
            os.close(writer)
            assert unread == "stdout" or line_of(process.stdout) == "late/scan\n"
            soon(lambda: server.device.scanning)
            process.send_signal(signal.SIGINT)
            _, said = process.communicate(timeout=BOUND)
            assert process.returncode == 0
            if unread != "stderr":
                assert said.startswith(f"no zenoh router responds at {absent.address}. Start one")
                assert "\nScans are not sent until it is there.\npublishing RPLIDAR" in said
                assert re.search(r"\n0 scans published(; \d+ not sent, because there was no router)?\n$", said)
        soon(lambda: not server.device.scanning and not server.device.motor_on)
