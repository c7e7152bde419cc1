"""A stream brings no scans: the device is asked how it is before anybody is told, and started again if that helps.

A device that has stopped to protect itself, one whose supply was cut, and one that waits for a keepalive look the
same: silent. So it is stopped, and asked for its health, or at least what it is.

* It reports an error: it has stopped to protect itself (Protection Stop). A RESET cures that mostly. It is sent
  once; when another error follows within a minute, `DeviceFault` ends the stream, since repeated Protection Stops
  may be a sign of lasting damage (S-series interface manual, GET_HEALTH).
* It is well, and the stream had brought scans, or its start had no response: the stream is started again, three
  times a minute at most. That happens where power-down protection has stopped the device, and where a damaged line
  has lost the start. Nothing at all in response to a mode that the device does not list is no damage.
* It is well, but the stream had brought nothing, or packets come without a revolution: `StreamFailed`.
* It does not respond: `StreamFailed`.

Each RESET and each restart is logged as a warning and counted in `Stats`.
"""

from __future__ import annotations

import asyncio
import math
from collections import deque

from lidario.errors import DeviceFault, ResponseTimeout, StreamFailed
from lidario.model import Health, HealthStatus
from lidario.session.finding.connection import At
from lidario.session.streaming.running import Failure, Totals
from lidario.session.talking.handshake import cured, fault_of

ASK_S = 0.25
"""Time for the questions to a device that has fallen silent; a healthy one responds within milliseconds."""
NETWORK_ASK_S = 0.5
"""The same where the line has no speed."""
WELL_S = 5.0
"""For so long what a device has said of itself, or a stream that it has sent, tells that it is well."""
PERIOD_S = 60.0
MOST_RESTARTS = 3
"""In `PERIOD_S`. More would hide that the stream breaks off again and again."""


class Inquiry:
    """Asks one device what is wrong with it.

    Attributes:
        health: What the device last said.
        doubtful: Whether the device is to be asked before the next stream, since the last one failed.
    """

    def __init__(self, at: At, totals: Totals) -> None:
        self.doubtful: bool = False
        self._well_at = -math.inf
        self.health: Health = Health(HealthStatus.OK, 0)
        self._at = at
        self._totals = totals
        self._loop = asyncio.get_running_loop()
        self._reset_at: float | None = None
        self._restarts: deque[float] = deque(maxlen=MOST_RESTARTS)

    def take_note(self, health: Health) -> None:
        """The device has said how it is; where that is an error, it is asked before the next stream is started."""
        self.health = health
        self.doubtful |= not health.ok
        self._well_at = self._loop.time()

    async def about(self, failure: Failure) -> None:
        """Ask the device, which must not stream any more; return if the stream shall be started again.

        Raises:
            DeviceFault: It has stopped to protect itself, and a RESET did not help or would be one too many.
            StreamFailed: It is silent, or it is well and a restart promises nothing.
        """
        self.doubtful = True
        health = await self._health()
        if health is None:
            if failure.sends:
                raise StreamFailed(f"{failure.what}: {failure.cause}")
            raise StreamFailed(
                f"{failure.what}, and it responds to no request: is it powered, and is the cable in?"
            )
        if not health.ok:
            now = self._loop.time()
            if self._reset_at is not None and now - self._reset_at < PERIOD_S:
                self._at.dialogue.protection_stops += 1
                raise fault_of(health, f"again within {PERIOD_S:.0f} s of a reset")
            self._reset_at = now
            await self._cure(health, failure.what)
        elif not (
            await self._at.dialogue.run(self._at.dialogue.device.explain_silence(failure.lasted_s))
            or failure.restart
        ):
            raise StreamFailed(
                f"{failure.what}, though it responds and its health is {_named(health)}: {failure.cause}"
            )
        now = self._loop.time()
        if len(self._restarts) == MOST_RESTARTS and now - self._restarts[0] < PERIOD_S:
            raise StreamFailed(
                f"{failure.what}, the fourth time within {PERIOD_S:.0f} s, though it responds and its health is "
                f"{_named(health)}: {failure.cause}"
            )
        self._restarts.append(now)
        self._totals.restarts += 1
        self._at.trouble.tell("the stream is started again: %s", failure.what)
        self.doubtful = False

    async def beforehand(self, ran_until: float) -> None:
        """Ask the device before a stream is started, as the vendors' manuals have it.

        It need not be asked where it has said how it is, or has sent a stream that did not fail, a moment ago.
        `ran_until` is when the last stream was left off.

        Raises:
            DeviceFault: It has stopped to protect itself, and a RESET did not help.
        """
        if not self.doubtful and self._loop.time() - max(self._well_at, ran_until) <= WELL_S:
            return
        health = await self._health()
        if health is not None and not health.ok:
            self._reset_at = self._loop.time()
            await self._cure(health, "before a stream was started")
        self.doubtful = False

    async def _cure(self, health: Health, when: str) -> None:
        try:
            self.take_note(await cured(self._at.dialogue, health, when))
        except ResponseTimeout as error:
            raise fault_of(health, f"and did not come back from a reset: {error}") from error
        except DeviceFault as error:
            self.health = error.health
            raise

    async def _health(self) -> Health | None:
        """Its health, or a warning if it says at least what it is; None if it does not respond at all."""
        ask_s = max(ASK_S if self._at.dialogue.port.baudrate else NETWORK_ASK_S, self._at.dialogue.device.rests_s)
        self._at.dialogue.hurry(until=self._loop.time() + ask_s)
        try:
            self.take_note(await self._at.dialogue.run(self._at.dialogue.device.health()))
        except ResponseTimeout:
            try:
                await self._at.dialogue.run(self._at.dialogue.device.identify())
            except ResponseTimeout:
                return None
            self.health = Health(HealthStatus.WARNING, 0, "it does not tell its health")
        finally:
            self._at.dialogue.hurry()
        return self.health


def _named(health: Health) -> str:
    return health.status.value if not health.code else f"{health.status.value}, code {health.code}"
