"""Where a device is reached: what opening it gives, and what a session changes when it comes back by another line.

A recording and the lidar of another machine tell themselves what they are, so they are opened here. A port is
looked at in `lidario.session.finding.connect`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

from lidario.basics.model import DeviceInfo
from lidario.basics.source import Source
from lidario.families.base import Family
from lidario.port.at_exit import finalize
from lidario.port.background import run_in_thread
from lidario.session.talking.dialogue import Dialogue
from lidario.session.talking.trouble import Trouble

if TYPE_CHECKING:
    from lidario.recording.device import RecordedDevice
    from lidario.recording.fed import FedPort

_NO_TIME_S = 0.001


class Connection:
    """A line to a device that is being opened, and then responds.

    Ctrl-C is raised wherever the interpreter is, also between two statements that belong together. So this is made
    before anything is written, and lives in the frames that open the device; when they are gone, its finalizer
    writes the stop requests, behind what `before` does. The session lets go of it as soon as it has a finalizer of
    its own.
    """

    info: DeviceInfo  # what it says it is; there once it has responded

    def __init__(self, dialogue: Dialogue, before: Callable[[], None] = lambda: None) -> None:
        self.dialogue: Dialogue = dialogue  # the conversation with it
        self._finalizer = finalize(self, _abandon, before, dialogue)

    def release(self) -> None:
        """Somebody else takes care of the device from now on, or nobody has responded."""
        self._finalizer.detach()


def _abandon(before: Callable[[], None], dialogue: Dialogue) -> None:
    before()
    dialogue.abandon()


@dataclass(slots=True)
class At:
    """Where the device of one session is reached now: shared by all its objects, and changed by `Lidar` alone.

    `dialogue` and `info` are as in `Connection`. `trouble` tells of what is wrong with it, in the log.
    """

    dialogue: Dialogue
    info: DeviceInfo
    trouble: Trouble = field(default_factory=Trouble)


async def connect_recording(source: Source, family: str | None) -> Connection:
    """A recording: nothing is probed, and its device says what it had said.

    Raises:
        RecordingError: Nothing can be read of it.
    """
    # A fifth of the import time, for those who need it.
    from lidario.recording.device import RecordedDevice
    from lidario.recording.files import open_stored_source
    from lidario.recording.port import ReplayPort, pieces_from

    # The file is gone through once: an hour takes a second.
    recording = await run_in_thread(lambda: open_stored_source(source, family))
    pieces = await run_in_thread(lambda: pieces_from(recording, source.begin_s))
    port = ReplayPort(recording, rate=source.rate, loop=source.options.get("loop") == "1", pieces=pieces)
    device = RecordedDevice(recording, lambda: port.stream)
    return await _fed(port, recording.streams[0].family, device)


async def connect_remote(source: Source) -> Connection:
    """Another machine's lidar: its publisher says what it is, and drives it."""
    from lidario.network.connect import open_remote  # for those who need it

    return await _fed(*await open_remote(source))


async def _fed(port: FedPort, family: Family, device: RecordedDevice) -> Connection:
    port.offset_of = device.offset_of
    # Nothing is under way on this line, so nothing has to be waited for.
    timing = replace(family.timing, quiet_s=_NO_TIME_S)
    connection = Connection(Dialogue(port, device, timing))
    connection.info = await connection.dialogue.run(device.identify())
    return connection
