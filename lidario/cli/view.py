"""``lidario view``: the live page in a browser, for one lidar or several.

It serves this machine alone. ``--lan`` opens it to the network, with a random token in the printed address. Over
SSH the line is printed that brings the page to the machine one sits at.
"""

from __future__ import annotations

import asyncio
import os
import re
import secrets
import socket
from itertools import zip_longest
from pathlib import Path
from typing import TYPE_CHECKING, Final

import click

import lidario
from lidario.basics.words import counted
from lidario.cli.errors import cannot_listen, need
from lidario.cli.output import emit_beside, progress
from lidario.cli.parameters import WholeRange, as_folder, as_place, guard_option, mode_option, sources_argument
from lidario.cli.running import run_until_stopped
from lidario.cli.settings import FILE, config_file, config_option
from lidario.cli.streams import message

if TYPE_CHECKING:
    from lidario.web.feed import Feed
    from lidario.web.server import LiveServer

MOST_LIDARS: Final = 16


@click.command()
@sources_argument
@click.option("--port", default=8080, show_default=True, type=WholeRange(0, 65535), metavar="N",
              help="Port of the page; 0 for any that is free.")  # fmt: skip
@click.option("--lan", is_flag=True, help="Open to the network, for those who have the printed address.")
@click.option("--mount", "mounts", type=as_place, multiple=True, metavar="X,Y,YAW",
              help="Where a lidar is mounted: metres forward, metres left, degrees counter-clockwise. "
                   "Once for each SOURCE, in their order.")  # fmt: skip
@click.option("--colour", "colours", multiple=True, metavar="#RRGGBB",
              help="Colour of a lidar, once for each SOURCE.")  # fmt: skip
@click.option("--record", "folder", type=as_folder, metavar="FOLDER",
              help="Where the page may record: the current folder, with --lan nowhere, unless named.")  # fmt: skip
@config_option
@mode_option
@guard_option
def view(
    sources: tuple[str, ...],
    port: int,
    lan: bool,
    mounts: tuple[lidario.Mount, ...],
    colours: tuple[str, ...],
    folder: Path | None,
    mode: str | int | None,
    guard: bool,
) -> None:
    """Show live scans in a browser, until Ctrl-C.

    The address of the page is printed. A lidar that is lost is opened again as soon as it is back.
    """
    need("websockets", "the page")
    from lidario.web.feed import Feed

    sources = sources or ("auto",)
    _check_choice(len(sources), len(mounts), colours)
    where = folder or (None if lan else Path())
    file = config_file()
    if file is not None:
        lidario.read_config(file)
    feeds = [
        Feed(
            source, mode=mode, guard=guard, stays=True, folder=where, config=file, mount=mount, colour=colour or ""
        )
        for source, mount, colour in zip_longest(sources, mounts, colours)
    ]
    # Whoever has the address may write it: with --lan only where the file was named.
    written = file or (None if lan else FILE)
    run_until_stopped(lambda: _serve(feeds, port, lan, written))
    for feed in feeds:
        lost = f", lost {counted(feed.losses, 'time')}" if feed.losses else ""
        message(f"{feed.source}: {counted(feed.scans, 'scan')}{lost}")


def _check_choice(count: int, mounts: int, colours: tuple[str, ...]) -> None:
    if count > MOST_LIDARS:
        raise click.UsageError(f"a page shows {MOST_LIDARS} lidars at most")
    if mounts > count or len(colours) > count:
        raise click.UsageError("more mounts or colours than sources")
    for colour in colours:
        if colour and not re.fullmatch(r"#[0-9a-fA-F]{6}", colour):
            raise click.BadParameter(f"{colour!r} is not a colour such as #1b5fc1", param_hint="--colour")


async def _serve(feeds: list[Feed], port: int, lan: bool, config: str | None) -> None:
    """Read all feeds, and serve them from the first scan of each on; the first error of an opening ends it."""
    from lidario.web.server import LiveServer

    token = secrets.token_urlsafe(16) if lan else ""
    # Binding to all interfaces is what --lan asks for.
    server = LiveServer(feeds, host="0.0.0.0" if lan else "127.0.0.1", port=port, token=token,
                        config=config)  # fmt: skip
    try:
        await server.__aenter__()
    except OSError as error:
        raise cannot_listen(f"port {port}", error, "--port 0") from error
    reading: list[asyncio.Task[None]] = []
    try:
        begun = asyncio.Event()
        for feed in feeds:
            feed.on_scan = lambda _: begun.set()
            reading.append(asyncio.create_task(feed.run()))
            reading[-1].add_done_callback(lambda _: begun.set())
        with progress("waiting for the first scan …"):
            while any(feed.latest is None for feed in feeds):  # a scan may be empty
                await begun.wait()
                begun.clear()
                _raise_of(reading)
        for feed in feeds:
            feed.on_scan, feed.on_change = server.publish_scan, server.publish_states
        await _announce(server, lan)
        left = set(reading)
        while left:
            _, left = await asyncio.wait(left, return_when=asyncio.FIRST_COMPLETED)
            _raise_of(reading)
        # All were recordings, and are over: what they showed last stays to be looked at.
        await asyncio.get_running_loop().create_future()
    finally:
        for task in reading:
            task.cancel()
        # First of all: it writes the stop requests.
        if reading:
            await asyncio.wait(reading)
        await server.__aexit__(None, None, None)


def _raise_of(reading: list[asyncio.Task[None]]) -> None:
    """Raise the error of the first task that has one."""
    for task in reading:
        if task.done():
            task.result()


async def _announce(server: LiveServer, lan: bool) -> None:
    """The address on stdout, for people and for scripts; everything else on stderr."""
    url = server.url.replace("//0.0.0.0:", f"//{_own_address()}:")
    taken = emit_beside(f"{url}\n")
    if lan:
        message("open to the network, for those who have this address; unencrypted")
    connection = os.environ.get("SSH_CONNECTION", "").split()
    if len(connection) == 4 and not lan:
        here = f"{os.environ.get('USER') or 'USER'}@{connection[2]}"
        message("on the machine you sit at, then open the address there:")
        message(f"  ssh -L {server.port}:127.0.0.1:{server.port} {here}")
    message("Ctrl-C ends it")
    await taken


def _own_address() -> str:
    """The address by which others on the network reach this machine, as far as it can tell."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        try:
            # Nothing is sent: the system only chooses the interface. The address is one for documentation.
            probe.connect(("192.0.2.1", 9))
            return str(probe.getsockname()[0])
        except OSError:
            return socket.gethostname()
