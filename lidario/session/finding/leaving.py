"""Leaving a device still of which the opening has ended before it had said what it is.

It may stream for a program that was killed, and the port's opening alone may have set its motor in motion: it
clears the control line DTR, which starts the motors of some models and stops those of others. So before the port is
closed it is found out what the device is, as far as that takes a moment:

- It streams: its packets tell whose stop requests it hears. Where they tell nothing, being damaged or of no known
  format, those of all families are written, each at its speeds. They are harmless to the devices of the others,
  which are sent more than that by every search.
- Then, or where it is silent, those are asked whose motor may turn while DTR is cleared. If none responds, DTR
  stays cleared. A family that was named is not asked: what stops its devices is written at each of its speeds.

Both together take 0.4 s where nothing streams, and 2.5 s at most where something does that is not recognised.
"""

import asyncio
from contextlib import suppress

import anyio

from lidario.errors import LidarError
from lidario.session.finding.asking import Attempt, Woken, ask_once, made
from lidario.session.finding.listening import listen
from lidario.session.talking.dialogue import Dialogue


async def leave_still(woken: Woken, tries: list[Attempt]) -> None:
    """Stop what is at an open port, what the search has `woken` first, and begin to close the port.

    It takes a bounded time. A cancellation that comes meanwhile is raised afterwards: the loop may not go on then.
    """
    cancelled: asyncio.CancelledError | None = None
    with anyio.CancelScope(shield=True):
        task = asyncio.ensure_future(_stop(woken, tries))
        while not task.done():
            try:
                await asyncio.wait([task])
            except asyncio.CancelledError as error:
                cancelled = error
        # A line that is lost, or cannot have a speed; or the program ends all tasks.
        with suppress(LidarError, asyncio.CancelledError):
            task.result()
        if not woken.port.is_closing:
            woken.port.close_soon()
    if cancelled is not None:
        raise cancelled


async def _stop(woken: Woken, tries: list[Attempt]) -> None:
    await woken.stop()
    port = woken.port
    found = tries[0] if len({each.family for each in tries}) == 1 else None
    if len(tries) > 1:
        heard = await listen(port, tries)
        if heard.stream is not None:
            found = Attempt(*heard.stream)
        else:
            if found is not None or not heard.silent:
                await _stop_any(woken, tries)
            if found is None and await _asked(woken, tries):
                return
    if found is not None:
        port.set_baudrate(found.baudrate)
        await Dialogue(port, made(port, found), found.family.timing).close()


async def _stop_any(woken: Woken, tries: list[Attempt]) -> None:
    for each in tries:
        device = made(woken.port, each)
        stops = (device.fill, *device.halt_unknown(), *device.halt())
        woken.add(each.baudrate, b"".join(request.data for request in stops))
    await woken.stop()


async def _asked(woken: Woken, tries: list[Attempt]) -> bool:
    """Whether one has responded whose motor may turn while DTR is cleared; then it is still, the port closed."""
    for each in tries:
        if any(request.dtr is not None for request in made(woken.port, each).halt_unknown()):
            connection = await ask_once(woken, each._replace(is_guess=True), quick=True)
            if connection is not None:
                await connection.dialogue.close()
                return True
    return False
