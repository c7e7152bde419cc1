"""The search for the device at an open port, until it has introduced itself.

Where family and speed are known, the device is asked at once, for as long as a half request that a killed program
left may keep it from hearing. Otherwise the line is first listened to (`listen`): a device that streams is
recognised by that. What remains unknown is asked at each speed, in rounds:

- The first round waits shortly at each speed, since a healthy device responds within milliseconds. It is made
  where nothing was heard, so nothing has to be stopped before the question, and where no two are asked at one speed
  in a row. Then the models are asked that need the control line DTR; for the others it is cleared again. Most of
  those that got power just now have booted meanwhile, and a second such round finds them.
- The next one asks with patience, and by DTR behind it.
- Further rounds are made until each was asked after the longest time for which a device does not hear: it holds
  half a request, or it boots.
- Where a line that was silent streams after all, and before each later round of one that streams, it is listened to
  again: one that only talks hears no question, and sends its packets when it has had power for a while.
"""

import asyncio
from collections.abc import Awaitable, Callable
from functools import partial
from itertools import pairwise

from lidario.errors import ResponseTimeout
from lidario.families.base import Family
from lidario.port.port import Port
from lidario.session.finding.asking import Attempt, Woken, ask_once, begun, find_by_dtr, leave
from lidario.session.finding.connection import Connection
from lidario.session.finding.leaving import leave_still
from lidario.session.finding.listening import ReceivedInSilence, listen
from lidario.session.talking.dialogue import Dialogue
from lidario.session.talking.handshake import RESPONSE_BYTES, introduce


class Search:
    """Looks for the device at an open port.

    Args:
        port: The port.
        tries: What it may be, at least one.
        received: Counts what comes from the port.
        on_dialogue: Called with the dialogue before anything is written, where family and speed are known.

    Attributes:
        tries: What it may be, or was asked as, once nothing was found.
    """

    def __init__(
        self,
        port: Port,
        tries: list[Attempt],
        received: ReceivedInSilence,
        on_dialogue: Callable[[Dialogue], None] | None,
    ) -> None:
        self.tries: list[Attempt] = tries
        # Listened to are all of them, also those that hear nothing.
        self._port, self._all = port, tries
        self._received = received
        self._listened_at = 0  # how many bytes had come when the line was listened to before
        self._is_noisy = False  # whether those that came in this round were heard to be no stream
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
            connection = await find_by_dtr(self._woken, self.tries, self._received)
        return connection

    async def leave(self, *, found_nothing: bool) -> None:
        """Leave what may be at the port still, and begin to close it; it may be closed already.

        Where the search was ended before it `found_nothing`, it is first found out what the device is.
        """
        port, families = self._port, {each.family for each in self.tries}
        if self._known is not None:
            # Not by what was heard alone: a stream may be taken for that of another family than was woken.
            await self._woken.stop()
            await self._known.close()
        elif not port.is_closing:
            # One of a known family may hear us although its responses do not reach us.
            helps = len(families) == 1 or not found_nothing
            if helps and port.is_open and not self._loop.is_closed():
                await leave_still(self._woken, self.tries)
            else:
                await self._woken.stop()
                port.close_soon()

    async def _find_among(self, *, patient: bool) -> Connection | None:
        """The device, where several families or speeds are to be tried."""
        heard = await listen(self._port, self._all)
        if heard.stream is not None:
            return await self._try_heard(heard.stream)
        tries = [each for each in self.tries if _may_hear(each)] or self.tries
        is_guess = len({each.family for each in tries}) > 1
        tries = [each._replace(is_guess=is_guess) for each in tries]
        connection = await self._ask_in_rounds(tries, silent=heard.silent, patient=patient)
        self.tries = tries
        return connection

    async def _ask_in_rounds(self, tries: list[Attempt], *, silent: bool, patient: bool) -> Connection | None:
        """Ask at each speed, again and again, until each was asked when its device must have heard it; or None."""
        longest = max(each.family.timing.forget_s for each in tries)
        now, self._listened_at = self._loop.time(), self._received.total
        # Where something arrives, no device boots: then only half a request can keep one from hearing.
        left = {each: now + (longest if silent else each.family.timing.forget_s) for each in tries}
        # One that is waited for shortly may be late. Then at another speed it is noise, but not at the same.
        quick = silent and all(a.baudrate != b.baudrate for a, b in pairwise(tries))
        shortly = partial(self._ask_each, left, quick=True)
        # Not where the user has named a model, or where no model needs DTR.
        needs_dtr = all(each.model is None for each in tries) and any(each.family.by_dtr for each in tries)
        by_dtr = [partial(self._ask_by_dtr, tries)] if needs_dtr else []
        steps: list[Callable[[], Awaitable[Connection | None]]] = [shortly, *by_dtr] if quick else []
        if quick and by_dtr and patient:
            steps.append(shortly)
        if patient or not quick:
            # A silent port is given up soon, and later requests of other families may stop what this round starts.
            steps += [partial(self._ask_each, left, listens=silent, waits=silent), *by_dtr]
        for ask in steps:
            if (connection := await ask()) is not None:
                return connection
        connection = None
        while connection is None and patient and left:
            connection = await self._ask_each(left)
        return connection

    async def _ask_by_dtr(self, tries: list[Attempt]) -> Connection | None:
        """One of the models that are dark while DTR is cleared; or what streams then."""
        return await find_by_dtr(self._woken, tries, self._received) or await self._listen_again()

    async def _ask_each(
        self, left: dict[Attempt, float], *, quick: bool = False, listens: bool = True, waits: bool = False
    ) -> Connection | None:
        """One round: ask each that is left once, and leave it out from now on if its time is over.

        Args:
            left: Whom to ask, and until when.
            quick: Whether to wait shortly for each.
            listens: Whether to listen again where more comes than a response.
            waits: Whether to wait for each as long as its motor may take to start.
        """
        self._is_noisy = not listens
        for each, deadline in tuple(left.items()):
            connection = await self._listen_again()
            if connection is not None:
                return connection
            began = self._loop.time()
            patience_s = each.family.timing.starts_s if waits else 0.0
            connection = await ask_once(self._woken, each, quick=quick, patience_s=patience_s)
            if connection is not None:
                return connection
            if began >= deadline and not quick:
                del left[each]
        return None

    async def _listen_again(self) -> Connection | None:
        """One that only talks, and got power just now, or whose rotor has its speed; None where nothing streams.

        It is listened to where more has come than a response, and no more in this round once that was noise.
        """
        if self._is_noisy or self._received.total - self._listened_at <= RESPONSE_BYTES:
            return None
        heard = await listen(self._port, self._all)
        self._is_noisy, self._listened_at = not heard.silent, self._received.total
        return None if heard.stream is None else await self._try_heard(heard.stream)

    async def _try_heard(self, stream: tuple[Family, int]) -> Connection | None:
        """Ask the one of them whose stream was recognised."""
        # Where several families have a model of the name that the user gave, it is that one.
        known = next((each for each in self._all if (each.family, each.baudrate) == stream), Attempt(*stream))
        self.tries = [known]
        return await self._try_known(known)

    async def _try_known(self, known: Attempt, *, patient: bool = True) -> Connection | None:
        """Ask the one family at the one speed that it can be, with patience; None when there is no response."""
        self._port.set_baudrate(known.baudrate)
        connection = begun(self._woken, known)
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


def _may_hear(each: Attempt) -> bool:
    """Whether a silent device of that family may hear a request at that speed."""
    asked_at = each.family.asked_at
    return asked_at is None or each.baudrate in (0, *asked_at)
