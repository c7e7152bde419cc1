"""Coming back: a session whose line was lost finds its device again, and goes on.

* The old line is closed. Where it still works, the stop requests are written first.
* The places are tried where the device may be (`Places`). It is known by its own serial number. It is asked how it
  is, reset if it protects itself, and gets its settings back.
* Where nothing was found, the next attempt follows, later each time.
* When the user's limit has passed, the session ends with `DeviceLost`, among whose causes is the first error.

Unplugging, a TCP connection that is reset, a device that restarts or freezes and one that stops to protect itself
all take this one way. So it needs no judgement of what has happened, which nobody can make from a silent line.

`Failures` says when the line is no good any more, `Lidar` takes the new one over. The attempts run in one task. It
holds no reference to the `Lidar`, so a session that nobody holds any more is collected also while it is away.
"""

from __future__ import annotations

import asyncio
import logging
import math
from collections.abc import Awaitable, Callable
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING

from lidario.basics.arguments import finite, number, shown
from lidario.basics.model import Health
from lidario.basics.source import Source
from lidario.errors import ConnectFailed, DeviceLost, InvalidValue, LidarError, LocalProtocolError
from lidario.families.base import Device, Script
from lidario.port.background import begin_task
from lidario.session.finding.connect import connect
from lidario.session.finding.connection import Connection
from lidario.session.finding.places import Places
from lidario.session.talking.dialogue import Dialogue
from lidario.session.talking.handshake import healthy
from lidario.session.talking.trouble import mistake_of_ours, twin_of

if TYPE_CHECKING:
    from lidario.port.simulated import Simulation

_log = logging.getLogger("lidario")

_MOST_REASONS = 16
"""So many different reasons are logged while the device is away."""
_NO_SERIAL = frozenset("0F[] ")
"""Serial numbers of these characters alone are unprogrammed memory: they tell no device from another."""


@dataclass(frozen=True, slots=True)
class Reconnect:
    """How a session comes back when it has lost its device: ``open_lidar(..., reconnect=Reconnect(limit_s=60))``.

    Attributes:
        limit_s: Seconds after which it gives up, counted from the loss until scans come again, or, where no stream
            is wanted, until the device responds; infinite by default.
        first_wait_s: Seconds between the first attempt and the second. Each later wait is twice as long.
        longest_wait_s: Longest wait. With half a second the stream goes on within two seconds of the moment at
            which the device responds again.

    Raises:
        InvalidValue: No numbers, or not above 0, or a longest wait below the first.
    """

    limit_s: float = math.inf
    first_wait_s: float = 0.1
    longest_wait_s: float = 0.5

    def __post_init__(self) -> None:
        try:
            limit_s, first_s = number(self.limit_s, "limit_s"), finite(self.first_wait_s, "first_wait_s")
            fine = limit_s > 0 and 0 < first_s <= finite(self.longest_wait_s, "longest_wait_s")
        except InvalidValue:
            limit_s, fine = math.nan, False
        if not fine:
            raise InvalidValue(f"{shown(self)}: the limit and the waits are seconds above 0, the first the least")
        object.__setattr__(self, "limit_s", limit_s)  # clocks cannot add a whole number of any size


