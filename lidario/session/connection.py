"""What a session begins with: a device that responds; and the two kinds of source where none has to be looked for.

A recording and the lidar of another machine tell themselves what they are. A port is looked at in
`lidario.session.connect`.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

from lidario.families.base import Device, Family
from lidario.model import DeviceInfo
from lidario.port.background import run_in_thread
from lidario.port.port import Port
from lidario.session.dialogue import Dialogue
from lidario.session.half_open import HalfOpen
from lidario.source import Source

__all__ = ["Connection", "connect_recording", "connect_remote"]

_NO_TIME_S = 0.001


@dataclass(frozen=True, slots=True)
class Connection:
    """A device that responds.

    Attributes:
        port: The line.
        family: Whose dialect it speaks.
        device: The device as that family sees it.
        dialogue: The conversation with it.
        info: What it says it is.
        half_open: Leaves it still, until a session takes care of it.
    """

    port: Port
    family: Family
    device: Device
    dialogue: Dialogue
    info: DeviceInfo
    half_open: HalfOpen


async def connect_recording(source: Source, family: str | None) -> Connection:
    """A recording: nothing is probed, and its device says what it had said.

    Raises:
        RecordingError: Nothing can be read of it.
    """
    # A fifth of the import time, for those who need it.
    from lidario.recording.device import RecordedDevice
    from lidario.recording.files import open_stored_source
    from lidario.recording.port import open_replay, pieces_from

    # The file is gone through once: an hour takes a second.
    recording = await run_in_thread(lambda: open_stored_source(source, family))
    pieces = await run_in_thread(lambda: pieces_from(recording, source.begin_s))
    port = open_replay(recording, rate=source.rate, loop=source.options.get("loop") == "1", pieces=pieces)
    device = RecordedDevice(recording, lambda: port.stream)
    port.offset_of = device.offset_of
    own = recording.streams[0].family
    # Nothing is under way on this line, so nothing has to be waited for.
    dialogue = Dialogue(port, device, replace(own.timing, quiet_s=_NO_TIME_S, boot_poll_s=_NO_TIME_S))
    info = await dialogue.run(device.identify())
    return Connection(port, own, device, dialogue, info, HalfOpen(dialogue))


async def connect_remote(source: Source) -> Connection:
    """Another machine's lidar: its publisher says what it is, and drives it.

    Raises:
        ConnectFailed: No router, nobody publishes under that key, or several do.
        Unsupported: The package that is needed is not installed.
    """
    from lidario.network.connect import open_remote  # for those who need it

    remote = await open_remote(source)
    dialogue = Dialogue(
        remote.port, remote.device, replace(remote.family.timing, quiet_s=_NO_TIME_S, boot_poll_s=_NO_TIME_S)
    )
    info = await dialogue.run(remote.device.identify())
    return Connection(remote.port, remote.family, remote.device, dialogue, info, HalfOpen(dialogue))
