"""Every byte and event of a bench, written into a recording as they come, without the serial number.

What came is held back for a second. A read may end within the serial number, and a device may tell another number
than before, which is known only when its response was read. So no number was ever on a disk, and a program that is
killed leaves all but the last two seconds.
"""

from collections import deque
from contextlib import suppress
from dataclasses import replace
from itertools import islice
from pathlib import Path
from typing import Final

from lidario.conformance.bench import Bench
from lidario.conformance.hidden import REACH, Numbers
from lidario.errors import Unsupported
from lidario.families.registry import family_named
from lidario.recording.about import About
from lidario.recording.chronicle import Responded, StreamEvent, text_of
from lidario.recording.device import recalled
from lidario.recording.record import Recording
from lidario.session.recorded import about_now

MOST_BYTES: Final = 64 << 20
"""Of both directions: ten minutes of the fastest stream. What comes behind that is not kept, and counted."""
HELD_NS: Final = 1_000_000_000


class Kept:
    """What happens on a bench, as far as a recording of it may know; a `lidario.recording.record.Recorded`.

    `source` is what is said of where the device is: no name that tells more of the computer than must be known.
    `numbers` are the serial numbers that it has told, and so many bytes were `left_out`. The `recording` is to be
    started and closed.
    """

    sends_bytes: bool = True
    files: tuple[Path, ...] = ()

    def __init__(self, bench: Bench, path: Path, source: str, *, overwrite: bool) -> None:
        self._dialogue = bench.dialogue
        self._family = family_named(bench.connection.info.family)
        self._lidar = bench.lidar
        self._source = source
        self.numbers: Numbers = Numbers()
        self._learn(self._lidar.info.serial)
        self.left_out: int = 0
        self._size = 0
        self._held: deque[tuple[int, bool, bytes | StreamEvent]] = deque()
        self._before = b""
        self.recording: Recording = Recording(path, self, scans=None, overwrite=overwrite, sync=True)

    def about(self) -> About:
        """What stands at the beginning of a file that begins now; with the hash in place of the serial number."""
        about = about_now(self._dialogue, self._lidar.info, self._lidar.health, self._source)
        info = replace(about.info, serial=self.numbers.in_text(about.info.serial))
        return replace(about, info=info, events=tuple(map(self._without, about.events)))

    # --------------------------------------------------------------------------- what the recording calls

    def begin_recording(self, recording: Recording) -> About:  # noqa: ARG002
        self._dialogue.port.poll()
        about = self.about()
        self._dialogue.port.add_tap(self._see_chunk)
        self._dialogue.chronicle.watch(self._see_event)
        return about

    def end_recording(self, recording: Recording) -> None:  # noqa: ARG002
        """As `Recorded`: what is held back is written first."""
        self._dialogue.port.remove_tap(self._see_chunk)
        self._dialogue.chronicle.unwatch(self._see_event)
        self._release(None)

    def _see_chunk(self, direction: str, data: bytes, now: int) -> None:
        if self._size + len(data) > MOST_BYTES:
            self.left_out += len(data)
            return
        self._size += len(data)
        self._held.append((now, direction == "out", bytes(data)))
        self._release(now - HELD_NS)

    def _see_event(self, event: StreamEvent) -> None:
        if isinstance(event, Responded):
            # Where it was not asked for all of it, it has told no number either.
            with suppress(Unsupported):
                script, responses = self._family.device().identify(), self._dialogue.chronicle.responses
                self._learn(recalled(script, responses, "it does not tell what it is").serial)
        if not self.left_out:
            self._held.append((self._dialogue.port.now(), False, event))

    def _learn(self, serial: str) -> None:
        self.numbers.add(serial, [each.payload for each in self._dialogue.chronicle.responses.values()])

    def _release(self, until: int | None) -> None:
        """Write what came before `until`, or all."""
        while self._held and (until is None or self._held[0][0] < until):
            now, sent, entry = self._held.popleft()
            if not isinstance(entry, bytes):
                self.recording.see_event(text_of(self._without(entry)), now)
            elif sent:
                self.recording.see_chunk("out", entry, now)
            else:
                self.recording.see_chunk("in", self.numbers.in_bytes(entry, self._before, self._behind()), now)
                self._before = (self._before + entry)[-REACH:]

    def _behind(self) -> bytes:
        """The next bytes that came."""
        came = (entry[:REACH] for _, sent, entry in self._held if isinstance(entry, bytes) and not sent)
        return b"".join(islice(came, REACH))[:REACH]

    def _without(self, event: StreamEvent) -> StreamEvent:
        if not isinstance(event, Responded):
            return event
        return replace(event, payload=self.numbers.in_bytes(event.payload))
