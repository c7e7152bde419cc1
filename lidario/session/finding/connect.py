"""From a source to a device that has introduced itself.

Where family and speed are known, the device is asked at once, for as long as a half request that a killed program
left may keep it from hearing. Otherwise the line is first listened to (`listen`): a device that
streams is recognised by that. What remains unknown is found by asking (`lidario.session.finding.asking`).

At one speed the families are asked in the order of the registry. Speeds are ordered by rank, each family's
likeliest first, so that a family with one speed does not wait for all speeds of another. Where a device was found
before on the same adapter, its family and speed come first (`LAST_AT`).
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Sequence
from itertools import pairwise, zip_longest
from typing import TYPE_CHECKING

import anyio

from lidario.errors import ConnectFailed, DeviceLost, ResponseTimeout
from lidario.families.base import Family
from lidario.families.registry import FAMILIES, families_of_model, family_named, family_of_simulated
from lidario.port.port import Port
from lidario.port.serial import open_serial
from lidario.port.tcp import open_tcp
from lidario.port.udp import open_udp
from lidario.session.finding.asking import Attempt, Woken, ask_in_turns, begun, find_by_dtr, leave
from lidario.session.finding.connection import Connection, connect_recording, connect_remote
from lidario.session.finding.leaving import leave_still
from lidario.session.finding.listening import LAST_AT, Heard, ReceivedInSilence, adapter_of, listen
from lidario.session.talking.dialogue import Dialogue
from lidario.session.talking.handshake import introduce
from lidario.source import Source

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
        patient: Whether to go on asking a device that may be booting, or may hold half a request: for 5 to 8 s.
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
    search = _Search(port, tries, received, on_dialogue)
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
    if source.kind == "sim":
        from lidario.port.simulated import Simulation  # a fifth of the import time, for those who need it

        port = await (simulation or Simulation(source, lasting=False)).open()
        tries = [Attempt(family_of_simulated(source.address), port.baudrate, source.model)]
    elif source.device is not None:
        from lidario.port.simulated import connect_in_memory

        port = connect_in_memory(source.device)
        tries = [Attempt(each, 0) for each in families]
    elif source.kind == "tcp":
        port = await open_tcp(source.text, *source.host_and_port, baudrate=speed or 0)
        tries = [Attempt(each, 0, source.model) for each in families]
    elif source.kind == "udp":
        port = await open_udp(source.text, *source.host_and_port)
        tries = [Attempt(each, 0) for each in families]
    else:
        if source.model is not None:
            tries = [
                Attempt(each, baudrate, source.model)
                for each in families
                for baudrate in ((speed,) if speed else each.models[source.model].baudrates)
            ]
        elif speed:
            tries = [Attempt(each, speed) for each in families]
        else:
            adapter = adapter_of(source.address)
            known = None if adapter is None else LAST_AT.get(adapter)
            # Sorting keeps the order of all others.
            tries = sorted(_by_likelihood(families), key=lambda each: (each.family.name, each.baudrate) != known)
        port = await open_serial(source.address, tries[0].baudrate)
    return port, tries, adapter


def _may_hear(each: Attempt) -> bool:
    """Whether a silent device of that family may hear a request at that speed."""
    asked_at = each.family.asked_at
    return asked_at is None or each.baudrate in (0, *asked_at)


def _by_likelihood(families: Sequence[Family]) -> list[Attempt]:
    """Every speed of every family: the likeliest of each family first, then the second of each, and so on."""
    ranks = zip_longest(*([Attempt(family, speed) for speed in family.baudrates] for family in families))
    return [each for rank in ranks for each in rank if each is not None]


class _Search:
    """Looks for the device at an open port; `tries` is what it may be, or was asked as, once nothing was found.

    `received` counts what comes from the port.
    """

    def __init__(
        self,
        port: Port,
        tries: list[Attempt],
        received: ReceivedInSilence,
        on_dialogue: Callable[[Dialogue], None] | None,
    ) -> None:
        self.tries: list[Attempt] = tries
        self._port = port
        self._received = received
        self._loop = asyncio.get_running_loop()
        self._on_dialogue = on_dialogue
        self._woken = Woken(port)
        # The one with what was known from the beginning, or was recognised by its stream.
        self._known: Dialogue | None = None

    async def find(self, *, patient: bool, by_dtr: bool) -> Connection | None:
        """The device, or None; `by_dtr`: also where one model may be none that is dark while DTR is cleared."""
        if len(self.tries) > 1:
            connection = await self._find_among(patient=patient)
        else:
            connection = await self._try_known(self.tries[0], patient=patient)
        if connection is None and len(self.tries) == 1 and by_dtr:
            connection = await find_by_dtr(self._port, self.tries, self._woken)
        return connection

    async def leave(self, *, found_nothing: bool) -> None:
        """Leave what may be at the port still, and begin to close it; it may be closed already.

        Where the search was ended before it `found_nothing`, it is first found out what the device is.
        """
        port, families = self._port, {each.family for each in self.tries}
        if self._known is not None:
            await self._woken.stop()
            await self._known.close()
        elif not port.is_closing:
            # One of a known family may hear us although its responses do not reach us.
            helps = len(families) == 1 or not found_nothing
            if helps and port.is_open and not self._loop.is_closed():
                await leave_still(port, self.tries, self._woken)
            else:
                await self._woken.stop()
                port.close_soon()

    async def _find_among(self, *, patient: bool) -> Connection | None:
        """The device, where several families or speeds are to be tried."""
        tries = every = self.tries
        heard = await self._listen(every)
        if heard.stream is not None:
            return await self._try_heard(heard.stream, every)
        tries = [each for each in tries if _may_hear(each)] or tries
        families = {each.family for each in tries}
        # One that is waited for shortly may be late. Then at another speed it is noise, but not at the same.
        quick = heard.silent and all(a.baudrate != b.baudrate for a, b in pairwise(tries))
        tries = [each._replace(is_guess=len(families) > 1) for each in tries]

        async def hear_again() -> Connection | None:
            again = await self._listen(every)
            return None if again.stream is None else await self._try_heard(again.stream, every)

        connection = await ask_in_turns(
            self._port, tries, self._woken, hear_again, self._received,
            quick=quick, silent=heard.silent, patient=patient,
        )  # fmt: skip
        self.tries = tries
        return connection

    async def _listen(self, every: Sequence[Attempt]) -> Heard:
        """Listen to all of them, also to those that hear nothing."""
        speeds = list(dict.fromkeys(each.baudrate for each in every))
        return await listen(self._port, speeds, list(dict.fromkeys(each.family for each in every)))

    async def _try_heard(self, stream: tuple[Family, int], every: Sequence[Attempt]) -> Connection | None:
        """Ask the one of them whose stream was recognised."""
        # Where several families have a model of the name that the user gave, it is that one.
        known = next((each for each in every if (each.family, each.baudrate) == stream), Attempt(*stream))
        self.tries = [known]
        return await self._try_known(known)

    async def _try_known(self, known: Attempt, *, patient: bool = True) -> Connection | None:
        """Ask the one family at the one speed that it can be, with patience; None when there is no response."""
        self._port.set_baudrate(known.baudrate)
        connection = begun(self._port, known, self._woken)
        dialogue = connection.dialogue
        try:
            self._known = dialogue
            if self._on_dialogue is not None:
                self._on_dialogue(dialogue)
            connection.info = await introduce(dialogue, known.family.timing.forget_s if patient else 0.0)
        except ResponseTimeout:
            # It may hear us although its responses do not reach us.
            await leave(connection)
            return None
        return connection
