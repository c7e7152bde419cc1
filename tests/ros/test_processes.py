"""Processes through a router: each is killed, and so is the router; who is left goes on, or says who is gone."""

import asyncio
import contextlib
import json
import os
import signal
import subprocess
import sys
from collections.abc import Iterator

import pytest

import lidario
from lidario.errors import DeviceLost
from lidario.network.bus import Bus
from lidario.network.keys import parse_token, tokens_of
from lidario.ros import Fleet, Share, list_remote_lidars
from tests.cli.processes import started
from tests.session.test_forked_child import REFUSED, exit_code_in_a_child
from tests.support.children import FORKS, line_of
from tests.support.router import Router, free_address

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


FORKED = (
    FORKS
    + """
import asyncio, gc, os, sys
import lidario
from lidario.network.router import Router
from lidario.ros import Fleet, Share

address, ends = sys.argv[1:]
loop, held = asyncio.new_event_loop(), []

async def main():
    held.append(await Router.open(address))
    held.append(Fleet("a/*", router=address))
    await held[-1].start()
    lidar = await lidario.open_lidar("sim://rplidar-s2?via=memory")
    held.append(Share(lidar, "a/b", router=address))
    await held[-1].start()
    held.append(await lidario.open_lidar(f"zenoh:a/b?router={address}"))
    return lidar

async def close():
    for each in reversed(held):
        await each.close()

lidar = loop.run_until_complete(main())
child = os.fork()
if child == 0:
    if ends == "closes":
        loop.run_until_complete(close())
    if ends != "exits":
        held.clear()
        gc.collect()
    sys.exit(7)
assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == 7

async def go_on():
    scan = await lidar.scan()
    held[2].publish(scan)
    return await anext(held[1])

print(loop.run_until_complete(go_on()).key, flush=True)
loop.run_until_complete(close())
"""
)


@pytest.mark.long
@pytest.mark.parametrize("ends", ["exits", "drops", "closes"])
def test_a_forked_child_ends_and_its_parent_goes_on(ends: str) -> None:
    """It has none of zenoh's threads, and waited for ever for them: also where it only dropped a session."""
    command = [sys.executable, "-c", FORKED, free_address(), ends]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True, start_new_session=True) as program:
        try:
            assert program.communicate(timeout=BOUND_S)[0] == "a/b\n"
            assert program.returncode == 0
        finally:
            with contextlib.suppress(ProcessLookupError):
                os.killpg(program.pid, signal.SIGKILL)


async def test_a_child_that_is_forked_in_a_coroutine_reads_nothing_and_leaves_its_blocks(router: Router) -> None:
    """Also where a publisher still waits for its router."""
    async with (
        lidario.open_lidar("sim://rplidar-s2?via=memory") as lidar,
        Fleet("a/*", router=router.address) as fleet,
        Share(lidar, "a/b", router=router.address) as share,
        Share(lidar, "a/c", router=free_address()) as waiting,
    ):
        assert exit_code_in_a_child([lambda: anext(fleet)], refused=True) == REFUSED
        assert exit_code_in_a_child([waiting.close, share.close, fleet.close], refused=False) == REFUSED
        share.publish(await lidar.scan())
        assert (await anext(fleet)).key == "a/b"
