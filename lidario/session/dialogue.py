"""The host's side of the conversation: requests with their timing, answers with their waiters.

Between `Link`, which knows no time, and `Lidar`, which knows no bytes. It runs the scripts of a family, one
request at a time; keeps silent as long as the last request demands; asks again where that is harmless; and
ends every waiter when the port dies. Timers, not cancel scopes, bound the waiting, so it behaves the same under
native cancellation and anyio's.
"""

from __future__ import annotations

import asyncio
import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import TypeVar

from lidario.errors import DeviceLost, ResponseTimeout
from lidario.families.base import Device, Script, Timing
from lidario.port.port import Port
from lidario.wire.envelope import Request
from lidario.wire.events import Event, Packets, Response
from lidario.wire.link import Link, LinkState

__all__ = ["Dialogue"]

T = TypeVar("T")
_EARLY_LIMIT = 64
"""Runs of packets kept between the answer to a start and the moment somebody takes them."""
_MARGIN_S = 0.005
"""Added to every demanded silence: an adapter may deliver one request late and the next on time."""


class Dialogue:
    """Talks to one device over one port.

    Attributes:
        link: The state machine in the middle, for its statistics.
        port: The line.
        on_packets: Called with each run of packets; None keeps the first few until somebody is named.
        on_lost: Called once when the port dies.
        fatal: What ended the conversation for good, if anything.
    """

    def __init__(self, port: Port, device: Device, timing: Timing) -> None:
        self.link = Link()
        self.port = port
        self.on_lost: Callable[[DeviceLost], None] | None = None
        self.fatal: DeviceLost | None = None
        self._device = device
        self._timing = timing
        self._loop = asyncio.get_running_loop()
        self._waiter: asyncio.Future[bytes] | None = None
        self._on_packets: Callable[[Packets], None] | None = None
        self._early: list[Packets] = []
        self._silent_until = 0.0
        self._patience = math.inf
        self._halt_again: asyncio.TimerHandle | None = None
        self._hang_up = False
        port.attach(self)

    @property
    def on_packets(self) -> Callable[[Packets], None] | None:
        """Called with each run of packets."""
        return self._on_packets

    @on_packets.setter
    def on_packets(self, callback: Callable[[Packets], None] | None) -> None:
        self._on_packets = callback
        early, self._early = self._early, []
        if callback is not None:
            for packets in early:
                callback(packets)

    def data_received(self, data: bytes, now: int, arrivals: Sequence[tuple[int, int]] = ()) -> None:
        """As `Receiver`. A mistake of ours ends the conversation: it must not leave readers waiting."""
        try:
            begin = 0
            if arrivals:
                self.link.hold(now)
            for end, at in arrivals:
                self.link.receive_data(data[begin:end], at)
                begin = end
            self.link.receive_data(data[begin:], now)
            for event in self.link.events_received():
                self._handle(event)
        except Exception as error:
            failure = DeviceLost(f"lidario failed at what the device sent ({error!r}); please report this")
            failure.__cause__ = error
            self.fail(failure)

    def connection_lost(self, error: DeviceLost | None) -> None:
        """As `Receiver`."""
        if error is not None:
            self.fail(error)

    def fail(self, error: DeviceLost) -> None:
        """End the conversation; the first error wins."""
        if self.fatal is not None:
            return
        self.fatal = error
        if self._waiter is not None and not self._waiter.done():
            self._waiter.set_exception(error)
        if self.on_lost is not None:
            self.on_lost(error)

    def hurry(self, patience: float | None) -> None:
        """Wait at most `patience` seconds for each answer, while probing; None for as long as is usual."""
        self._patience = math.inf if patience is None else patience

    def send(self, request: Request) -> None:
        """Write one request now, whole; the caller has seen to it that the device listens."""
        self.link.send_request(request)
        self.port.write(self.link.data_to_send())
        if request.settle:
            self._silent_until = max(self._silent_until, self._loop.time() + request.settle + _MARGIN_S)

    async def ask(self, request: Request) -> bytes:
        """Send a request when the device listens; return the payload of its answer, empty if it has none.

        Cancelling gives up the answer; should it still come, it is counted and thrown away.

        Raises:
            ResponseTimeout: No answer, however often it was asked.
            DeviceLost: The port died.
        """
        noise = self.link.stats.stray_bytes
        timeout = min(request.timeout, self._patience)
        for _ in range(request.attempts):
            await self._listened_to()
            if request.expects is None:
                self.send(request)
                return b""
            waiter: asyncio.Future[bytes] = self._loop.create_future()
            self._waiter = waiter
            self.send(request)
            timer = self._loop.call_later(timeout, _time_out, waiter)
            try:
                payload = await waiter
            except TimeoutError:
                continue
            finally:
                timer.cancel()
                self._waiter = None
                self.link.give_up()
            return payload
        raise ResponseTimeout(request.name, timeout, self.link.stats.stray_bytes - noise)

    async def run(self, script: Script[T]) -> T:
        """Hold the conversation that `script` writes down, and return what it makes of it.

        Raises:
            Whatever the script raises, and what `ask` raises unless the script catches it.
        """
        try:
            request = next(script)
            while True:
                try:
                    payload = await self.ask(request)
                except ResponseTimeout as timeout:
                    request = script.throw(timeout)
                else:
                    request = script.send(payload)
        except StopIteration as stop:
            result: T = stop.value
            return result
        finally:
            script.close()

    async def quieten(self) -> bool:
        """Send STOP and wait until the line is quiet; False if it did not fall quiet in time."""
        await self._listened_to()
        self.send(self._device.stop())
        self.on_packets = None
        self._early.clear()
        await self._listened_to()
        deadline = self._loop.time() + self._timing.drain_s
        while True:
            seen = self.link.stats.bytes_received
            await asyncio.sleep(self._timing.quiet_s)
            self._check()
            if self.link.stats.bytes_received == seen:
                self.link.drained()
                return True
            if self._loop.time() > deadline:
                return False

    def halt(self, requests: tuple[Request, ...]) -> None:
        """Write `requests` at once, whatever is going on, and end the stream here too. Never blocks or raises.

        Where the last request demands silence, the device will not hear them, so they are written once more when
        it listens again; `halted` waits for that.
        """
        if not requests:
            return
        for request in requests:
            self.link.send_request(replace(request, ends_stream=True))
        words = self.link.data_to_send()
        self.port.write(words)
        self.on_packets = None
        self._early.clear()
        if self._loop.is_closed():
            return
        now = self._loop.time()
        if now < self._silent_until and self._halt_again is None:
            self._halt_again = self._loop.call_at(self._silent_until, self._write_again, words)
        else:
            self._silent_until = now + max(request.settle for request in requests) + _MARGIN_S

    def hang_up(self) -> None:
        """Close the port: at once, or when the words of `halt` have been said where the device could hear them."""
        self.port.announce_close()
        if self._halt_again is None:
            self.port.close_soon()
        else:
            self._hang_up = True

    async def halted(self) -> None:
        """Return when the words of `halt` have been said where the device could hear them."""
        if self._halt_again is not None:
            await asyncio.sleep(max(0.0, self._halt_again.when() - self._loop.time()))
            # The timer of the words themselves was due no later; let it run first.
            await asyncio.sleep(0)

    def _write_again(self, words: bytes) -> None:
        self._halt_again = None
        self.port.write(words)
        if self._hang_up:
            self.port.close_soon()

    async def _listened_to(self) -> None:
        """Wait until the device accepts a request again."""
        self._check()
        while (wait := self._silent_until - self._loop.time()) > 0:
            await asyncio.sleep(wait)
            self._check()

    def _check(self) -> None:
        if self.fatal is not None:
            raise DeviceLost(str(self.fatal)) from self.fatal

    def _handle(self, event: Event) -> None:
        if isinstance(event, Packets):
            if self._on_packets is not None:
                self._on_packets(event)
            elif self.link.state is LinkState.STREAMING and len(self._early) < _EARLY_LIMIT:
                self._early.append(event)
        elif self._waiter is not None and not self._waiter.done():
            if isinstance(event, Response):
                self._waiter.set_result(event.payload)
            elif self.link.state is LinkState.STREAMING:
                self._waiter.set_result(b"")


def _time_out(waiter: asyncio.Future[bytes]) -> None:
    if not waiter.done():
        waiter.set_exception(TimeoutError())
