"""``lidario sim``: a simulated lidar for any driver, on a pseudo-terminal, a TCP port or a UDP port.

The only line on stdout is what a client opens, so that a script can read it; after the fault ``replug`` a second
line tells the new name. The simulated lidar is served until Ctrl-C. Then the command prints which requests it
received, and which of them a real device would have discarded, and why; this helps authors of drivers.
"""

from __future__ import annotations

import asyncio
import time
from collections import Counter
from typing import TYPE_CHECKING, Final

import click

import lidario
from lidario.basics.system import cause_of
from lidario.basics.words import counted
from lidario.cli.errors import cannot_listen
from lidario.cli.output import emit_beside
from lidario.cli.parameters import WholeRange
from lidario.cli.running import run_until_stopped
from lidario.cli.streams import emit, message

if TYPE_CHECKING:
    from lidario.sim.faults import Faults
    from lidario.sim.serve import PtyServer, TcpServer, UdpServer

POLL_S = 0.1
pty_option: Final = click.option("--pty", is_flag=True, help="On a pseudo-terminal: the default on Linux.")
tcp_option: Final = click.option(
    "--tcp", metavar="[HOST]:PORT", help="On a TCP port of this machine, or of that address; port 0 is any."
)


@click.command()
@click.argument("model", required=False)
@pty_option
@tcp_option
@click.option("--udp", metavar="[HOST]:PORT", help="On a UDP port: the default for an Ethernet model.")
@click.option("--fault", "faults", multiple=True, metavar="NAME[:VALUE]",
              help="What goes wrong, for instance drop:1% or reboot:5s. May be given several times.")  # fmt: skip
@click.option("--list-faults", is_flag=True, help="List the faults and what they do, and exit.")
@click.option("--world", metavar="NAME", help="What it sees: room, corridor, circle or empty.")
@click.option("--serial", metavar="HEX", help="Its serial number.")
@click.option("--seed", default=0, show_default=True, type=WholeRange(min=0), metavar="N",
              help="Seed of everything random.")  # fmt: skip
@click.option("--list", "list_models", is_flag=True,
              help="List the models by vendor, the default first, and which recordings of real ones some are like, "
                   "and exit.")  # fmt: skip
def sim(
    model: str | None,
    pty: bool,
    tcp: str | None,
    udp: str | None,
    faults: tuple[str, ...],
    list_faults: bool,
    world: str | None,
    serial: str | None,
    seed: int,
    list_models: bool,
) -> None:
    """Serve a simulated lidar until Ctrl-C.

    It accepts requests as strictly as a real one, and sends scans at the real rate.
    """
    from lidario.families.registry import FAMILIES
    from lidario.sim.faults import parse_faults

    if list_models:
        emit(_model_table())
        return
    if list_faults:
        emit(_fault_table())
        return
    if sum((pty, tcp is not None, udp is not None)) > 1:
        raise click.UsageError("--pty, --tcp and --udp exclude each other")
    model = model or FAMILIES[0].simulated[0]
    device = lidario.simulate(model, world=world or "room", serial=serial, seed=seed)
    try:
        asked = parse_faults(",".join(faults), seed=seed) if faults else None
    except ValueError as error:
        raise click.BadParameter(str(error), param_hint="--fault") from None
    _serve(server_of(device, pty=pty, tcp=tcp, udp=udp, faults=asked), model)


def _model_table() -> str:
    """Every simulated model and what it is, under the name of its family."""
    from lidario.families.registry import FAMILIES

    width = max(len(name) for family in FAMILIES for name in family.simulated)
    text = ""
    for family in FAMILIES:
        text += f"{family.title}:\n"
        text += "".join(f"  {name:{width}}  {family.describe(name)}".rstrip() + "\n" for name in family.simulated)
    return text


def _fault_table() -> str:
    """Every fault as it is typed, and what it does; line faults first."""
    from lidario.sim.faults import FAULTS

    width = max(len(fault.example) for fault in FAULTS.values())
    return "".join(f"{fault.example:{width}}  {fault.what}\n" for fault in FAULTS.values())


