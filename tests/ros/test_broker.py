"""`lidario router` and its engine: zenoh's own clients meet there."""

import os
import signal
from pathlib import Path
from typing import IO

import pytest

from lidario.cli.router import is_private
from lidario.errors import InvalidValue
from lidario.network.bus import Bus
from lidario.network.router import LOOPBACK, Router
from tests.cli.processes import started
from tests.support.children import BOUND, child, line_of
from tests.support.refused import refused
from tests.support.router import Router as Running
from tests.support.router import client, free_address


def rest_of(stream: IO[str] | None) -> str:
    assert stream is not None
    return stream.read()


async def test_only_this_machine_reaches_it_by_default(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("ZENOH_CONFIG", raising=False)
    assert LOOPBACK == "tcp/127.0.0.1:7447"
    address = free_address()
    monkeypatch.setattr("lidario.network.router.LOOPBACK", address)
    async with await Router.open() as router:
        assert router.addresses == (address,)


NEVER_CLOSED = """
import asyncio, sys
from lidario.network.bus import Bus
from lidario.ros import Fleet, Router

async def main():
    global router, bus, fleet
    if "routes" in sys.argv:
        router = await Router.open(sys.argv[1])
    bus = await Bus.open(sys.argv[1])
    bus.watch_readers(bus.sender("left", b""), bool)
    bus.subscribe("left", bool)
    bus.watch_tokens("left", bool)
    bus.respond("left", bytes)
    fleet = Fleet("flood/**", router=sys.argv[1])
    await fleet.start()
    while "routes" not in sys.argv and not fleet.bad_messages:
        await asyncio.sleep(0.01)

asyncio.run(main())
"""


@pytest.mark.long
def test_a_program_that_never_closes_its_router_ends() -> None:
    """Nor its connection: a thread of zenoh's for each subscription kept it from ending."""
    with child(NEVER_CLOSED, free_address(), "routes") as process:
        said, errors = process.communicate(timeout=BOUND)
    assert (process.returncode, said, errors) == (0, "", "")


@pytest.mark.long
@pytest.mark.parametrize("_", range(3))
def test_a_program_that_never_closes_its_connection_ends_while_messages_come(router: Running, _: int) -> None:
    """What comes behind the end of the interpreter would abort it, half of the times."""
    writer = client(router.address)
    publisher = writer.declare_publisher("flood/x")
    with child(NEVER_CLOSED, router.address) as process:
        while process.poll() is None:
            publisher.put(bytes(100))
        said, errors = process.communicate(timeout=BOUND)
    writer.close()  # type: ignore[no-untyped-call]
    assert (process.returncode, said, errors) == (0, "", "")


async def test_a_place_that_is_taken() -> None:
    address = free_address()
    async with await Router.open(address):
        with refused("busy", "another program listens there already"):
            await Router.open(address)


@pytest.mark.parametrize("address", ["tcp/192.0.2.1:7447", "tls/127.0.0.1:7447"])
async def test_a_place_where_it_cannot_listen(address: str) -> None:
    with refused("source", "no router can listen at") as caught:
        await Router.open(address)
    assert "/root" not in str(caught.value)
    assert ".rs:" not in str(caught.value)


@pytest.mark.parametrize("address", ["tcp/127.0.0.1:7447?", "tcp/127.0.0.1:7447#"])
async def test_an_address_that_zenoh_cannot_read(address: str) -> None:
    """It has the sign of more to come, and nothing behind it."""
    with pytest.raises(InvalidValue, match="is not where a router can listen"):
        await Router.open(address)


@pytest.mark.long
async def test_a_configuration_says_where(tmp_path: Path) -> None:
    address = free_address()
    file = tmp_path / "router.json5"
    listen = f'listen: {{ endpoints: ["{address}"] }}'
    file.write_text(f'{{ mode: "client", {listen}, scouting: {{ multicast: {{ enabled: false }} }} }}')
    async with await Router.open(config=file) as router:
        assert router.addresses == (address,)
    for text in ("{ nonsense", '{ unheard_of: "field" }'):
        file.write_text(text)
        with pytest.raises(InvalidValue, match="is no configuration of zenoh") as caught:
            await Router.open(config=file)
        assert ".rs" not in str(caught.value)


async def test_a_configuration_that_says_where_peers_listen_and_not_routers(tmp_path: Path) -> None:
    file = tmp_path / "peer.json5"
    file.write_text(f'{{ listen: {{ endpoints: {{ peer: ["{free_address()}"] }} }} }}')
    async with await Router.open(config=file) as router:
        assert router.addresses == ()


async def test_a_configuration_that_is_a_pipe_is_not_waited_for(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """zenoh read it for ever, and neither Ctrl-C nor SIGTERM ended the program."""
    os.mkfifo(tmp_path / "pipe.json5")
    with pytest.raises(InvalidValue, match=r"pipe\.json5 is no configuration of zenoh: it is a pipe"):
        await Router.open(config=tmp_path / "pipe.json5")
    monkeypatch.setenv("ZENOH_CONFIG", str(tmp_path / "pipe.json5"))
    for opening in (Router.open(), Bus.open()):
        with pytest.raises(InvalidValue, match="it is a pipe"):
            await opening


@pytest.mark.long
def test_the_command_serves_until_ctrl_c() -> None:
    address = free_address()
    with started("router", "--listen", address) as process:
        assert line_of(process.stdout) == f"{address}\n"
        client(address).close()  # type: ignore[no-untyped-call]
        process.send_signal(signal.SIGINT)
        assert process.wait(BOUND) == 0
        told = rest_of(process.stderr)
    assert "a zenoh router, until Ctrl-C" in told
    # As it is printed, it reaches this router and not another one.
    assert f"lidario publish --zenoh robots/r7/scan --router {address}\n" in told
    assert "may publish and read" not in told


@pytest.mark.long
def test_the_command_says_who_may_reach_it() -> None:
    port = free_address().rpartition(":")[2]
    with started("router", "--listen", f"tcp/0.0.0.0:{port}") as process:
        line_of(process.stdout)
        process.send_signal(signal.SIGTERM)
        process.wait(BOUND)
        assert "may publish and read: --config FILE names who may" in rest_of(process.stderr)


@pytest.mark.parametrize(
    ("address", "private"),
    [
        ("tcp/127.0.0.1:7447", True),
        ("tcp/127.3.2.1:7447#iface=lo", True),
        ("tls/[::1]:7447", True),
        ("tcp/localhost:7447", True),
        ("unixsock-stream//run/zenoh.sock", True),
        ("unixpipe//run/zenoh", True),
        ("tcp/0.0.0.0:7447", False),
        ("tcp/[::]:7447", False),
        ("tcp/192.168.0.2:7447", False),
        ("tcp/localhost.example:7447", False),
        ("serial//dev/ttyUSB0#baudrate=115200", False),
    ],
)
def test_what_only_this_machine_reaches(address: str, private: bool) -> None:
    assert is_private(address) is private
