"""Asking a device that nothing is known of, once, and what such a question leaves behind.

A question may start a device that hears it, and its response may be late or damaged. So what may have been started
is kept (`Woken`), and is stopped when the search ends.
"""

import asyncio
import time
from collections.abc import Iterator
from contextlib import suppress
from typing import NamedTuple

import anyio

from lidario.errors import ConnectFailed, ResponseTimeout
from lidario.families.base import Device, Family
from lidario.port.diagnose import is_pseudo_terminal
from lidario.port.port import SENT_S, Port
from lidario.session.finding.connection import Connection
from lidario.session.finding.listening import ReceivedInSilence
from lidario.session.talking.dialogue import Dialogue
from lidario.session.talking.handshake import RESPONSE_BYTES, introduce

QUICK_S = 0.05
"""How long the first round waits for a response: a healthy device needs a few milliseconds, an adapter up to 16."""
PROBE_S = 0.12
"""How long later rounds wait for it, at each speed."""


class Attempt(NamedTuple):
    """Whom to ask, and how fast."""

    family: Family  # whose question is asked
    baudrate: int  # speed of the line; 0 where it has none
    model: str | None = None  # the model, where it is known
    is_guess: bool = False  # whether family or model are only supposed


class Woken:
    """Devices that a search may have started, and which did not respond in time: they are stopped when it ends.

    Until then they are left on, so that they are heard when their rotor turns evenly.
    """

    def __init__(self, port: Port) -> None:
        self.port: Port = port
        self._loop = asyncio.get_running_loop()
        self._stops: set[tuple[int, bytes]] = set()

    def add(self, baudrate: int, stop: bytes) -> None:
        """One at that speed may have been started; nothing stops one that was not."""
        if stop:
            self._stops.add((baudrate, stop))

    async def stop(self) -> None:
        """Stop them. Where the loop is closed, as `abandon`."""
        if self._loop.is_closed():
            self.abandon()
            return
        with anyio.CancelScope(shield=True):
            for _ in self._stop():
                await anyio.sleep(SENT_S)

    def abandon(self) -> None:
        """Stop them, also without a loop. It blocks for 10 ms for each of them, and is for finalizers."""
        for _ in self._stop():
            time.sleep(SENT_S)

    def _stop(self) -> Iterator[None]:
        """Stop them one by one; the line has its speed again behind them.

        At each step, what is still under way would be garbled by another speed.
        """
        speed = self.port.baudrate
        for baudrate, stop in sorted(self._stops):
            if self.port.is_open:
                self._at(baudrate)
                self.port.write(stop)
                yield
        self._at(speed)

    def _at(self, baudrate: int) -> None:
        with suppress(ConnectFailed):
            self.port.set_baudrate(baudrate)


def begun(woken: Woken, attempt: Attempt) -> Connection:
    """The connection to what is asked; nothing was written. With it, what was `woken` before is abandoned."""
    return Connection(Dialogue(woken.port, made(woken.port, attempt), attempt.family.timing), woken.abandon)


def made(port: Port, attempt: Attempt) -> Device:
    """The device as the family sees it that is asked."""
    device = attempt.family.make(attempt.model)
    # A pseudo-terminal carries everything, whatever speed it was opened at.
    device.baudrate = None if is_pseudo_terminal(port.name) else port.baudrate
    device.is_guess = attempt.is_guess
    return device


async def find_by_dtr(woken: Woken, tries: list[Attempt], received: ReceivedInSilence) -> Connection | None:
    """One of the models that are dark while DTR is cleared; None when none responds.

    Each is asked once, and once more where as much as a response was `received`: it may have been damaged.
    """
    for guess, patience_s in _dark_ones(tries):
        before = received.total
        connection = await ask_once(woken, guess, patience_s=patience_s)
        if connection is None and 0 < received.total - before <= RESPONSE_BYTES:
            connection = await ask_once(woken, guess, patience_s=patience_s)
        if connection is not None:
            return connection
    woken.port.set_dtr(False)
    return None


def _dark_ones(tries: list[Attempt]) -> Iterator[tuple[Attempt, float]]:
    """Whom to ask while DTR is asserted, and how long each may take to respond."""
    speeds = {each.baudrate for each in tries}
    asked: set[tuple[Family, int, float]] = set()
    for family in dict.fromkeys(each.family for each in tries):
        for name, patience_s in family.by_dtr.items():
            baudrate = 0 if 0 in speeds else family.models[name].baudrates[0]
            # Where no speed tells them apart, one question is for all that respond, and one for all that talk.
            question = (family, baudrate, patience_s)
            if question in asked or baudrate not in speeds:
                continue
            asked.add(question)
            yield Attempt(family, baudrate, name, is_guess=True), patience_s


async def ask_once(
    woken: Woken, attempt: Attempt, *, quick: bool = False, patience_s: float = 0.0
) -> Connection | None:
    """Ask one family's question once at one speed; None when there is no response.

    Where nothing streams it is `quick`: it asks without waiting for silence, and waits shortly. `patience_s` is how
    long the response may take; 0 for as long as is usual. Where it is ended while nothing has
    responded, the port stays open: what the device is must still be found out, to leave it still.
    """
    loop, port = asyncio.get_running_loop(), woken.port
    try:
        port.set_baudrate(attempt.baudrate)
    except ConnectFailed:
        return None  # the adapter cannot do it; its device runs at another speed
    connection = begun(woken, attempt)
    dialogue = connection.dialogue
    try:
        dialogue.hurry(patience_s or (QUICK_S if quick else PROBE_S))
        connection.info = await introduce(dialogue, patience=0, quiet=quick)
        dialogue.hurry()
    except ResponseTimeout:
        connection.release()
        port.attach(None)
        port.write(dialogue.device.complete_probe())
        woken.add(attempt.baudrate, dialogue.device.end_search())
        return None
    except BaseException:
        if dialogue.stats.response_bytes:
            await dialogue.close()
        elif not loop.is_closed():  # else the finalizer of the connection does it
            await leave(connection)
        raise
    return connection


async def leave(connection: Connection) -> None:
    """Stop what does not respond, as far as its family knows how, and leave the port open."""
    dialogue = connection.dialogue
    dialogue.stop_device()
    try:
        await dialogue.stopper.surely_settled()
    finally:
        connection.release()
        dialogue.port.attach(None)
