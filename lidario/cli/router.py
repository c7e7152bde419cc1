"""``lidario router``: what publishers and readers of zenoh meet at, until Ctrl-C."""

import asyncio
import re
import shlex
from ipaddress import ip_address

import click

import lidario.ros
from lidario.cli.output import emit_beside
from lidario.cli.running import run_until_stopped
from lidario.cli.streams import message

OF_THIS_MACHINE = ("unixsock-stream", "unixpipe")  # protocols between programs of one machine


@click.command()
@click.option("--listen", "addresses", multiple=True, metavar="ADDRESS",
              help="Where, in zenoh's notation; several may be given.  [tcp/127.0.0.1:7447]")  # fmt: skip
@click.option("--config", type=click.Path(), metavar="FILE",
              help="zenoh's configuration, JSON5: certificates, access control.  [$ZENOH_CONFIG]")  # fmt: skip
def router(addresses: tuple[str, ...], config: str | None) -> None:
    """Run a zenoh router, where publishers and readers meet.

    Until Ctrl-C. For this machine alone unless --listen or a configuration says otherwise. Nodes of ROS 2 find it
    as their own rmw_zenohd. Where it listens is printed.
    """

    async def work() -> None:
        async with await lidario.ros.Router.open(*addresses, config=config) as served:
            taken = emit_beside("".join(f"{address}\n" for address in served.addresses))
            message("a zenoh router, until Ctrl-C; for instance")
            for address in served.addresses[:1]:
                message(f"  lidario publish --zenoh robots/r7/scan --router {shlex.quote(address)}")
            open_to_all = [each for each in served.addresses if not config and not is_private(each)]
            if open_to_all:
                message(f"everybody who reaches {open_to_all[0]} may publish and read: --config FILE names who may")
            await taken
            await asyncio.Event().wait()

    run_until_stopped(work)


def is_private(address: str) -> bool:
    """Whether only this machine reaches it."""
    protocol, _, rest = address.partition("/")
    host = re.split(r"[?#]", rest)[0].rpartition(":")[0].strip("[]")
    try:
        return protocol in OF_THIS_MACHINE or ip_address(host).is_loopback
    except ValueError:
        return host == "localhost"
