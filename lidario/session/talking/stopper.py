"""Leaving the device still: which requests do it, when they are written, and how it is seen that they were heard.

The stop requests are written at the first moment at which the device listens. Mostly that is now: then they have
reached the operating system before `stop` returns. Else a timer writes them, which no cancellation reaches.

That they were written does not mean that they were heard. A device that has not responded yet discards what it is
sent, and a line may lose it. So the line is listened to afterwards:
* Bytes come, more than noise: the stop requests are written again.
* It is quiet, but the device owed a response when they were written: they are written again as soon as it comes,
  or when it is not waited for any more.
* It is quiet, and nothing was owed: they are written once more, since mostly nothing acknowledges them.
* It is quiet again. So is a dead line. So the device is asked one of `Device.questions`, if it has responded to
  that before. It responds: they are written a last time. Whether the line was dead until then or has died since,
  they were heard once. It does not respond: they are written again, and it is asked again. A response that may be
  to an earlier one of these questions is no proof. One that cannot be asked is still.

All of that takes `LATEST_RESPONSE_S` at most. Then it is logged that the device was not seen still.

A device may restart, and a line be dead for longer. So a device that streams although it was seen to be still is
stopped again. One that was not seen still is stopped again `AGAIN_S` later. Both happen once until the device is
set in motion again, since the bytes may be noise.

A response that is outstanding is waited for no longer than `PATIENCE_S` before they are written the first time: the
request may have been lost, and then the device hears them. A device that only talks has stop requests without
bytes: for it there is nothing to write and nothing to wait for.
"""

from __future__ import annotations

import asyncio
import logging
import math
import weakref
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import anyio

from lidario.families.base import Device
from lidario.session.talking.readiness import CLOCK_S, LATEST_RESPONSE_S, Readiness
from lidario.wire.envelope import Request

if TYPE_CHECKING:
    from lidario.session.talking.dialogue import Dialogue

_log = logging.getLogger("lidario")

PATIENCE_S = 0.1
"""How long the stop requests wait for a response that is outstanding. Healthy devices respond within a few
milliseconds; one that does not may be unable to, and its motor must not go on turning for that. So long, too, one
that has never responded is told to stop while bytes go on coming."""
SENDS_ON = "bytes still arrive after several stop requests: it does not hear them, or it is noise. Check the cable"
SILENT = "it does not respond any more, and may not have heard the stop requests. Check the cable"
AGAIN_S = 2.0
"""Seconds until a device that was not seen still and streams is stopped again. Who waits for it is told before."""
UNASKED = 64
"""Most bytes that come unasked at rest: noise, a late response. A stream: 264 at least while it is listened to."""


