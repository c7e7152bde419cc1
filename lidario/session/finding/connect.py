"""From a source to a device that has introduced itself.

The port is opened, what may be at its other end is listed, and then searched for
(`lidario.session.finding.search`). At one speed the families stand in the order of the registry. Speeds are ordered
by rank, each family's likeliest first, so that a family with one speed does not wait for all speeds of another.
Where a device was found before on the same adapter, its family and speed come first (`LAST_AT`).
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Sequence
from itertools import zip_longest
from typing import TYPE_CHECKING

import anyio

from lidario.basics.source import Source
from lidario.errors import ConnectFailed, DeviceLost
from lidario.families.base import Family
from lidario.families.registry import FAMILIES, families_of_model, family_named, family_of_simulated
from lidario.port.port import Port
from lidario.port.serial import open_serial
from lidario.port.sockets import open_tcp, open_udp
from lidario.session.finding.asking import Attempt
from lidario.session.finding.connection import Connection, connect_recording, connect_remote
from lidario.session.finding.listening import LAST_AT, ReceivedInSilence, adapter_of
from lidario.session.finding.search import Search
from lidario.session.talking.dialogue import Dialogue

if TYPE_CHECKING:
    from lidario.port.simulated import Simulation


async def connect(
    source: Source,
    family: str | None = None,
    baudrate: int | None = None,
    *,
    patient: bool = True,
    simulation: Simulation | None = None,
    on_dialogue: Callable[[Dialogue], None] | None = None,
    on_port: Callable[[Port], None] | None = None,
    guard: bool = False,
) -> Connection:
    """Open a port and find out which device is at its other end.

    Cancelling it leaves the port closed, and the device still (`lidario.session.finding.leaving`).

    Args:
        source: A serial port, network address or simulator; not ``auto`` or ``id``.
        family: Name of the family, if it is known; it need not be probed then.
        baudrate: Speed of the line, if it is known; likewise.
        patient: Whether to go on asking a device that may be booting, or may hold half a request: for 5 to 13 s.
            Where it is not, and family and speed are known, it is asked for about a second.
        simulation: The device of a ``sim://`` source, where it outlives its ports.
        on_dialogue: Called with the dialogue before anything is written, where family and speed are known.
        on_port: Called with the open port before anything is written, whatever is known.
        guard: Whether a process of its own leaves the device still when this one is killed (`Port.guard`).

    Raises:
        ConnectFailed: It could not be opened, or nothing responds; the text says what was tried and what came back.
        DeviceLost: The port died meanwhile.
    """
    if source.kind == "file":
        return await connect_recording(source, family)
    if source.kind == "zenoh":
        return await connect_remote(source)
    port, tries, adapter = await _opened(source, family or source.family, baudrate or source.baudrate, simulation)
    # Where Ctrl-C has ended it, what follows is run by the garbage collector.
    loop = asyncio.get_running_loop()
    received = ReceivedInSilence()
    search = Search(port, tries, received, on_dialogue)
    port.add_tap(received.see)
    try:
        if on_port is not None:
            on_port(port)
        if guard and source.is_driven_from_here:
            await port.guard()
        connection = await search.find(patient=patient, by_dtr=source.model is None)
        if connection is not None:
            if adapter is not None:
                LAST_AT[adapter] = connection.info.family, port.baudrate
            if not connection.dialogue.device.can_be_stopped:
                port.unguard()
            return connection
        await search.leave(found_nothing=True)
    except BaseException as error:
        # Ctrl-C may come when the device has responded, and before its connection is returned.
        await search.leave(found_nothing=False)
        if source.kind == "udp" and isinstance(error, DeviceLost) and not received.total:
            # A UDP port can always be opened. Only the first request shows that nothing listens there.
            raise ConnectFailed(
                f"{source.text}: nothing listens at this UDP port. Are address and port right?", reason="refused"
            ) from error
        raise
    finally:
        port.remove_tap(received.see)
        if port.is_closing and not loop.is_closed():
            with anyio.CancelScope(shield=True):
                await port.wait_closed()
    tries = search.tries
    asked_at = [each.baudrate for each in tries if each.baudrate]
    raise received.nothing_responds(source, [each.family for each in tries], asked_at, port.errors)


async def _opened(
    source: Source, named: str | None, speed: int | None, simulation: Simulation | None
) -> tuple[Port, list[Attempt], str | None]:
    """An open port, what is to be tried on it, and its adapter where the speed behind that is to be remembered."""
    families = (family_named(named),) if named else FAMILIES
    if source.model is not None:
        families = families_of_model(source.model, named)
    adapter: str | None = None
    tries = [Attempt(each, 0, source.model) for each in families]  # of a line that has no speed
    if source.kind == "sim":
        from lidario.port.simulated import Simulation  # a fifth of the import time, for those who need it

        port = await (simulation or Simulation(source, lasting=False)).open()
        tries = [Attempt(family_of_simulated(source.address), port.baudrate, source.model)]
    elif source.device is not None:
        from lidario.port.simulated import connect_in_memory

        port = connect_in_memory(source.device)
    elif source.kind == "tcp":
        port = await open_tcp(source.text, *source.host_and_port, baudrate=speed or 0)
    elif source.kind == "udp":
        port = await open_udp(source.text, *source.host_and_port)
    else:
        if speed:
            tries = [each._replace(baudrate=speed) for each in tries]
        elif source.model is not None:
            speeds = [(each, baudrate) for each in families for baudrate in each.models[source.model].baudrates]
            tries = [Attempt(*each, source.model) for each in speeds]
        else:
            adapter = adapter_of(source.address)
            known = None if adapter is None else LAST_AT.get(adapter)
            # Sorting keeps the order of all others.
            tries = sorted(_by_likelihood(families), key=lambda each: (each.family.name, each.baudrate) != known)
        port = await open_serial(source.address, tries[0].baudrate)
    return port, tries, adapter


def _by_likelihood(families: Sequence[Family]) -> list[Attempt]:
    """Every speed of every family: the likeliest of each family first, then the second of each, and so on."""
    ranks = zip_longest(*([Attempt(family, speed) for speed in family.baudrates] for family in families))
    return [each for rank in ranks for each in rank if each is not None]
