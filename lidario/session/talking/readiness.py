"""When the device listens: not during the pause that its last request demands, nor while it owes a response.

A response that was given up is owed all the same for a while, by a device that has sent anything before: it may
take its time. What it is sent meanwhile it discards, and does not say so.
"""

import asyncio

from lidario.port.guard import MARGIN_S
from lidario.wire.link import Link
from lidario.wire.states import LinkState

CLOCK_S = 1e-6
"""A timer may fire that little early, by the resolution of the loop's clock: its time has come all the same."""
LATEST_RESPONSE_S = 2.0
"""Behind its request, a response may come so late from a device that takes its time; none is waited for longer."""
UNCONFIRMED_S = 1.0
"""How long a device may run at another speed that was measured and not confirmed. No document tells; assumed."""
_AWAITING = LinkState.AWAIT_RESPONSE
_DECIDED_S = 0.02
"""How often it is looked whether another speed of the line has been decided; that takes 1.5 s at most."""


class Readiness:
    """What is known of one device's readiness to hear."""

    def __init__(self, link: Link) -> None:
        self._link = link
        self._loop = asyncio.get_running_loop()
        self.listens_at: float = 0.0  # when the pause is over that the last request demands, on the loop's clock
        # When the last question was written, and until when its response is waited for.
        self.asked_at: float = 0.0
        self.due: float = 0.0
        # Until when a response that was given up may still come, on the loop's clock; 0 for none.
        self.late_until: float = 0.0
        self.has_responded: bool = False  # whether the device has ever responded
        self.took_s: float = 0.0  # how long it took for its last response
        # When the first question was asked that had no response, on the loop's clock; 0 if anything came since.
        self.silent_since: float = 0.0
        # Whether it measures another speed of the line: until that has been decided, it is not known at which speed
        # it hears.
        self.measures_speed: bool = False

    @property
    def owes_until(self) -> float:
        """Until when the device may be busy with a response that has not come, on the loop's clock; 0 for none."""
        if self._link.state is not _AWAITING:
            return self.late_until
        return max(self.due, self._latest)

    @property
    def _latest(self) -> float:
        """Until when the response to the last question may come, from a device that is there; 0 from none."""
        is_there = self.has_responded or self._link.stats.bytes_received
        return self.asked_at + LATEST_RESPONSE_S if is_there else 0.0

    def pause(self, settle: float) -> None:
        """A request is about to be written that demands a pause of so many seconds."""
        self.listens_at = max(self.listens_at, self._loop.time() + settle + MARGIN_S)

    def asks(self, timeout: float) -> None:
        """A question is about to be written whose response is waited for that long."""
        self.asked_at = self._loop.time()
        self.due = self.asked_at + timeout

    def responded(self) -> None:
        """The device has responded to the question."""
        self.has_responded, self.took_s = True, self._loop.time() - self.asked_at

    def miss(self) -> None:
        """The response to the last question was waited for in vain."""
        self.silent_since = self.silent_since or self.asked_at

    def give_up(self) -> None:
        """The response has not come in time."""
        self._link.forget()
        self.miss()
        self.late_until = self._latest

    def forget(self) -> None:
        """Nothing is owed any more."""
        self._link.forget()
        self.late_until = 0.0

    def goes_back(self) -> None:
        """The device may run at another speed, and hears nothing until it has gone back.

        What it owes comes at that speed, if at all. Nor does its silence there tell anything.
        """
        self.pause(UNCONFIRMED_S)
        self.forget()
        self.silent_since = 0.0

    def free_at(self, patient_until: float) -> float:
        """When the device listens; a response is not waited for beyond `patient_until`."""
        if self.measures_speed:
            return self._loop.time() + _DECIDED_S
        if self._link.state is not _AWAITING:
            return self.listens_at
        return max(self.listens_at, min(self.due, patient_until))