class Stopper:
    """Writes the stop requests of one device, until it is seen that they were heard."""

    def __init__(self, dialogue: Dialogue, hearing: Readiness, device: Device, quiet_s: float) -> None:
        self.keep_spinning: bool = False  # whether they leave the motor on
        # Whether the device was seen still, and nothing was sent since that could set it in motion.
        self.still: bool = False
        # Since the stop requests were written last.
        self._moved = False
        # Whether they are still to be written, or it is not seen yet that they were heard.
        self.wanted: bool = False
        self._dialogue = dialogue
        self._port = dialogue.port
        self._hearing = hearing
        self._device = device
        self._quiet_s = quiet_s
        self._loop = asyncio.get_running_loop()
        self._timer: asyncio.TimerHandle | None = None
        self._due = 0.0
        # Done when another step is due, or none. Held by who waits alone: see `Waiting`.
        self._changes = weakref.WeakSet[asyncio.Future[None]]()
        self._step: Callable[[], None] = self.try_now
        self._patient_until = 0.0
        self._attempts = 0
        self._until = 0.0  # until when they are written again
        self.asks: bool = False  # whether a question is outstanding
        # How long its response is waited for, and until when that to an earlier one may come in its place.
        self._wait_s = PATIENCE_S
        self._late_until = 0.0
        self._has_answered = False  # whether it has responded behind them
        self.why: str = SILENT  # why it was not seen still the last time
        # Stray and drained bytes in all, beyond which more than noise has come unasked since the last request; from
        # when on the device is stopped for that, on the loop's clock, and whether it was.
        self.unasked_limit: int = UNASKED
        self.again_at: float = math.inf
        self._stopped_again = False
        self._doubtful = self._hanging_up = False
        self._patient = True

    @property
    def ends_by_itself(self) -> bool:
        """Whether timers write the stop requests, and the port is closed after them."""
        return self._hanging_up and (self.still or self._timer is not None)

    def requests(self) -> tuple[Request, ...]:
        """What leaves the device still: laser off, and the motor too unless it shall go on. Chosen here alone."""
        return (self._device.stop(),) if self.keep_spinning else self._device.halt()

    def last_requests(self) -> tuple[Request, ...]:
        """What else may stop the motor of a device that has not said what it is.

        Nothing for one that is only looked for and has not responded: it may be of another family, whose motor is
        started by the state of DTR that stops the motors of this one.
        """
        return self._device.halt_unknown() if self._is_of_family else ()

    @property
    def _is_of_family(self) -> bool:
        return not self._device.is_guess or self._hearing.has_responded

    def stop_motor_too(self) -> None:
        """Leave the motor on no more; what was written before has left it on."""
        if self.keep_spinning:
            self.keep_spinning, self.still, self._moved = False, False, True

    def unseen(self) -> tuple[Sequence[Request], Sequence[Request], float]:
        """What a guard needs, who sees nothing of the device.

        Returns:
            What to write several times, what to write at the end, and when the device listens at the latest.
        """
        listens_at = max(self._hearing.free_at(math.inf), self._hearing.owes_until)
        return (self._device.fill, *self.requests()), self.last_requests(), listens_at

    def sent(self, request: Request) -> None:
        """Take note that `request` was sent: it may have set the device in motion.

        Queries do not. Nor does a reset; but not every motor is switched off by one, and it may not be heard.
        """
        stats = self._dialogue.stats
        self.unasked_limit = stats.stray_bytes + stats.drained_bytes + UNASKED
        if request.stream is not None or (request.expects is None and not request.ends_stream):
            self.still, self._moved = False, True
            self.again_at, self._stopped_again = math.inf, False

    def stop(self) -> None:
        """Write the stop requests as soon as the device listens, now if it does. Never blocks or raises."""
        under_way = self.wanted and not self._moved
        if self.still or under_way or not self._port.is_open or self._loop.is_closed():
            return
        self.wanted, self._attempts, self.asks = True, 0, False
        self._patient_until = self._loop.time() + PATIENCE_S
        self.try_now()

    def heard_unasked(self) -> None:
        """More than noise has come from a device at rest, `again_at` or later: stop it if it hears requests."""
        if self._dialogue.reset_at is None and any(request.data for request in self.requests()):
            self.still = False
            if not self._stopped_again:
                self._stopped_again = True
                self.stop()

    def try_now(self) -> None:
        """While they are wanted: write the stop requests if the device listens; else come back when it does.

        Called whenever the device has responded.
        """
        if self._attempts and not (self._doubtful and self._hearing.owes_until <= self._loop.time() + CLOCK_S):
            return  # written already, and nothing that was owed has come since
        due = self._hearing.free_at(self._patient_until)
        if due - self._loop.time() > CLOCK_S:
            self._come_back(due, self.try_now)
        else:
            self._attempts = 0
            self._write()

    def answered(self) -> None:
        """The device has responded to the question."""
        self.asks = False
        is_late, self._late_until = self._late_until > self._hearing.asked_at, 0.0
        if self._dialogue.stats.stray_bytes + self._dialogue.stats.drained_bytes > self.unasked_limit:
            self._again(SENDS_ON)
            return
        if is_late:
            self._came_late()
        else:
            self._has_answered = True
            self._write()

    async def written(self) -> None:
        """Return when the stop requests are written, or the port is dead; after 0.6 s at most.

        Where the speed of the line is being changed it takes longer, since nothing is heard meanwhile.
        """
        # A timer that is late or put off makes another round; nothing can wake this too early or never.
        while self.wanted and not self._attempts and self._timer is not None and self._port.is_open:  # noqa: ASYNC110
            await asyncio.sleep(max(0.0, self._due - self._loop.time()))

    async def surely_settled(self) -> None:
        """Return when it is seen that they were heard, or `settled` has said that it cannot be.

        A cancellation that comes meanwhile is raised afterwards: the program may close the loop as soon as it goes
        on, and no timer writes anything after that. Anyio's cancellation does not come here.
        """
        cancelled: asyncio.CancelledError | None = None
        with anyio.CancelScope(shield=True):
            while self.wanted and self._timer is not None and self._port.is_open:
                try:
                    self._changes.add(change := self._loop.create_future())
                    await asyncio.wait([change], timeout=max(0.0, self._due - self._loop.time()))
                    if self.wanted and self._timer is not None and self._due - self._loop.time() <= CLOCK_S:
                        self._step()  # Ctrl-C may have ended the timer's own call in its midst
                except asyncio.CancelledError as error:
                    cancelled = error
        if cancelled is not None:
            raise cancelled

    def hang_up(self, *, patient: bool = True) -> None:
        """Leave the device still, then close the port; without waiting, timers go on with it.

        Args:
            patient: Whether to wait for a response that the device owes, to write the stop requests behind it.
        """
        if self._hanging_up:
            return
        self._hanging_up, self._patient = True, patient
        self._doubtful = self._doubtful and patient
        if self.still or not self._port.is_open:
            self._settle(still=self.still)
        else:
            self.stop()

    def cancel(self) -> None:
        """Stop the timer: nothing is written any more."""
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None
        for change in [each for each in self._changes if not each.done()]:
            change.set_result(None)

    def _come_back(self, due: float, step: Callable[[], None]) -> None:
        self.cancel()
        # Not asked of the timer later: uvloop's shortest ones do not know when they are due.
        self._due, self._step = due, step
        self._timer = self._loop.call_at(due, step)

    def _write(self) -> None:
        now = self._loop.time()
        if not self._attempts:
            self._until = now + (LATEST_RESPONSE_S if self._patient and self._hearing.has_responded else PATIENCE_S)
            # A device that has taken its time does so again.
            self._wait_s = min(PATIENCE_S + self._hearing.took_s, LATEST_RESPONSE_S)
            self._has_answered = False
        self._doubtful = self._patient and self._hearing.owes_until - now > CLOCK_S
        self._attempts, self._moved = self._attempts + 1, False
        requests = self.requests()
        self._write_all(requests)
        if self._has_answered and self._hanging_up and all(request.acknowledged for request in requests):
            self._settle()  # behind what it acknowledges, a device hears who opens the port next
        elif any(request.data for request in requests):
            # Behind the last of them it may be deaf for longer than its manual says.
            pause_s = self._quiet_s if self._has_answered and not self._hanging_up else 0.0
            listens_at = max(self._hearing.free_at(0.0), self._loop.time() + pause_s)
            self._come_back(listens_at, self._settle if self._has_answered else self._listen)
        else:
            self._settle()  # one that streams unasked was told nothing, and does not fall quiet

    def _write_all(self, requests: Sequence[Request]) -> None:
        # Each of them ends the stream for the parser, also the one that is for the motor alone.
        self._dialogue.write([replace(request, ends_stream=True) for request in requests])

    def _listen(self) -> None:
        self._come_back(self._loop.time() + self._quiet_s, self._after_listening)
        self._seen = self._dialogue.stats.bytes_received

    def _after_listening(self) -> None:
        came = self._dialogue.stats.bytes_received - self._seen
        if came > UNASKED or (came and self._doubtful):
            # Whatever the device owed is among that.
            self._hearing.forget()
            self._again(SENDS_ON)
        elif came and self._late_until > self._loop.time():
            self._came_late()
        elif self._doubtful and (owed := self._hearing.owes_until) - self._loop.time() > CLOCK_S:
            self._come_back(min(owed, self._loop.time() + self._quiet_s), self._after_listening)
        elif self._doubtful:
            self._hearing.miss()
            self.try_now()
        elif self._attempts == 1 and self._is_of_family and not any(each.acknowledged for each in self.requests()):
            self._write()
        elif (question := self._question) is not None:
            self._ask(question)
        else:
            self._settle()

    @property
    def _question(self) -> Request | None:
        """What the device has responded to before, and can be asked; None while it boots, or for nothing."""
        known = self._dialogue.chronicle.responses if self._patient and self._dialogue.reset_at is None else ()
        return next((each for each in self._device.questions if each.data in known), None)

    def _ask(self, question: Request) -> None:
        self._hearing.forget()
        self._hearing.asks(self._wait_s)
        self.asks = True
        self._dialogue.write((question,))
        self._come_back(self._hearing.due, self._not_answered)

    def _not_answered(self) -> None:
        self.asks = False
        self._hearing.give_up()
        self._late_until, self._hearing.late_until = self._hearing.late_until, 0.0
        self._until = min(self._until, self._hearing.silent_since + LATEST_RESPONSE_S)
        self._again(SILENT)

    def _came_late(self) -> None:
        """The device takes its time, or the line works again: ask once more, and wait as long as that may take."""
        self._late_until = 0.0
        self._wait_s, self._until = LATEST_RESPONSE_S, self._loop.time() + LATEST_RESPONSE_S
        self._write()

    def _again(self, why: str) -> None:
        """They were not heard: write them again, or give it up for that reason."""
        if self._loop.time() < self._until:
            self._write()
            return
        self.why = why
        if self._is_of_family and self._patient:  # else others will stop it
            _log.warning("the device was not seen to stop: %s", why)
        self._settle(still=False)

    def _settle(self, *, still: bool = True) -> None:
        self.cancel()
        self.wanted, self.still, self.asks = False, still, False
        self.again_at = self._loop.time() + (0.0 if still else AGAIN_S)
        if self._hanging_up:
            self._write_all(self.last_requests())
            self._port.close_soon()
        self._dialogue.settled(still)
