"""Through a router: who is not there, or does not respond, is told, and nothing is waited for without a bound."""

import asyncio
import socket
from pathlib import Path
from typing import Any

import pytest

import lidario
from lidario.errors import ConnectFailed, InvalidValue, SessionClosed
from lidario.network.bus import Bus
from lidario.network.keys import Token, token_key
from lidario.ros import Fleet, Share
from tests.support.network import BOUND_S
from tests.support.refused import refused
from tests.support.router import Router, client


async def test_nobody(router: Router, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("lidario.network.connect.WAIT_S", 0.05)
    with refused("missing", "no lidar is published under nothing/here") as caught:
        await lidario.open_lidar(f"zenoh:nothing/here?router={router.address}")
    assert f"`lidario devices --zenoh --router {router.address}` lists" in str(caught.value)


async def test_a_router_that_says_nothing_is_given_up(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("lidario.network.bus.OPEN_S", 0.05)
    with socket.create_server(("127.0.0.1", 0)) as server:
        async with asyncio.timeout(BOUND_S):
            with pytest.raises(ConnectFailed, match="no zenoh router responds") as caught:
                await Bus.open(f"tcp/127.0.0.1:{server.getsockname()[1]}")
    assert caught.value.reason == "refused"


async def test_a_publisher_that_does_not_respond_is_not_waited_for(router: Router) -> None:
    """It takes the request and keeps it."""
    silent, asking = client(router.address), await Bus.open(router.address)
    kept: list[Any] = []
    silent.declare_queryable("silent/key", kept.append)
    async with asyncio.timeout(BOUND_S):
        while not kept:
            assert await asking.query("silent/key", 0.05) == []
    for query in kept:
        query.drop()
    silent.close()  # type: ignore[no-untyped-call]
    await asking.close()


async def test_a_configuration_is_taken(router: Router, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("ZENOH_CONFIG", str(tmp_path / "client.json5"))
    with pytest.raises(InvalidValue, match=r"or ZENOH_CONFIG=.* is no configuration of zenoh"):
        await Bus.open(router.address)
    (tmp_path / "client.json5").write_text('{id: "abc123", mode: "peer"}')
    bus = await Bus.open(router.address)
    assert bus.id == "abc123"
    await bus.close()


async def test_a_configuration_without_a_name_is_none(router: Router, monkeypatch: pytest.MonkeyPatch) -> None:
    """A service manager or a container may set a variable to nothing."""
    monkeypatch.setenv("ZENOH_CONFIG", "")
    async with await Bus.open(router.address) as bus:
        assert bus.is_connected


async def test_no_exception_of_zenoh_leaves(router: Router) -> None:
    bus = await Bus.open(router.address)
    for call in (
        lambda: bus.sender("a//b", bytes(16)),
        lambda: bus.token("a/**/**x"),
        lambda: bus.subscribe("", print),
        lambda: bus.watch_tokens("a//b", print),
    ):
        # Nor the place in its source.
        with pytest.raises(
            ConnectFailed, match=r"session with .* failed: Invalid Key Expr `.*`: .*[a-z$`]$"
        ) as caught:
            call()
        assert ".rs" not in str(caught.value)
    with pytest.raises(ConnectFailed, match=r"failed: .*forbidden, as well as leading and trailing slashes$"):
        await bus.query("a//b", 1.0)
    await bus.close()
    await bus.close()
    with pytest.raises(ConnectFailed, match=r"the zenoh session with .* failed"):
        await bus.tokens("a", 1.0)


async def test_cancelling_an_opening_leaves_nothing(router: Router) -> None:
    opening = asyncio.ensure_future(lidario.open_lidar(f"zenoh:nothing/there?router={router.address}").__aenter__())
    await asyncio.sleep(0.05)  # anywhere on the way: wherever that is, nothing may be left
    opening.cancel()
    with pytest.raises(asyncio.CancelledError):
        await opening


@pytest.mark.parametrize("makes", ["fleet", "share"])
@pytest.mark.parametrize("second", ["start", "close"])
async def test_two_tasks_that_start_and_close_one_leave_nothing_open(
    makes: str, second: str, router: Router, monkeypatch: pytest.MonkeyPatch
) -> None:
    opened, open_bus = list[Bus](), Bus.open

    async def kept(address: str) -> Bus:
        opened.append(await open_bus(address))
        return opened[-1]

    monkeypatch.setattr(Bus, "open", kept)
    async with lidario.open_lidar("sim://rplidar-s2?via=memory") as lidar:
        made = (
            Fleet("a/*", router=router.address) if makes == "fleet" else Share(lidar, "a/b", router=router.address)
        )
        starting = asyncio.create_task(made.start())
        await asyncio.sleep(0)
        found = await asyncio.gather(
            starting, made.start() if second == "start" else made.close(), return_exceptions=True
        )
        assert [*map(type, found)].count(SessionClosed) == found.count(None) == 1
        await made.close()
    assert len(opened) == (2 if second == "start" else 1)
    for bus in opened:
        with pytest.raises(ConnectFailed, match=r"the zenoh session with .* failed"):
            await bus.tokens("a", 1.0)


async def test_a_publisher_that_is_closed_while_no_router_responds_waits_for_none() -> None:
    async with lidario.open_lidar("sim://rplidar-s2?via=memory") as lidar:
        share = Share(lidar, "a/b", router="tcp/127.0.0.1:1")
        starting = asyncio.create_task(share.start())
        await asyncio.sleep(0)
        await share.close()
        with pytest.raises(SessionClosed, match="another task has closed the publisher"):
            await starting
    assert asyncio.all_tasks() == {asyncio.current_task()}


async def test_a_publisher_that_hangs_is_not_nobody(router: Router, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("lidario.network.connect.WAIT_S", 0.05)
    monkeypatch.setattr("lidario.network.connect.TOKENS_S", BOUND_S)  # a busy machine lists them late
    bus = await Bus.open(router.address)
    bus.token(token_key(Token("hung/scan", "scan", "r9", "S2", "1")))
    with refused("silent", r"zenoh:hung/scan is published by r9, which does not respond"):
        await lidario.open_lidar(f"zenoh:hung/scan?router={router.address}")
    await bus.close()
