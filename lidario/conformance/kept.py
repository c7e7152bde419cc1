"""Every byte and event of a bench, kept in memory until the report is written.

Only then is the serial number known wherever it stands, and nothing with it was ever on a disk. A report takes a
minute or two, which is a few megabytes at most.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Final

from lidario.conformance.bench import Bench
from lidario.conformance.hidden import Hidden, hide
from lidario.recording.about import About
from lidario.recording.chronicle import Responded, StreamEvent, text_of
from lidario.recording.record import CHUNK_NS
from lidario.recording.write import FileWriter
from lidario.session.recorded import about_now

__all__ = ["MOST_BYTES", "Kept"]

MOST_BYTES: Final = 64 << 20
"""Of both directions: ten minutes of the fastest stream. What comes behind that is not kept, and counted."""


class Kept:
    """What happens on a bench from now on.

    Args:
        bench: The bench.
        source: What is said of where the device is; no name that tells more of the computer than must be known.

    Attributes:
        about: What stands at the beginning of the file, with the serial number.
        left_out: Bytes that were not kept.
    """

    def __init__(self, bench: Bench, source: str) -> None:
        self._dialogue = bench.connection.dialogue
        self._dialogue.poll()
        self.about: About = about_now(self._dialogue, bench.lidar.info, bench.lidar.health, source)
        self.left_out: int = 0
        self._size = 0
        self._entries: list[tuple[int, bool, bytes | StreamEvent]] = []
        self._dialogue.add_tap(self._see_chunk)
        self._dialogue.chronicle.watch(self._see_event)

    def hidden(self) -> Hidden:
        """The serial number, and its hash."""
        events = [*self.about.events, *(entry for _, _, entry in self._entries if isinstance(entry, Responded))]
        return hide(self.about.info.serial, [each.payload for each in events if isinstance(each, Responded)])

    def write(self, path: Path, name: str, texts: dict[str, str], *, overwrite: bool) -> None:
        """Write the file: a recording like any other, with a set of texts more, and a hash for the serial number.

        Args:
            path: Where.
            name: Name of the texts.
            texts: The texts.
            overwrite: Whether a file that is there already may be replaced.

        Raises:
            CannotRecord: It cannot be written.
        """
        hidden = self.hidden()
        info = replace(self.about.info, serial=hidden.in_text(self.about.info.serial))
        events = tuple(_without(event, hidden) for event in self.about.events)
        received = [entry for _, sent, entry in self._entries if isinstance(entry, bytes) and not sent]
        chunks = iter(hidden.in_chunks(received))
        writer = FileWriter(path, replace(self.about, info=info, events=events), overwrite=overwrite, sync=True)
        try:
            writer.add_metadata(name, texts)
            first_ns: int | None = None
            for now, sent, entry in self._entries:
                if first_ns is not None and now - first_ns >= CHUNK_NS:
                    writer.flush()
                    first_ns = None
                first_ns = now if first_ns is None else first_ns
                at_ns = now + self.about.clock_offset_ns
                if isinstance(entry, bytes):
                    writer.add_chunk(at_ns, sent, entry if sent else next(chunks))
                else:
                    writer.add_event(at_ns, text_of(_without(entry, hidden)))
            writer.close()
        finally:
            writer.abandon()

    def _see_chunk(self, direction: str, data: bytes, now: int) -> None:
        if self._size + len(data) > MOST_BYTES:
            self.left_out += len(data)
            return
        self._size += len(data)
        self._entries.append((now, direction == "out", bytes(data)))

    def _see_event(self, event: StreamEvent) -> None:
        if not self.left_out:
            self._entries.append((self._dialogue.now(), False, event))


def _without(event: StreamEvent, hidden: Hidden) -> StreamEvent:
    if not isinstance(event, Responded):
        return event
    return replace(event, payload=hidden.in_bytes(event.payload))