class Reconnector:
    """Brings one session back, as often as it is needed; never, where there is no policy."""

    unused: Callable[[], Awaitable[None]]  # returns when nobody uses the line that was lost; the session sets it

    def __init__(self, policy: Reconnect | None, source: Source) -> None:
        self.comes_back: bool = policy is not None
        self.count: int = 0  # how often the session has come back
        # What the user has set, in the order of setting: each makes the script that sets it again.
        self.settings: dict[str, Callable[[Device], Script[object]]] = {}
        self._policy = policy or Reconnect()
        self._places = Places(source)
        self._simulation: Simulation | None = None
        self._loop = asyncio.get_running_loop()
        self._task: asyncio.Task[None] | None = None
        self._dialogue: Dialogue | None = None
        self.proven: bool = True  # whether the session works: then the next loss is a new one
        self._scans = 0
        # Returns the function that takes over a new line; None when the session is gone.
        self.adopt: Callable[[], Callable[[Connection, Health], None] | None] = lambda: None
        # Called with the error that ends the session, unless `cancel` or `abandon` came before.
        self.gave_up: Callable[[LidarError], None] | None = None

    async def connect(self, source: Source, family: str | None, baudrate: int | None, *, guard: bool) -> Connection:
        """Connect for the first time, and note which device it is, as `lidario.session.finding.connect.connect`."""
        if not self.comes_back:
            return await connect(source, family, baudrate, guard=guard)
        if source.kind == "sim":
            from lidario.port.simulated import Simulation  # a fifth of the import time, for those who need it

            self._simulation = Simulation(source, lasting=True)
        await self._places.begin()
        self._connect = partial(connect, simulation=self._simulation, guard=guard)
        self._known = await self._connect(source, family, baudrate)
        self._first_speed = self._known.dialogue.port.baudrate
        return self._known

    def begin(self, error: LidarError, scans: int) -> None:
        """The line is no good any more, because of `error`: come back, in a task. Not to be called while it does.

        Where none of the session's `scans` came since it was back the last time, that was not a success: the time
        goes on counting, and the waits go on growing.
        """
        if scans > self._scans:
            self.proven, self._scans = True, scans
        if self.proven:
            self._first, self._since, self._attempts = error, self._loop.time(), 0
            self._wait_s, self._why, self._told = self._policy.first_wait_s, "", set[str]()
            _log.warning("the line to the lidar is lost, and the session comes back: %s", error)
        self._task = begin_task(self._loop, self._run(), "lidario: come back")
        self._task.add_done_callback(self._ended)

    def away_error(self) -> DeviceLost:
        """What calls raise that cannot be done without the device."""
        away = self._loop.time() - self._since
        error = DeviceLost(
            f"the lidar has been away for {away:.1f} s; the session is about to come back: ask again"
        )
        error.__cause__ = self._first
        return error

    def cancel(self) -> None:
        """Come back no more. What is half connected is left still and closed by the task, see `ended`."""
        self.gave_up = None
        if self._task is not None:
            self._task.cancel()

    async def ended(self) -> None:
        """Return when the task has ended, about a second after `cancel`, and let go of a simulated device.

        Cancelling ends only the waiting.
        """
        if self._task is not None:
            await asyncio.wait([self._task])
        self.release()

    def abandon(self) -> None:
        """Nobody holds the session any more: leave the device still, in any thread and without a loop."""
        task, self.gave_up = self._task, None
        if task is not None and not task.done() and self._loop.is_running():
            # The task leaves the device still with the pauses that it needs, and blocks nobody.
            with suppress(RuntimeError):  # the loop was closed just now
                self._loop.call_soon_threadsafe(task.cancel)
        elif self._dialogue is not None:
            self._dialogue.abandon()
        self.release()

    def release(self) -> None:
        """Let go of the simulated device, if it is one; it ends when no port to it is open. Never raises."""
        if self._simulation is not None:
            try:
                self._simulation.end()
            except RuntimeError:
                _log.warning("ending the simulated device failed", exc_info=True)

    # ------------------------------------------------------------------------------------------------ the task

    async def _run(self) -> None:
        limit = self._policy.limit_s
        deadline = None if math.isinf(limit) else self._since + limit
        try:
            async with asyncio.timeout_at(deadline):
                # The line is closed; the device is stopped when it was found again.
                await self._known.dialogue.close(patient=False)
                await self.unused()
                found = await self._attempt() if self.proven else None
                while found is None:
                    await self._wait()
                    found = await self._attempt()
        except TimeoutError:
            self._give_up()
        except Exception as error:
            self._end_with(mistake_of_ours("lidario failed when it looked for the lidar", error))
        else:
            # Nothing is awaited from here on: `cancel` comes either before, and then there is no connection, or
            # after, and then the session has taken it over.
            self._take_over(*found)

    def _ended(self, task: asyncio.Task[None]) -> None:
        """Where the program has cancelled all tasks and goes on, no reader waits for ever."""
        if task.cancelled() and self.gave_up is not None:
            self._end_with(LocalProtocolError("the program has cancelled the task that brings the session back"))

    async def _wait(self) -> None:
        wait, self._wait_s = self._wait_s, min(2 * self._wait_s, self._policy.longest_wait_s)
        await asyncio.sleep(wait)

    async def _attempt(self) -> tuple[Connection, Health] | None:
        """Try every place once; None when the device is at none of them."""
        self._attempts += 1
        try:
            places = await self._places.candidates()
        except ConnectFailed as error:
            self._tell(str(error))
            return None
        for place in places:
            for speed in self._speeds():
                try:
                    return await self._reach(place, speed)
                except LidarError as error:
                    self._tell(f"{place.address or place.text}: {error}")
                    if not isinstance(error, ConnectFailed) or error.reason != "silent":
                        break
                finally:
                    self._dialogue = None
            else:
                self._places.silent(place)
        return None

    def _speeds(self) -> list[int]:
        """At which it may be: the one that it had last, and, where that was set, the one at which it was found."""
        return list(dict.fromkeys((self._known.dialogue.port.baudrate, self._first_speed)))

    async def _reach(self, place: Source, speed: int) -> tuple[Connection, Health]:
        """Connect to the device at `place`, and make it as it was; `speed` is 0 where the line has none."""
        known = self._known
        connection = await self._connect(place, known.info.family, speed, patient=False, on_dialogue=self._began)
        dialogue = connection.dialogue
        try:
            if connection.info.serial != known.info.serial or self._nameless(place):
                self._places.refuse(place)
                found = f"{connection.info.model} with the serial number {connection.info.serial}"
                raise ConnectFailed(
                    f"another lidar responds, {found}, and not {known.info.serial}", reason="missing"
                )
            health = await healthy(dialogue)
            for setting in list(self.settings.values()):
                await dialogue.run(setting(dialogue.device))
            if dialogue.fatal is not None:
                raise twin_of(dialogue.fatal)
        except BaseException:
            await dialogue.close()
            raise
        self._places.last = place
        return connection, health

    def stop_motor_too(self) -> None:
        """The motor is left on no more, nor is that of a device which is just being reached."""
        if self._dialogue is not None:
            self._dialogue.stopper.stop_motor_too()

    def _began(self, dialogue: Dialogue) -> None:
        dialogue.stopper.keep_spinning = self._known.dialogue.stopper.keep_spinning
        self._dialogue = dialogue

    def _nameless(self, place: Source) -> bool:
        """Whether the serial number tells nothing, and the place is one that only the number could confirm."""
        return not set(self._known.info.serial) - _NO_SERIAL and not self._places.is_own(place)

    def _take_over(self, connection: Connection, health: Health) -> None:
        self.count += 1
        self._known, self.proven = connection, False
        place, away = connection.dialogue.port.name, self._loop.time() - self._since
        attempts = f"{self._attempts} attempt{'s' if self._attempts != 1 else ''}"
        _log.warning("the lidar is back on %s, after %.1f s and %s", place, away, attempts)
        adopt = self.adopt()
        if adopt is None:
            connection.dialogue.hang_up()
        else:
            adopt(connection, health)

    def _give_up(self) -> None:
        error = DeviceLost(
            f"the lidar did not come back within {self._policy.limit_s:g} s ({self._attempts} attempts)"
            + (f"; the last one: {self._why}" if self._why else "")
        )
        error.__cause__ = self._first
        self._end_with(error)

    def _end_with(self, error: LidarError) -> None:
        _log.warning("the session ended: %s", error)
        self.release()
        if self.gave_up is not None:
            self.gave_up(error)

    def _tell(self, reason: str) -> None:
        """Log why an attempt failed, unless one before failed for the same reason: two places may take turns."""
        self._why = reason
        if reason not in self._told and len(self._told) < _MOST_REASONS:
            self._told.add(reason)
            _log.warning("the lidar is not back yet: %s", reason)
