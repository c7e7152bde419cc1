"""Processes through a router: each is killed, and so is the router; who is left goes on, or says who is gone."""

from __future__ import annotations

import asyncio
import contextlib
import json
import signal
import subprocess
import sys
from collections.abc import Iterator

import pytest

import lidario
from lidario.errors import DeviceLost
from lidario.network.bus import Bus
from lidario.network.keys import parse_token, tokens_of
from lidario.ros import list_remote_lidars
from tests.cli.processes import started
from tests.support.children import line_of
from tests.support.router import Router

BOUND_S = 30.0


@contextlib.contextmanager
def publishing(tape: str, router: Router, *arguments: str) -> Iterator[subprocess.Popen[str]]:
    with started("publish", f"{tape}?loop=1", "--router", router.address, *arguments) as process:
        assert line_of(process.stdout).strip()
        assert "publishing" in line_of(process.stderr)
        yield process


async def said(process: subprocess.Popen[str]) -> str:
    """The next line that it says; a thread waits for it, since zenoh needs the event loop."""
    return await asyncio.to_thread(line_of, process.stderr)


@pytest.mark.long
async def test_each_is_killed_and_the_router_restarts(tape: str) -> None:
    """A killed reader disturbs nobody. Scans go on after the router is back. A killed publisher is gone at once."""
    router = Router()
    tokens: dict[str, bool] = {}
    source = f"zenoh:robots/r1/scan?router={router.address}"
    try:
        with (
            publishing(tape, router, "--zenoh", "robots/r1/scan", "--raw", "--robot", "r1") as publisher,
            started("scan", source, "--json", "-n", "0") as reader,
        ):
            watcher = await Bus.open(router.address)
            watcher.watch_tokens(tokens_of("**"), tokens.__setitem__)
            async with asyncio.timeout(BOUND_S), lidario.open_lidar(source) as lidar, lidar.scans() as scans:
                assert json.loads(await asyncio.to_thread(line_of, reader.stdout))["mode"] == "DenseBoost"
                reader.send_signal(signal.SIGKILL)
                before = await anext(scans)
                router.stop()
                assert "is lost; scans are not sent until it is back" in await said(publisher)
                router.start()
                assert "is back" in await said(publisher)
                while (await anext(scans)).stamp_ns <= before.stamp_ns + 10**9:
                    pass
                (token,) = (token for token, alive in tokens.items() if alive)
                assert parse_token(token) == ("robots/r1/scan", "raw", "r1", "RPLIDAR_S2M1", lidar.info.serial)
                publisher.send_signal(signal.SIGKILL)
                with pytest.raises(DeviceLost, match="its publisher has ended or cannot be reached"):
                    async for _ in scans:
                        pass
                assert not tokens[token]
            assert await list_remote_lidars(router.address) == []
            await watcher.close()
    finally:
        router.stop()


LEFT = """
import asyncio, sys
from lidario.network.bus import Bus

async def main():
    bus = await Bus.open(sys.argv[1])
    bus.watch_readers(bus.sender("left", b""), print)
    bus.subscribe("left", print)
    bus.watch_tokens("left", print)
    bus.respond("left", bytes)
    return bus

left = asyncio.run(main())
sys.exit(3)
"""


@pytest.mark.long
def test_a_program_ends_that_has_not_closed_its_bus(router: Router) -> None:
    """A thread of zenoh's for each subscription kept it from ending."""
    with subprocess.Popen([sys.executable, "-c", LEFT, router.address]) as program:
        try:
            assert program.wait(BOUND_S) == 3
        finally:
            program.kill()
