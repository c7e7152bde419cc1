"""From a source to a device that has introduced itself."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import anyio

from lidario.errors import ConnectFailed, LidarError, ResponseTimeout
from lidario.families.base import Device, Family
from lidario.families.registry import FAMILIES, family_named, family_of_simulated
from lidario.model import DeviceInfo
from lidario.port.port import Port
from lidario.port.serial import open_serial
from lidario.port.tcp import open_tcp
from lidario.session.dialogue import Dialogue
from lidario.session.handshake import introduce
from lidario.session.silence import ReceivedInSilence
from lidario.source import Source

__all__ = ["Connection", "connect"]


@dataclass(frozen=True, slots=True)
class Connection:
    """A device that responds.

    Attributes:
        port: The line.
        family: Whose dialect it speaks.
        device: The device as that family sees it.
        dialogue: The conversation with it.
        info: What it says it is.
    """

    port: Port
    family: Family
    device: Device
    dialogue: Dialogue
    info: DeviceInfo


class _Try(NamedTuple):
    family: Family
    baudrate: int


async def connect(source: Source, family: str | None = None, baudrate: int | None = None) -> Connection:
    """Open a port and find out which device is at its other end.

    Args:
        source: A serial port, network address or simulator; not ``auto`` or ``id``.
        family: Name of the family, if it is known; it need not be probed then.
        baudrate: Speed of the line, if it is known; likewise.

    Raises:
        ConnectFailed: It could not be opened, or nothing responds; the text says what was tried and what came back.
        DeviceLost: The port died meanwhile.
    """
    named = family or source.family
    families = (family_named(named),) if named else FAMILIES
    speed = baudrate or source.baudrate
    if source.kind == "sim":
        from lidario.port.simulated import open_simulated  # a fifth of the import time, for those who need it

        port = await open_simulated(source)
        tries = [_Try(family_of_simulated(source.address), port.baudrate)]
    elif source.device is not None:
        from lidario.port.simulated import connect_in_memory

        port = connect_in_memory(source.device)
        tries = [_Try(each, 0) for each in families]
    elif source.kind == "tcp":
        port = await open_tcp(source.text, *source.host_and_port, baudrate=speed or 0)
        tries = [_Try(each, 0) for each in families]
    else:
        tries = [_Try(each, speed or baud) for each in families for baud in ((speed,) if speed else each.baudrates)]
        port = await open_serial(source.address, tries[0].baudrate)
    patient = len(tries) == 1
    received = ReceivedInSilence()
    port.add_tap(received.see)
    try:
        for attempt in tries:
            connection = await _try(port, attempt, patient=patient)
            if connection is not None:
                return connection
        port.close_soon()
    finally:
        port.remove_tap(received.see)
        if port.is_closing:
            with anyio.CancelScope(shield=True):
                await port.wait_closed()
    raise _nothing_responds(source, tries, received)


async def _try(port: Port, attempt: _Try, *, patient: bool) -> Connection | None:
    """Ask one family's question at one speed; None when there is no response."""
    family = attempt.family
    device = family.device()
    dialogue = Dialogue(port, device, family.timing)
    try:
        if attempt.baudrate and attempt.baudrate != port.baudrate:
            port.set_baudrate(attempt.baudrate)
        if patient:
            info = await introduce(dialogue, device, family.timing.forget_s)
        else:
            dialogue.hurry(family.timing.probe_s)
            info = await introduce(dialogue, device, patience=0)
            dialogue.hurry(None)
    except ResponseTimeout:
        if patient:
            # It may hear us although its responses do not reach us.
            dialogue.stop_device()
        port.attach(None)
        return None
    except BaseException:
        await dialogue.close()
        raise
    return Connection(port, family, device, dialogue, info)


def _nothing_responds(source: Source, tries: list[_Try], received: ReceivedInSilence) -> LidarError:
    speeds = [str(each.baudrate) for each in tries if each.baudrate]
    at = f" at {_either(speeds)} baud" if speeds and source.kind == "serial" else ""
    asked = _either(list(dict.fromkeys(each.family.title for each in tries)))
    cure = "Is the lidar powered (5 V, 1.5 A)"
    cure += " and the adapter's speed switch right?" if source.kind == "serial" else "?"
    return ConnectFailed(
        f"{source.address} opened, but nothing responds{at} (asked as {asked}): {received.describe()}. {cure}",
        reason="silent",
    )


def _either(words: list[str]) -> str:
    return words[0] if len(words) == 1 else f"{', '.join(words[:-1])} or {words[-1]}"
