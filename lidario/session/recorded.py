"""One session as recordings see it: its chunks, its chronicle and its scans, handed to each recording."""

import secrets
from pathlib import Path
from weakref import WeakSet

from lidario.basics.model import DeviceInfo, Health
from lidario.filters.base import Filter
from lidario.recording.about import About
from lidario.recording.chronicle import LineChanged, StreamEvent, moved, text_of
from lidario.recording.record import Recording
from lidario.scans.scan import Scan
from lidario.session.finding.connection import At
from lidario.session.streaming.scanner import Scanner
from lidario.session.talking.dialogue import Dialogue
from lidario.version import __version__

_ID_BYTES = 8


class RecordedSession:
    """Implements `Recorded`."""

    def __init__(self, at: At, scanner: Scanner, source: str, filters: tuple[Filter, ...] = ()) -> None:
        # Whether the device sends bytes that can be kept; else whole scans arrive.
        self.sends_bytes: bool = at.dialogue.device.sends_bytes
        # Those of the recording that is played; none of a device.
        self.files: tuple[Path, ...] = at.dialogue.port.files
        self._at = at
        self._scanner = scanner
        self._source = source
        self._filters = filters
        self.running: dict[Recording, _Watcher] = {}  # the recordings that are handed everything
        # The thread of a recording holds it until its file is complete.
        self._begun: WeakSet[Recording] = WeakSet()

    def begin_recording(self, recording: Recording) -> About:
        """Hand every chunk, event and scan to `recording` from now on; returns what stands at the beginning."""
        dialogue = self._at.dialogue
        # What was read and not parsed yet belongs to the time before.
        dialogue.port.poll()
        about = about_now(dialogue, self._at.info, self._scanner.failures.health, self._source)
        self._begun.add(recording)
        watcher = self.running[recording] = _Watcher(recording, dialogue, self._filters)
        dialogue.chronicle.watch(watcher.see)
        dialogue.port.add_tap(watcher.see_chunk)
        self._scanner.hub.watch(watcher.see_scan)
        return about

    def end_recording(self, recording: Recording) -> None:
        """Hand it no more; harmless when done before."""
        watcher = self.running.pop(recording, None)
        if watcher is not None:
            self._at.dialogue.chronicle.unwatch(watcher.see)
            self._at.dialogue.port.remove_tap(watcher.see_chunk)
            self._scanner.hub.unwatch(watcher.see_scan)

    def adopt(self) -> None:
        """The session goes on over another line, which has the taps of the lost one, and so do its recordings."""
        for watcher in self.running.values():
            watcher.change_line(self._at.dialogue)
            self._at.dialogue.chronicle.watch(watcher.see)

    async def close(self) -> None:
        """End every recording of the session, and return when the files are complete.

        Also those of which somebody was cancelled who waited for that.
        """
        for recording in tuple(self._begun):
            await recording.close()


def about_now(dialogue: Dialogue, info: DeviceInfo, health: Health, source: str) -> About:
    """What stands at the beginning of a file that begins here."""
    chronicle = dialogue.chronicle
    return About(
        info=info,
        health=health,
        source=source,
        baudrate=dialogue.port.baudrate,
        clock_offset_ns=dialogue.port.wall_offset_ns,
        received_before=dialogue.link.fed,
        lidario=__version__,
        recording=secrets.token_hex(_ID_BYTES),
        began_ns=max(0, dialogue.port.now() + dialogue.port.wall_offset_ns),
        events=chronicle.events,
    )


class _Watcher:
    """Hands to one recording what happens, with the places of its file."""

    def __init__(self, recording: Recording, dialogue: Dialogue, filters: tuple[Filter, ...]) -> None:
        self._recording = recording
        self._dialogue = dialogue
        self._filters = filters
        # What is added to the places of this line; and where the file is, which counts what it was given.
        self._shift = 0
        self._place = dialogue.link.fed
        self._last_ns = dialogue.port.now()

    def see(self, event: StreamEvent) -> None:
        """Something was added to the chronicle."""
        self._recording.see_event(text_of(moved(event, self._shift)), self._dialogue.port.now())

    def see_scan(self, scan: Scan) -> None:
        """A scan was made; a recording has what a reader gets."""
        for each in self._filters:
            scan = each(scan)
        self._recording.see_scan(scan)

    def see_chunk(self, direction: str, data: bytes, now: int) -> None:
        if direction == "in":
            self._place += len(data)
            self._last_ns = now
        self._recording.see_chunk(direction, data, now)

    def change_line(self, dialogue: Dialogue) -> None:
        """The session goes on over that line, whose first bytes were not seen here."""
        self._dialogue = dialogue
        self._shift = self._place - dialogue.link.fed
        away_ns = max(0, dialogue.port.now() - self._last_ns)
        self.see(LineChanged(dialogue.link.fed, away_ns))
        for response in dialogue.chronicle.responses.values():
            self.see(response)
