"""Identifying a device, whatever state it was left in.

A device may still be streaming for a program that was killed, may hold half a request, may have stopped to protect
itself, or may be booting. So STOP is sent first, unless the line was just listened to and is quiet. Then a question
is asked, whose response is recognised by type and length. One that goes on sending all the same may hear nothing:
then its packets tell what it is (`Device.overhear`). A device that reports an error is reset once; that is
logged, counted, and told in `Health.note`, since repeated Protection Stops may be a sign of lasting damage
(S-series interface manual, GET_HEALTH).
"""

import asyncio
import logging
from dataclasses import replace

from lidario.basics.model import DeviceInfo, Health, HealthStatus
from lidario.errors import DeviceFault, ResponseTimeout
from lidario.session.talking.dialogue import Dialogue

_log = logging.getLogger("lidario")

RESPONSE_BYTES = 64
"""Most bytes of a response that says what a device is. More of them are noise, or a stream."""
_LEAST_ROUNDS = 2
"""A single question may be swallowed by half a request that a killed program left behind."""


async def introduce(dialogue: Dialogue, patience: float, *, quiet: bool = False) -> DeviceInfo:
    """Stop whatever the device is doing and ask what it is, again and again for `patience` seconds.

    With no patience at all it is asked once. Where the line is known to be `quiet`, nothing is stopped before.

    Raises:
        ResponseTimeout: It does not respond.
        DeviceLost: The port died.
    """
    loop = asyncio.get_running_loop()
    deadline = loop.time() + patience
    rounds = _LEAST_ROUNDS if patience else 1
    while True:
        rounds -= 1
        began = loop.time()
        talks_on = not quiet and not await dialogue.quieten()
        came = dialogue.stats.bytes_received
        try:
            try:
                return await dialogue.run(dialogue.device.overhear() if talks_on else dialogue.device.identify())
            except ResponseTimeout:
                device, since = dialogue.device, dialogue.stats.bytes_received - came
                if talks_on or device.is_guess or not device.can_only_talk or since <= RESPONSE_BYTES:
                    raise
                # It goes on sending, and was silent for a moment only.
                return await dialogue.run(dialogue.device.overhear())
        except ResponseTimeout:
            if rounds <= 0 and began >= deadline:
                raise


async def healthy(dialogue: Dialogue) -> Health:
    """Ask how the device is, and reset it if it has stopped to protect itself.

    A device that has said what it is, but not how it is, or in a way that nobody can read, may scan all the same:
    that is a warning, and logged.

    Raises:
        DeviceFault: It still reports an error after the reset.
        ResponseTimeout: It does not respond any more after the reset.
    """
    health = await _health(dialogue)
    return health if health.ok else await cured(dialogue, health, "when it was asked")


async def cured(dialogue: Dialogue, health: Health, when: str) -> Health:
    """Reset a device that reports the error `health`, and return its health afterwards; `note` tells of the error.

    The log says `when` it was noticed. It fails as `healthy`. What was recorded, or is driven by another machine,
    is not reset: that is how it is.
    """
    if not dialogue.port.is_live:
        return health
    dialogue.protection_stops += 1
    what = f"the device had stopped to protect itself ({_code(health)})"
    _log.warning("%s; noticed: %s. It is reset", what, when)
    await restart(dialogue)
    again = await _health(dialogue)
    if not again.ok:
        raise fault_of(again, "also after a reset")
    note = f"{what}; a reset cured it"
    return replace(again, note=f"{note}. {again.note}" if again.note else note)


def fault_of(health: Health, also: str) -> DeviceFault:
    """The error that tells of a device that reports `health`."""
    return DeviceFault(
        f"the device protects itself: health {health.status.value}, {_code(health)}, {also}. "
        "Check that the rotor turns freely and that the supply gives 5 V under load",
        health,
    )


def _code(health: Health) -> str:
    return f"code {health.code} (0x{health.code:04X})"


async def _health(dialogue: Dialogue) -> Health:
    try:
        health = await dialogue.run(dialogue.device.health())
    except ResponseTimeout as error:
        health = Health(HealthStatus.WARNING, 0, f"it does not tell its health: {error}")
    if health.note:
        _log.warning("health of the device: %s", health.note)
    return health


async def restart(dialogue: Dialogue) -> None:
    """Reset the device and wait until it responds, however long it boots and whatever it prints meanwhile."""
    await dialogue.ask(dialogue.device.reset())
    await come_back(dialogue)


async def come_back(dialogue: Dialogue) -> None:
    """Wait until a device that was reset responds: whoever has reset it.

    Every operation that asks something begins with this where `Dialogue.reset_at` says that it has not responded
    since: the operation that has reset the device may have been cancelled.

    Raises:
        ResponseTimeout: It does not come back.
    """
    loop = asyncio.get_running_loop()
    deadline = (dialogue.reset_at or loop.time()) + dialogue.timing.boot_s
    while True:
        try:
            await introduce(dialogue, patience=0)
        except ResponseTimeout:
            if loop.time() > deadline:
                raise
        else:
            # No document says whether the motor turns after a restart.
            dialogue.stopper.still = False
            dialogue.device.restarted()
            return
