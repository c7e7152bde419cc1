"""What becomes of a stream, or of the session, when something has failed.

* A stream brings no scans: the device is asked. Then the stream is started again, or ends for every reader; the
  session goes on.
* A stream could not be started: the same.
* The port died: the session is over.

Where the session comes back by itself (`Reconnector`), and a new line may cure what has failed, none
of these ends anything: the line is let go of, and the readers wait.

A device that has stopped to protect itself, one whose supply was cut, and one that waits for a keepalive look the
same: silent. So it is stopped, and asked for its health, or at least what it is.

* It reports an error: it has stopped to protect itself (Protection Stop). A RESET cures that mostly. It is sent
  once; when another error follows within a minute, `DeviceFault` ends the stream, since repeated Protection Stops
  may be a sign of lasting damage (S-series interface manual, GET_HEALTH).
* It is well, and the stream had brought packets, or its start had no response: the stream is started again, three
  times a minute at most. That happens where power-down protection has stopped the device, where the current of the
  motor's start was too much for its supply, and where a damaged line has lost the start. Nothing at all in response
  to a mode that the device does not list is no damage.
* It is well, but the stream had brought nothing, or packets come without a revolution: `StreamFailed`.
* It does not respond: `StreamFailed`.

Each RESET and each restart is logged as a warning and counted in `Stats`.
"""

import asyncio
import math
from collections import deque
from collections.abc import Callable

from lidario.basics.model import Health, HealthStatus
from lidario.errors import (
    DeviceFault,
    DeviceLost,
    LidarError,
    RemoteProtocolError,
    ResponseTimeout,
    SessionClosed,
    StreamFailed,
)
from lidario.session.finding.connection import At
from lidario.session.streaming.control import StreamControl
from lidario.session.streaming.line_changes import LineWatch
from lidario.session.streaming.readers import Hub
from lidario.session.streaming.running import Failure
from lidario.session.streaming.states import State
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
_CURABLE = (DeviceLost, StreamFailed, ResponseTimeout, DeviceFault, RemoteProtocolError)
"""What a new line to the same device may cure; not what the user or lidario did wrong."""


class Failures:
    """Judges what has failed, and asks the device what is wrong with it."""

    def __init__(self, control: StreamControl, at: At, hub: Hub, line: LineWatch) -> None:
        # Called with the reason, and the number of scans so far, when the line to the device is no good any more.
        # None where such an error ends the streams or the session.
        self.come_back: Callable[[LidarError, int], None] | None = None
        self._control = control
        self._at = at
        self._hub = hub
        self._line = line
        self._doubtful = False
        self.health: Health = Health(HealthStatus.OK, 0)  # what the device last said
        self._well_at = -math.inf
        self._loop = asyncio.get_running_loop()
        self._reset_at: float | None = None
        self._restarts: deque[float] = deque(maxlen=MOST_RESTARTS)
        at.dialogue.on_lost = self._lost

    def adopt(self) -> None:
        """The device is reached by another line from now on."""
        self._doubtful = False
        self._at.dialogue.on_lost = self._lost
        self._line.tell("back")

    def take_note(self, health: Health) -> None:
        """The device has said how it is; where that is an error, it is asked before the next stream is started."""
        self.health = health
        self._doubtful |= not health.ok
        self._well_at = self._loop.time()

    async def judge(self) -> None:
        """If a stream has failed, ask the device; then have the stream started again, or end it with the reason."""
        failure = self._control.failure
        if failure is None:
            return
        try:
            await self._control.interrupt()
            await self._ask_about(failure)
        except (StreamFailed, DeviceFault) as error:
            if failure.error is not None and isinstance(error, StreamFailed):
                self.could_not_start(failure.error)
            else:
                self._fail(error)
        else:
            self._control.leave_off()
        finally:
            self._control.failure = None

    async def ask_beforehand(self) -> None:
        """Ask the device before a stream is started, as the vendors' manuals have it.

        It need not be asked where it has said how it is, or has sent a stream that did not fail, a moment ago.

        Raises:
            DeviceFault: It has stopped to protect itself, and a RESET did not help.
        """
        if not self._doubtful and self._loop.time() - max(self._well_at, self._control.ran_until) <= WELL_S:
            return
        health = await self._health()
        if health is not None and not health.ok:
            self._reset_at = self._loop.time()
            await self._cure(health, "before a stream was started")
        self._doubtful = False

    def suspect(self, failure: Failure) -> None:
        """The stream brings no scans: the device is to be asked, by `judge`.

        Where noise arrives, no response would be understood: the stream ends.
        """
        if failure.noise:
            why = "; only noise arrives: is the baud rate right?"
            if counted := self._at.dialogue.errors.meaning():
                why = f"; only noise arrives, with {counted}"
            self._fail(StreamFailed(failure.what + why))
        else:
            self._control.failure = failure
            self._doubtful = True

    def could_not_start(self, error: LidarError) -> None:
        """Tell everybody who waits for the stream, unless the session comes back."""
        if self._depart(error):
            return
        if self._control.ran:
            failure = StreamFailed(f"the stream could not be started again: {error}")
            failure.__cause__ = error
            error = failure
        self._hub.end(error)
        if self._control.is_scanning:
            self._control.unwant()

    def end(self, error: LidarError) -> None:
        """The session is over: end every reader and operation with `error`. The device is not told."""
        self._hub.end(error)
        self._control.close()
        self._at.dialogue.end(error)
        self._at.dialogue.interrupt(error)
        if not isinstance(error, SessionClosed):
            self._line.tell("ended", str(error))
        self._line.end()

    def _fail(self, error: StreamFailed | DeviceFault) -> None:
        """End the stream for everybody, unless the session comes back; the session goes on."""
        if self._depart(error):
            return
        self._at.trouble.tell("the stream ended: %s", error)
        self._hub.end(error)
        self._control.unwant()

    def _lost(self, error: LidarError) -> None:
        """The port died, or we failed: the session is over, unless it comes back."""
        if self._depart(error):
            return
        self._at.trouble.tell("the session ended: %s", error)
        self.end(error)

    def _depart(self, error: LidarError) -> bool:
        """Let go of the line, if the session can come back from `error`; readers go on waiting.

        False where it cannot: then `error` ends the streams, or the session.
        """
        if self._control.is_away:
            return True
        if self.come_back is None or self._control.state is State.CLOSED or not isinstance(error, _CURABLE):
            return False
        if not self._control.is_scanning and not isinstance(error, DeviceLost):
            return False
        self._control.lose(error)
        self._line.tell("away", str(error))
        self.come_back(error, self._control.totals.assembled.scans)
        return True

    async def _ask_about(self, failure: Failure) -> None:
        """Ask the device, which must not stream any more; return if the stream shall be started again.

        Raises:
            DeviceFault: It has stopped to protect itself, and a RESET did not help or would be one too many.
            StreamFailed: It is silent, or it is well and a restart promises nothing.
        """
        self._doubtful = True
        health = await self._health()
        if health is None:
            if failure.sends:
                raise StreamFailed(f"{failure.what}: {failure.cause}")
            raise StreamFailed(f"{failure.what}, and it says nothing at all: is it powered, and is the cable in?")
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
        self._control.totals.restarts += 1
        self._at.trouble.tell("the stream is started again: %s", failure.what)
        self._doubtful = False

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
