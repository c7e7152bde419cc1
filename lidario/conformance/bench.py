"""A device on the bench: an open line to it, on which rules are tried one after the other.

It holds an ordinary session (`Bench.lidar`), which checks what the session promises and can record every byte. And
it holds the conversation below it, which checks what the manuals say: there each request is written once, at the
earliest moment that the device must accept it.
"""

import asyncio
import os
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import replace
from math import isfinite
from typing import Self, TypeVar

from lidario.basics.model import Health, HealthStatus, ScanMode
from lidario.basics.source import Source, as_source
from lidario.conformance.flow import Flow, Watch, collect
from lidario.conformance.rule import Broken, Figure, Need, NotTried, Outcome, Rule, Verdict
from lidario.errors import DeviceFault, InvalidValue, LidarError, Unsupported
from lidario.families.base import Script
from lidario.families.registry import check_family, check_source
from lidario.port.port import Port
from lidario.session.finding.connect import connect
from lidario.session.finding.connection import Connection
from lidario.session.finding.discovery import find_source, search_for
from lidario.session.finding.reconnect import Reconnector
from lidario.session.lidar import Lidar
from lidario.session.opening import DEFAULT_LATENCY_S
from lidario.session.talking.dialogue import Dialogue
from lidario.session.talking.handshake import healthy
from lidario.session.talking.play import play
from lidario.sim.device import SimulatedDevice
from lidario.wire.envelope import Request

T = TypeVar("T")

LISTEN_S = 0.5  # how long a device that must be silent is listened to
SETTLE_S = 0.1  # what was sent before it was stopped may come so late: an adapter or a network holds it back
REST_S = 3.0  # longest time that the device has to come to rest behind a rule; `Lidar.stop` needs 2 s at most


