"""Coming back through the kernel, at true pace: a link, another name, a port that is held, a network connection.

What happens at each step is in `test_reconnect` on a driven clock. Here the threads, the kernel and the clock are
real, and so are the names of ports.
"""

import asyncio
import time
from pathlib import Path

import pytest
import serial

from lidario import DeviceLost, Reconnect, open_lidar
from lidario.port.background import run_in_thread
from lidario.session.finding.discovery import PortInfo
from tests.cli.processes import served
from tests.support.cable import next_after
from tests.support.children import is_still, requests, until
from tests.support.devices import make_rig, scanning
from tests.support.replug import ReplugTcpServer
from tests.support.terminals import WaitingPtyServer

pytestmark = [pytest.mark.long, pytest.mark.real_time]
BOUND_S = 30.0
BOOT_S = 0.2
GAP_S = 0.2


async def replugged(server: WaitingPtyServer | ReplugTcpServer) -> float:
    """Pull the cable out, and put it in again after a while; when that was begun."""
    await run_in_thread(lambda: server.replug(GAP_S))
    return time.monotonic()


@pytest.mark.parametrize(("family", "relative"), [("rplidar", False), ("ydlidar", False), ("rplidar", True)])
async def test_it_is_found_again_through_a_link(
    family: str, relative: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Also where its path was relative, and the program has gone to another folder, as a daemon does."""
    device = make_rig(family).device
    device.boot_s = BOOT_S
    path = tmp_path / "usb-CP2102_0001-if00-port0"
    with WaitingPtyServer(device) as server:
        server.link(path)
        monkeypatch.chdir(tmp_path)
        source = path.name if relative else str(path)
        async with open_lidar(source, family=family, reconnect=True) as lidar, lidar.scans() as stream:
            monkeypatch.chdir("/")
            last = await anext(stream)
            name = server.path
            pulled = await replugged(server)
            await run_in_thread(lambda: until(server.plugged.is_set))
            assert server.path != name
            scan = await next_after(stream, pulled)
            assert scan.seq > last.seq + 2
            assert lidar.stats.reconnects == 1
        until(lambda: is_still(server))


@pytest.mark.parametrize("by", ["id", "path"])
async def test_under_another_name_held_a_while_beside_other_ports(by: str, monkeypatch: pytest.MonkeyPatch) -> None:
    device = make_rig("rplidar").device
    device.boot_s = BOOT_S
    with WaitingPtyServer(device) as server, served("rplidar-s1") as bystander:
        first = server.path

        def listed() -> list[PortInfo]:
            paths = [bystander.path, *([server.path] if server.plugged.is_set() else [])]
            return [PortInfo(path, "", "CP2102", "") for path in paths]

        monkeypatch.setattr("lidario.session.finding.discovery.list_serial_ports", listed)
        source = f"id:{device.serial.hex()}" if by == "id" else first
        async with open_lidar(source, reconnect=True) as lidar, scanning(lidar) as stream:
            asked = len(requests(bystander))
            pulled = await replugged(server)
            await run_in_thread(lambda: until(server.plugged.is_set))
            assert server.path != first
            with serial.Serial(server.path, exclusive=True):
                # Another program looks at the new port first, as ModemManager does.
                await asyncio.sleep(BOOT_S + 0.4)
                assert not lidar.is_connected
            await next_after(stream, pulled)
            assert len(requests(bystander)) == asked, "a port that was there all the time is not written to"
            # And once more: now it is known where it was last.
            await next_after(stream, await replugged(server))
            assert lidar.stats.reconnects == 2
        until(lambda: is_still(server))


async def test_two_that_change_their_names_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    rigs = [make_rig("rplidar", seed=seed) for seed in (1, 2)]
    for rig in rigs:
        rig.device.boot_s = BOOT_S
    with WaitingPtyServer(rigs[0].device) as one, WaitingPtyServer(rigs[1].device) as two:

        def listed() -> list[PortInfo]:
            return [PortInfo(each.path, "", "CP2102", "") for each in (one, two) if each.plugged.is_set()]

        monkeypatch.setattr("lidario.session.finding.discovery.list_serial_ports", listed)
        policy = Reconnect(limit_s=BOUND_S)
        async with (
            open_lidar(one.path, family="rplidar", reconnect=policy) as a,
            open_lidar(two.path, family="rplidar", reconnect=policy) as b,
        ):
            streams = a.scans(), b.scans()
            await asyncio.gather(*(anext(stream) for stream in streams))
            pulled = max(await asyncio.gather(*map(replugged, (one, two))))
            await asyncio.gather(*(next_after(stream, pulled) for stream in streams))
            assert [each.info.serial for each in (a, b)] == [rig.device.serial.hex().upper() for rig in rigs]
        until(lambda: is_still(one) and is_still(two))


async def test_a_network_connection_that_was_closed() -> None:
    device = make_rig("ydlidar").device
    device.boot_s = BOOT_S
    with ReplugTcpServer(device) as server:
        source = "tcp://{}:{}".format(*server.address)
        async with open_lidar(source, family="ydlidar", reconnect=True) as lidar, scanning(lidar) as stream:
            await next_after(stream, await replugged(server))
            assert lidar.stats.reconnects == 1
        until(lambda: not device.scanning)


@pytest.mark.parametrize("via", ["pty", "tcp"])
async def test_a_simulated_source_ends_with_the_session(via: str) -> None:
    source = f"sim://rplidar-s2?via={via}&fault=unplug:1s"
    async with open_lidar(source, reconnect=Reconnect(limit_s=0.3)) as lidar:
        with pytest.raises(DeviceLost, match=r"did not come back within 0\.3 s"):
            async with asyncio.timeout(BOUND_S):
                await lidar.scan()


async def test_a_session_that_is_closed_while_it_is_away_leaves_nothing() -> None:
    async with open_lidar("sim://rplidar-s2?fault=replug:1s", reconnect=True) as lidar:
        async with asyncio.timeout(BOUND_S):
            while lidar.is_connected:
                await asyncio.sleep(0.01)