def server_of(
    device: lidario.SimulatedDevice,
    *,
    pty: bool,
    tcp: str | None,
    udp: str | None = None,
    faults: Faults | None = None,
) -> PtyServer | TcpServer | UdpServer:
    """Serve a device in the way that was asked for, else in the usual one."""
    from lidario.sim.serve import PtyServer, usual_way

    said = "udp" if udp is not None else "tcp" if tcp is not None else "pty" if pty else usual_way(device)
    if said != "pty":
        return _listening(said, udp or tcp or ":0", device, faults)
    try:
        return PtyServer(device, faults=faults)
    except OSError as error:
        raise lidario.ConnectFailed(
            f"no pseudo-terminal is available: {cause_of(error)}. --tcp :0 needs none", reason="missing"
        ) from error


def _listening(
    kind: str, address: str, device: lidario.SimulatedDevice, faults: Faults | None
) -> TcpServer | UdpServer:
    """Listen on the loopback interface, unless the address names another."""
    from lidario.sim.serve import TcpServer, UdpServer

    host, _, port = address.rpartition(":")
    # An IPv6 address stands in brackets, as in a source.
    host = host.removeprefix("[").removesuffix("]")
    try:
        host.encode("idna")  # else a socket raises TypeError
        is_right = port.isdecimal() and int(port) <= 0xFFFF
    except UnicodeError:
        is_right = False
    if not is_right:
        raise click.BadParameter(f"{address!r} is not [HOST]:PORT, such as :2000", param_hint=f"--{kind}")
    try:
        return (UdpServer if kind == "udp" else TcpServer)(device, host or "127.0.0.1", int(port), faults=faults)
    except OSError as error:
        raise cannot_listen(address, error, f"--{kind} :0") from error


def _serve(server: PtyServer | TcpServer | UdpServer, model: str) -> None:
    from lidario.sim.serve import UdpServer

    began, turned = time.monotonic(), server.device.motor_on
    at = "" if isinstance(server, UdpServer) else f" at {server.device.baudrate} baud"

    async def work() -> None:
        await announce(server, f"a simulated {model}{at}, until Ctrl-C")
        await _until_unplugged(server)

    with server:
        if run_until_stopped(work):
            message("the line was unplugged, as --fault asks")
    sum_up(server, time.monotonic() - began, turned=turned)


async def announce(server: PtyServer | TcpServer | UdpServer, what: str) -> None:
    """What a client opens on stdout, for scripts; what is served, and how it is opened, on stderr."""
    taken = emit_beside(f"{name_of(server)}\n")
    message(f"{what}; for instance")
    message(f"  lidario scan {name_of(server)}")
    await taken


def name_of(server: PtyServer | TcpServer | UdpServer) -> str:
    """What a client opens."""
    from lidario.sim.serve import PtyServer, UdpServer

    if isinstance(server, PtyServer):
        return server.path
    host, port = server.address
    where = f"[{host}]" if ":" in host else host
    return f"{'udp' if isinstance(server, UdpServer) else 'tcp'}://{where}:{port}"


async def _until_unplugged(server: PtyServer | TcpServer | UdpServer) -> None:
    """Wait until the line is dead and stays so; tell when it was plugged in again."""
    plugged = True
    while not server.unplugged:
        if server.plugged.is_set() is not plugged:
            plugged = not plugged
            message("plugged in again:" if plugged else "the cable is out, as --fault asks")
            if plugged:
                await emit_beside(f"{name_of(server)}\n")
        await asyncio.sleep(POLL_S)  # the server is a thread, and has no event to await


def sum_up(server: PtyServer | TcpServer | UdpServer, took: float, *, turned: bool = False) -> None:
    """Tell what its clients have asked in `took` seconds, and how they have left the device.

    One that `turned` before anybody opened it has a motor that no request stops, as by DTR: this line has none.
    """
    log = server.device.log
    obeyed = Counter(request.name for request in log if request.obeyed)
    discarded = Counter((request.name, request.why) for request in log if not request.obeyed)
    seen = ", ".join(f"{name} {count}" for name, count in obeyed.items())
    message(f"served {took:.1f} s; requests obeyed: {seen or 'none'}")
    for (name, why), count in discarded.items():
        message(f"  discarded: {name} {count}, {why}")
    for (name, remark), count in Counter((each.name, each.remark) for each in log if each.remark).items():
        message(f"  obeyed, but too early: {name} {count}, {remark}")
    if server.lost:
        message(f"  lost {counted(server.lost, 'byte')}: nobody read, or too slowly")
    # A model that only talks always scans; no client has left it scanning.
    if server.device.scanning and obeyed:
        message("  the client has left it scanning")
    elif server.device.motor_on and obeyed and not turned:
        message("  the client has left its motor on")