class Bench:
    """One open device; made by `open_bench`, and used as its context manager: laser and motor are off afterwards.

    Attributes:
        kind: What leads to the device: ``serial``, ``tcp``, ``udp``, or of a simulated one ``sim`` or ``device``.
        lidar: The session.
        connection: The line below it: device, conversation and times.
        dialogue: The conversation with the device.
        simulated: The simulated device, where it is one in memory.
        pause: Blocks the program for so many seconds; `time.sleep`, unless a test replaces it.
        last_in: When the last bytes came, seconds of the event loop's clock; 0 before the first.
        received: Bytes received so far.
    """

    def __init__(
        self, connection: Connection, health: Health, source: Source, simulated: SimulatedDevice | None
    ) -> None:
        self.kind: str = source.kind
        alone = Reconnector(None, source)
        self.lidar: Lidar = Lidar(connection, health, source.text, DEFAULT_LATENCY_S, False, alone, rests=False)
        self.connection: Connection = connection
        self.dialogue: Dialogue = connection.dialogue
        self.simulated: SimulatedDevice | None = simulated
        self.pause: Callable[[float], None] = time.sleep
        self.last_in: float = 0.0
        self.received: int = 0
        self._loop = asyncio.get_running_loop()
        self._watches: list[Watch] | None = None
        self._figures: list[Figure] = []
        self.lidar.tap(self._see)

    async def __aenter__(self) -> Self:
        return self

    async def __aexit__(self, *_: object) -> None:
        await self.lidar.close()

    # -------------------------------------------------------------------------------------------- trying rules

    async def judge(
        self,
        rules: Sequence[Rule],
        *,
        on_begin: Callable[[Rule], None] | None = None,
        on_verdict: Callable[[Verdict], None] | None = None,
    ) -> list[Verdict]:
        """Try rules, one after the other. Cancelling ends it; leaving the bench then stops laser and motor.

        Args:
            rules: The rules.
            on_begin: Called before each.
            on_verdict: Called behind each.
        """
        verdicts = list[Verdict]()
        for rule in rules:
            if on_begin is not None:
                on_begin(rule)
            verdict = await self.try_rule(rule)
            verdicts.append(verdict)
            if on_verdict is not None:
                on_verdict(verdict)
        return verdicts

    async def try_rule(self, rule: Rule) -> Verdict:
        """Try one rule, and bring the device to rest behind it. Raises nothing but what cancels it."""
        began = self.now()
        self._figures.clear()
        outcome, text = await self._try(rule)
        seconds = self.now() - began
        with suppress(LidarError, TimeoutError):
            async with asyncio.timeout(REST_S):
                await self.rest()
        return Verdict(rule, outcome, text, seconds, tuple(self._figures))

    async def _try(self, rule: Rule) -> tuple[Outcome, str]:
        if self._is_lost():
            return Outcome.NOT_TRIED, "the line to the device is lost"
        missing = [need.value for need in rule.needs if not self._can(need)]
        if missing:
            return Outcome.NOT_TRIED, missing[0]
        limit = asyncio.timeout(rule.limit_s)
        try:
            async with limit:
                text = await rule.check(self)
            # On a dead line it is quiet, too.
            if self._is_lost():
                return Outcome.BROKEN, "the line to the device was lost meanwhile"
            return Outcome.HELD, text
        except Broken as error:
            return Outcome.BROKEN, str(error)
        except (NotTried, Unsupported) as error:
            return Outcome.NOT_TRIED, str(error)
        except LidarError as error:
            return Outcome.BROKEN, f"{type(error).__name__}: {error}"
        except TimeoutError:
            if not limit.expired():
                raise
            return Outcome.BROKEN, f"nothing was decided within {rule.limit_s:g} s"

    def _is_lost(self) -> bool:
        return not self.lidar.is_connected

    def _can(self, need: Need) -> bool:
        device = self.dialogue.device
        try:
            if need is Need.HEALTH:
                return self.lidar.health.status is not HealthStatus.ERROR
            if need is Need.ANSWERS:
                return self.question() is not None
            if need is Need.STOPS:
                return device.can_be_stopped
            if need is Need.RESETS:
                device.reset()
            else:
                device.scan_frequency_range().close()
        except Unsupported:
            return False
        return True

    # ------------------------------------------------------------------------------------------ what checks use

    def now(self) -> float:
        """Seconds of the event loop's clock."""
        return self._loop.time()

    def measured(self, name: str, value: float, unit: str) -> None:
        """Note a figure of the rule that is tried; the arguments are those of `Figure`."""
        if isfinite(value):
            self._figures.append(Figure(name, value, unit))

    def question(self) -> Request | None:
        """What the device is asked first, to say what it is; None of one that only talks."""
        script = self.dialogue.device.identify()
        request = next(script, None)
        # A control line may have to be set first.
        while request is not None and request.expects is None and request.stream is None:
            request = script.send(b"")
        script.close()
        return None if request is None or request.stream is not None else request

    async def ask_once(self, request: Request) -> float:
        """Ask, once, as soon as the device must listen; returns the seconds until its response."""
        self.dialogue.begin()
        began = self.now()
        await self.dialogue.ask(replace(request, attempts=1))
        return self.now() - began

    async def ask(self, script: Script[T]) -> tuple[T, dict[str, float]]:
        """Run a script, with each request written once; returns its result, and the seconds of each request."""
        times: dict[str, float] = {}

        async def asked(request: Request) -> bytes:
            began = self.now()
            payload = await self.dialogue.ask(replace(request, attempts=1))
            times[request.name] = max(self.now() - began, times.get(request.name, 0.0))
            return payload

        self.dialogue.begin()
        return await play(script, asked), times

    async def flow(self, mode: ScanMode) -> Flow:
        """Start the stream of a mode, below the session; returns when its first packet is there. End it by `rest`.

        Raises:
            Broken: No packet came in the time that the family gives the rotor.
            Unsupported: The format of the mode is not known.
        """
        began = self.now()
        self.dialogue.begin()
        stream = await self.dialogue.run(self.dialogue.device.start(mode))
        flow = Flow(mode, stream, self.dialogue.stats, began, self.now() - began)
        self.dialogue.deliver_to(flow.take)
        try:
            async with asyncio.timeout(stream.spin_up_s):
                await flow.first.wait()
        except TimeoutError:
            raise Broken(f"no packet within {stream.spin_up_s:g} s") from None
        flow.first_s = self.now() - flow.began
        return flow

    async def is_silent(self) -> str:
        """Listen to a device that must send nothing; returns how long it was listened to.

        Raises:
            Broken: Bytes came, later than an adapter or a network may hold them back.
        """
        await asyncio.sleep(SETTLE_S)
        before = self.received
        await asyncio.sleep(LISTEN_S)
        if self.received > before:
            raise Broken(f"{self.received - before} bytes came within {LISTEN_S} s")
        return f"nothing came within {LISTEN_S} s"

    async def watches(self) -> list[Watch]:
        """What each scan mode has sent, in the order of the modes; each is looked at once."""
        if self._watches is None:
            self._watches = [await collect(self, mode) for mode in await self.lidar.get_modes()]
        return self._watches

    async def typical(self) -> ScanMode:
        """The mode that the device recommends, or the first."""
        modes = await self.lidar.get_modes()
        return next((mode for mode in modes if mode.typical), modes[0])

    async def rest(self) -> None:
        """Leave laser and motor off; returns when that was seen."""
        await self.lidar.stop()
        # Of a stream that was started below the session.
        self.dialogue.stop_device()
        await self.dialogue.stopper.surely_settled()

    def _see(self, way: str, data: bytes, now: int) -> None:
        if way == "in":
            self.last_in, self.received = now * 1e-9, self.received + len(data)


async def open_bench(
    source: str | os.PathLike[str] | SimulatedDevice = "auto",
    *,
    family: str | None = None,
    baudrate: int | None = None,
    on_port: Callable[[Port], None] | None = None,
) -> Bench:
    """Open a device and put it on a bench, whose context manager leaves it still.

    Args:
        source: As for `lidario.open_lidar`, but no recording and no lidar of another machine.
        family: As for `lidario.open_lidar`.
        baudrate: As for `lidario.open_lidar`.
        on_port: Called with the port of a named source, open, before anything is written to it.

    Raises:
        InvalidValue: The source is no line to a device.
        LidarError: As `lidario.open_lidar`; but a device that protects itself is opened, and its motor not started.
    """
    where = as_source(source)
    check_source(where, family)
    if where.kind in ("file", "zenoh"):
        raise InvalidValue("rules are tried on a device: give its port, its address or a simulated one")
    with await search_for(where):
        found = await find_source(where, family)
        connection = await connect(found, family, baudrate, on_port=on_port)
        try:
            check_family(found, family, connection.info.family)
            try:
                health = await healthy(connection.dialogue)
            except DeviceFault as error:
                health = error.health
            return Bench(connection, health, found, where.device)
        except BaseException:
            await connection.dialogue.close()
            raise
