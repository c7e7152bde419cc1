"""The real path, through a whole session: cables pulled, ports shared, programs ended, loops closed."""

from __future__ import annotations

import asyncio
import gc
import os
import subprocess
import sys
import threading
from pathlib import Path

import pytest

from lidario import ConnectFailed, DeviceLost, Lidar, open_lidar
from lidario.sim.serve import PtyServer, TcpServer
from tests.support.devices import FAMILIES, Rig, left_still, make_rig
from tests.support.ports import PATIENCE_S
from tests.support.speeds import SpeedPtyServer


def served(rig: Rig) -> PtyServer:
    return SpeedPtyServer(rig.device, chunk=64)


def quiet(server: PtyServer, rig: Rig) -> bool:
    with server.lock:
        return left_still(rig)


async def until_still(server: PtyServer, rig: Rig) -> None:
    async with asyncio.timeout(PATIENCE_S):
        while not quiet(server, rig):
            await asyncio.sleep(0.01)


async def test_a_port_is_opened_by_one_program_alone() -> None:
    rig = make_rig("rplidar")
    with served(rig) as server:
        async with open_lidar(f"serial://{server.path}?family=rplidar&baud=1000000"):
            with pytest.raises(ConnectFailed, match="busy") as caught:
                await open_lidar(server.path)
            assert caught.value.reason == "busy"
        async with open_lidar(f"serial://{server.path}?family=rplidar&baud=1000000"):
            pass


@pytest.mark.long
@pytest.mark.parametrize("family", FAMILIES)
async def test_scans_over_tcp(family: str) -> None:
    rig = make_rig(family)
    with TcpServer(rig.device) as server:
        async with open_lidar("tcp://{}:{}".format(*server.address)) as lidar:
            async with asyncio.timeout(PATIENCE_S):
                scan = await lidar.scan()
            assert len(scan) > 1000
        async with asyncio.timeout(PATIENCE_S):
            while rig.device.scanning or rig.device.motor_on:
                await asyncio.sleep(0.01)


@pytest.mark.parametrize("family", FAMILIES)
async def test_an_unplugged_lidar_ends_the_stream_at_once(family: str) -> None:
    rig = make_rig(family)
    with served(rig) as server:
        async with open_lidar(f"serial://{server.path}?family={family}&baud={rig.device.baudrate}") as lidar:
            stream = lidar.scans()
            await anext(stream)
            server.unplug()
            # Noticed by the hang-up itself: the watchdog, which is slower, would say that no data came.
            with pytest.raises(DeviceLost, match="unplugged"):
                async with asyncio.timeout(PATIENCE_S):
                    async for _ in stream:
                        pass


@pytest.mark.long
def test_ctrl_c_in_the_middle_of_a_scan_stops_the_motor() -> None:
    rig = make_rig("rplidar")
    program = (
        "import asyncio, sys, lidario\n"
        "async def main():\n"
        "    async with lidario.open_lidar(sys.argv[1]) as lidar:\n"
        "        async for scan in lidar.scans():\n"
        "            print(scan.seq, flush=True)\n"
        "asyncio.run(main())\n"
    )
    with served(rig) as server:
        process = subprocess.Popen(
            [sys.executable, "-c", program, server.path],
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            cwd=Path(__file__).parent.parent,
        )
        assert process.stdout is not None
        # On a busy machine the first scan may be dropped.
        assert process.stdout.readline().strip().isdecimal()
        process.send_signal(2)
        _, errors = process.communicate(timeout=PATIENCE_S)
        assert "KeyboardInterrupt" in errors
        asyncio.run(until_still(server, rig))


ENDS = ["sys.exit(3)", "raise RuntimeError('a bug of mine')", "loop.stop()"]


@pytest.mark.exhaustive("end", sample=ENDS[1:], full=ENDS)
def test_a_program_that_ends_without_closing_still_stops_the_motor(end: str) -> None:
    rig = make_rig("rplidar")
    program = (
        "import asyncio, sys, lidario\n"
        "async def main(loop):\n"
        "    lidar = await lidario.open_lidar(sys.argv[1])\n"
        "    async for scan in lidar.scans():\n"
        f"        {end}\n"
        "loop = asyncio.new_event_loop()\n"
        "task = loop.create_task(main(loop))\n"
        "task.add_done_callback(lambda _: loop.stop())\n"
        "loop.run_forever()\n"
        "loop.close()\n"
    )
    with served(rig) as server:
        process = subprocess.run(
            [sys.executable, "-W", "ignore", "-c", program, server.path],
            capture_output=True,
            text=True,
            timeout=PATIENCE_S,
            cwd=Path(__file__).parent.parent,
            check=False,
        )
        assert process.returncode == (3 if "exit" in end else 0), process.stderr
        asyncio.run(until_still(server, rig))


@pytest.mark.filterwarnings("ignore::ResourceWarning", "ignore::pytest.PytestUnraisableExceptionWarning")
def test_a_closed_loop_does_not_keep_the_motor_on() -> None:
    rig = make_rig("rplidar")
    with served(rig) as server:
        loop = asyncio.new_event_loop()
        lidar: Lidar | None = loop.run_until_complete(open_lidar(server.path).__aenter__())
        assert lidar is not None
        stream = lidar.scans()
        loop.run_until_complete(stream.__anext__())
        loop.close()
        del stream, lidar
        gc.collect()
        asyncio.run(until_still(server, rig))


@pytest.mark.long
async def test_a_lidar_that_nobody_holds_any_more_is_stopped() -> None:
    rig = make_rig("rplidar")
    with served(rig) as server:
        lidar: Lidar | None = await open_lidar(server.path)
        assert lidar is not None
        await anext(lidar.scans())
        lidar = None
        gc.collect()
        for _ in range(3):
            await asyncio.sleep(0)
        await until_still(server, rig)
        # The new session cannot know that the device is deaf for 10 ms after the STOP of the old one.
        await asyncio.sleep(0.02)
        async with open_lidar(server.path) as again:
            assert len(await again.scan()) > 1000


@pytest.mark.long
@pytest.mark.exhaustive("times", sample=[1], full=[2])
@pytest.mark.parametrize("family", FAMILIES)
async def test_opening_and_closing_leaves_nothing_behind(family: str, times: int) -> None:
    before = threading.active_count(), len(os.listdir("/dev/fd"))
    for _ in range(times):
        async with open_lidar(f"sim://{'rplidar-s2' if family == 'rplidar' else 'ydlidar-4ros'}") as lidar:
            await lidar.scan()
    assert (threading.active_count(), len(os.listdir("/dev/fd"))) == before
    assert asyncio.all_tasks() == {asyncio.current_task()}
