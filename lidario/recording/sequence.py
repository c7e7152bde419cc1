"""What matters of the files of a recording, one file after the other, as if they were one.

A pattern may name the parts of one recording (`lidario.recording.parts`), and several recordings of one lidar.
Files are read in the order of the times at which they begin. The next recording begins another stream.
"""

import glob
import os
from collections.abc import Iterator, Sequence
from pathlib import Path

from lidario.basics.system import working_folder
from lidario.errors import RecordingError
from lidario.recording.about import NAME, About
from lidario.recording.chronicle import StreamEvent, event_of
from lidario.recording.mcap_records import Channel, Damage, Message, Metadata, read_records
from lidario.recording.opened import StoredFile
from lidario.recording.reached import TWICE, Reached, StoredChunk
from lidario.recording.ros_messages import parse_text
from lidario.recording.write import EVENTS_TOPIC, RAW_TOPIC

MIXED = (
    "{} was merged of several recordings, and their bytes cannot be told apart. Name the files that it was made "
    "of, those of each lidar by themselves"
)

Stored = About | StoredChunk | StreamEvent | Metadata | Damage


def files_of(path: Path) -> tuple[Path, ...]:
    """The files that a path names: itself, or, where no file has that name, those that fit it as a pattern."""
    if not glob.has_magic(str(path)) or os.path.lexists(path):
        return (path,)
    found = tuple(Path(each) for each in sorted(glob.glob(str(path))))
    if not found:
        raise RecordingError(f"{path}: no file has a name that fits this pattern")
    return found


class RecordedFiles:
    """Files that are read as one recording, in the order of their times; they may be gone through several times.

    Raises:
        RecordingError: Several files are of several lidars, or one of them cannot be read.
    """

    def __init__(self, path: Path, paths: Sequence[Path]) -> None:
        self.paths: tuple[Path, ...] = tuple(paths)
        self.size: int = 0
        self._folder = working_folder()
        self._sizes: dict[Path, int] = {}
        if len(paths) > 1:
            beginnings = [(*self._beginning(each), each) for each in paths]
            # One of each recording: its files are of one lidar, although a damaged one may say nothing, or another.
            told = {
                about.recording or file: (about.info.family, about.info.model, about.info.serial)
                for about, _, file in beginnings
                if about.info.family
            }
            devices = set(told.values())
            if len(devices) > 1:
                names = "; ".join(sorted(" ".join(each) for each in devices)[:3])
                raise RecordingError(f"{path} names recordings of several lidars: {names}. Name those of one")
            self.paths = tuple(each for *_, each in sorted(beginnings, key=lambda known: known[1:]))

    def records(self) -> Iterator[Stored]:
        """The beginning, the raw chunks, the chronicle, other texts, and what of the files is damaged.

        Raises:
            RecordingError: A file was merged of several recordings or copies of one, or cannot be read.
        """
        reached = Reached()
        for path in self.paths:
            for record in self._records_of(path, reached):
                if isinstance(record, Damage) and len(self.paths) > 1:
                    record = record._replace(why=f"{path.name}: {record.why}")
                yield record
        self.size = sum(self._sizes.values())

    def _records_of(self, path: Path, reached: Reached) -> Iterator[Stored]:
        topics: dict[int, str] = {}
        begun: list[About] = []
        with StoredFile(path, self._sizes.get(path), self._folder) as file:
            self._sizes[path] = file.size
            for record in read_records(file):
                if isinstance(record, Message):
                    topic = topics.get(record.channel)
                    if topic == RAW_TOPIC:
                        yield from reached.chunk(record)
                    elif topic == EVENTS_TOPIC and (event := event_of(parse_text(record.data) or "")) is not None:
                        yield from reached.event(event)
                elif isinstance(record, Channel):
                    topics[record.number] = record.topic if record.topic in (RAW_TOPIC, EVENTS_TOPIC) else ""
                elif isinstance(record, Damage):
                    reached.is_known = reached.is_known and not record.missing
                    yield record
                elif record.name != NAME:
                    yield record
                else:
                    about = About.of(record.texts)
                    begun.append(about)
                    if about.recording != begun[0].recording:
                        raise RecordingError(MIXED.format(path))
                    if about in begun[:-1]:
                        raise RecordingError(TWICE)
                    if len(begun) > 1:
                        continue
                    if reached.repeats(about):
                        yield Damage("it holds what another file holds, and was left out", missing=False)
                        return
                    yield from reached.begin(about)

    def _beginning(self, path: Path) -> tuple[About, int]:
        """What stands at the beginning of a file, and when it was begun, on the clock of files."""
        about = About.of({})
        with StoredFile(path) as file:
            for record in read_records(file):
                if isinstance(record, Metadata) and record.name == NAME:
                    about = About.of(record.texts)
                    if about.began_ns:
                        break
                elif isinstance(record, Message):
                    # Older versions did not tell.
                    return about, record.at_ns
        return about, about.began_ns
