"""One session as recordings see it: its chunks, its chronicle and its scans, handed to each recording."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

from lidario.errors import CannotRecord
from lidario.recording.about import About
from lidario.recording.chronicle import StreamEvent, text_of
from lidario.session.dialogue import Dialogue
from lidario.session.scanner import Scanner
from lidario.version import __version__

if TYPE_CHECKING:
    from lidario.model import DeviceInfo, Health
    from lidario.recording.record import Recording

__all__ = ["RecordedSession"]


class RecordedSession:
    """Implements `Recorded`.

    Args:
        dialogue: Carries the bytes.
        scanner: Makes the scans.
        source: What was opened.
        sends_bytes: As `Device.sends_bytes`.
        told: The latest info and health of the device.
    """

    def __init__(
        self,
        dialogue: Dialogue,
        scanner: Scanner,
        source: str,
        sends_bytes: bool,
        told: Callable[[], tuple[DeviceInfo, Health]],
    ) -> None:
        self.sends_bytes: bool = sends_bytes
        self._dialogue = dialogue
        self._scanner = scanner
        self._source = source
        self._told = told
        self._running: dict[Recording, Callable[[StreamEvent], None]] = {}

    def begin_recording(self, recording: Recording) -> About:
        """As `Recorded`."""
        dialogue, chronicle = self._dialogue, self._dialogue.chronicle
        # What was read and not parsed yet belongs to the time before.
        dialogue.poll()
        info, health = self._told()
        about = About(
            info=info,
            health=health,
            source=self._source,
            baudrate=dialogue.baudrate,
            clock_offset_ns=dialogue.wall_offset_ns,
            received_before=dialogue.bytes_fed,
            lidario=__version__,
            events=(*chronicle.responses.values(), *((chronicle.running,) if chronicle.running else ())),
        )

        def see(event: StreamEvent) -> None:
            recording.see_event(text_of(event), dialogue.now())

        self._running[recording] = see
        chronicle.watch(see)
        dialogue.add_tap(recording.see_chunk)
        self._scanner.watch(recording.see_scan)
        return about

    def end_recording(self, recording: Recording) -> None:
        """As `Recorded`."""
        see = self._running.pop(recording, None)
        if see is not None:
            self._dialogue.chronicle.unwatch(see)
            self._dialogue.remove_tap(recording.see_chunk)
            self._scanner.unwatch(recording.see_scan)

    def adopt(self, dialogue: Dialogue) -> None:
        """The session goes on over another line. Recordings of the lost one end, since a file holds one line."""
        for recording in tuple(self._running):
            recording.fail(
                CannotRecord(f"the line to the lidar was lost; {recording.path} holds what came before that")
            )
        self._dialogue = dialogue

    async def close(self) -> None:
        """End every recording of the session, and return when the files are complete."""
        for recording in tuple(self._running):
            await recording.close()
