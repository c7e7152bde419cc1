"""Writing the file of a recording: MCAP with one chunk a second, so that no cut loses more.

The package ``mcap`` makes the bytes, and this module hands them to the operating system, one whole chunk at a
time. So a write that fails half-way, because the disk is full, can be taken back: the file ends behind the last
chunk that is complete. Each chunk begins with the place of its bytes and with the stream that runs, so that a
reader needs no other chunk to use it.

Nothing here knows an event loop; `lidario.recording.record` calls it from a thread.
"""

import contextlib
import errno
import io
import os
from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path
from typing import IO, Any

from lidario.basics.system import cause_of
from lidario.basics.whole_file import not_a_file
from lidario.errors import CannotRecord
from lidario.port.forked import leave_nothing, let_go_in_children
from lidario.recording.about import NAME, About
from lidario.recording.chronicle import EventState, Placed, event_of, text_of
from lidario.recording.ros_messages import DEFINITIONS, LASERSCAN_TYPE, RAW_TYPE, TEXT_TYPE, encode_raw, encode_text
from lidario.scans.laserscan import LaserScan
from lidario.scans.scan import Scan

RAW_TOPIC = "/lidar/raw"
EVENTS_TOPIC = "/lidar/events"
SCAN_TOPIC = "/scan"
PROFILE = "ros2"
_CHUNK_LIMIT = 1 << 30
"""The package would end a chunk at its own size; here chunks end when `flush` says so, or at `_MOST_PENDING`."""
_MOST_PENDING = 4 << 20
"""Bytes of messages at which a chunk ends. With the last message, which has 8 MiB at most (`QUEUE_BYTES` in
`lidario.recording.record`), it stays below what is read of a chunk (`lidario.recording.mcap_records`)."""


class _Sink(io.BytesIO):
    """Takes what the package writes, until it is handed on."""

    _taken = 0

    def tell(self) -> int:
        return self._taken + super().tell()

    def take(self) -> bytes:
        data = self.getvalue()
        self._taken += len(data)
        self.seek(0)
        self.truncate(0)
        return data


def file_time(scan: Scan, message: LaserScan, clock_offset_ns: int) -> int:
    """When a scan was measured, by the clock of a file; its message has the wall clock, which may have been set."""
    return message.stamp_ns - scan.wall_stamp_ns + scan.stamp_ns + clock_offset_ns


class FileWriter:
    """One file that is being written. It raises CannotRecord where that cannot be, or ``mcap`` is missing.

    With `sync` each chunk is on the disk when `flush` returns, so that it outlasts a power cut. `target` is what
    the file will be named, for messages, where it has another name yet. `size` is that of the file so far.
    """

    def __init__(
        self, path: Path, about: About, *, overwrite: bool = False, sync: bool = False, target: Path | None = None
    ) -> None:
        try:
            from mcap.writer import CompressionType, Writer
        except ModuleNotFoundError:
            raise CannotRecord("recording needs mcap, which is not installed: pip install mcap") from None
        self.path: Path = target or path
        self.size: int = 0
        self._sync = sync
        self._sink = _Sink()
        self._writer: Any = Writer(
            self._sink, chunk_size=_CHUNK_LIMIT, compression=CompressionType.NONE, enable_data_crcs=True
        )
        self._channels: dict[str, int] = {}
        self._numbers: dict[str, int] = {}
        self._about = about
        self._place = about.received_before
        self._state = EventState(about.events)
        self._pending: int = 0
        try:
            self._file = _opened(path, overwrite)
            let_go_in_children(self)
            # A file that is to get its name later has none.
            self._has_name = os.fstat(self._file.fileno()).st_nlink > 0
        except OSError as error:
            raise cannot_write(self.path, error) from error
        if sync:
            _sync_folder(path)
        try:
            self._writer.start(PROFILE, f"lidario {about.lidario}")
            self._writer.add_metadata(NAME, about.as_texts())
            self._register(RAW_TOPIC, RAW_TYPE)
            self._register(EVENTS_TOPIC, TEXT_TYPE)
            self.flush()
        except BaseException:
            self._file.close()
            if not overwrite:
                # It is new, and holds nothing: its name would only be taken.
                with contextlib.suppress(OSError):
                    path.unlink()
            raise

    @property
    def count_of_scans(self) -> int:
        """Scans added so far."""
        return self._numbers.get(SCAN_TOPIC, 0)

    def about_now(self, began_ns: int) -> About:
        """What stands at the beginning of the file that goes on where this one ends."""
        return replace(self._about, received_before=self._place, began_ns=began_ns, events=self._state.events)

    def add_chunk(self, at_ns: int, sent: bool, data: bytes, place: int | None = None) -> None:
        """Add a chunk of bytes; `at_ns` is nanoseconds since the Unix epoch, here and below.

        What was received stands at that `place`, where it does not follow on the chunk before.
        """
        if not sent and place is not None and place != self._place:
            self._place = place
            self._add(EVENTS_TOPIC, at_ns, encode_text(text_of(Placed(place, self._state.running))))
        self._add(RAW_TOPIC, at_ns, encode_raw(sent, data))
        self._place += 0 if sent else len(data)

    def add_event(self, at_ns: int, text: str) -> None:
        """Add one line of the chronicle."""
        self._add(EVENTS_TOPIC, at_ns, encode_text(text))
        self._state.follow(event_of(text))

    def add_scans(self, scans: Iterable[tuple[Scan, LaserScan]]) -> None:
        """Add the messages of scans, as `LaserScans` makes them."""
        for scan, message in scans:
            if SCAN_TOPIC not in self._channels:
                self._register(SCAN_TOPIC, LASERSCAN_TYPE)
            self._add(SCAN_TOPIC, file_time(scan, message, self._about.clock_offset_ns), message.to_cdr())

    def add_metadata(self, name: str, texts: dict[str, str]) -> None:
        """Add a named set of texts, beside those of the recording, for who knows the name.

        They are handed to the operating system at once, in front of the chunk under way.
        """
        self._writer.add_metadata(name, texts)
        self._write_out()

    def flush(self) -> None:
        """End the chunk and hand it to the system. Where that fails, the file ends behind the one before."""
        self._pending = 0
        self._writer.flush()
        self._write_out()
        self._sync_now()

    def close(self) -> None:
        """Write the index and close the file. Where the last bytes do not fit, it is readable without them."""
        try:
            self._writer.finish()
            self._write_out()
            self._sync_now()
        finally:
            self._file.close()

    def forked(self) -> None:
        """In a forked child: the file is the parent's, and locked no longer than the parent has it open."""
        with contextlib.suppress(ValueError):  # it is closed
            leave_nothing(self._file.fileno())

    def abandon(self) -> None:
        """Close the file as it is, after a failure. Never raises."""
        with contextlib.suppress(OSError):
            self._file.close()

    def _register(self, topic: str, name: str) -> None:
        schema = self._writer.register_schema(name, "ros2msg", DEFINITIONS[name].encode())
        self._channels[topic] = self._writer.register_channel(topic, "cdr", schema)

    def _add(self, topic: str, at_ns: int, message: bytes) -> None:
        if not self._pending:
            self._put(EVENTS_TOPIC, at_ns, encode_text(text_of(Placed(self._place, self._state.running))))
        self._put(topic, at_ns, message)
        if self._pending > _MOST_PENDING:
            self.flush()

    def _put(self, topic: str, at_ns: int, message: bytes) -> None:
        self._pending += len(message)
        number = self._numbers.get(topic, 0)
        self._numbers[topic] = number + 1
        # Time stamps of MCAP have no sign; the wall clock of a board without battery may begin at 0.
        at_ns = max(0, at_ns)
        self._writer.add_message(self._channels[topic], at_ns, message, at_ns, number & 0xFFFF_FFFF)

    def _sync_now(self) -> None:
        if not self._sync:
            return
        try:
            os.fsync(self._file.fileno())
        except OSError as error:
            # Some file systems cannot, those of networks for instance. What a disk has lost is another matter.
            if error.errno not in (errno.EINVAL, errno.ENOTSUP, errno.ENOSYS):
                raise cannot_write(self.path, error) from error

    def _must_be_ours(self) -> None:
        """Refuse to go on where the file was taken away, or another program writes to it, too."""
        now = os.fstat(self._file.fileno())
        if self._has_name and not now.st_nlink:
            raise CannotRecord(f"{self.path} was removed while it was written, so nothing of it is left")
        if now.st_size != self.size:
            raise CannotRecord(f"{self.path} was changed by another program while it was written")

    def _write_out(self) -> None:
        data = memoryview(self._sink.take())
        try:
            self._must_be_ours()
            while data:
                data = data[self._file.write(data) :]
        except OSError as error:
            with contextlib.suppress(OSError):
                os.ftruncate(self._file.fileno(), self.size)
            raise cannot_write(self.path, error) from error
        self.size = self._sink.tell()


def _opened(path: Path, overwrite: bool) -> io.FileIO:
    """A file to be written, new or replaced; what is no regular file is neither waited for nor written to."""
    if overwrite:
        if not_a_file(path):
            raise FileExistsError
        check_not_recorded(path)
    file = io.FileIO(path, "w" if overwrite else "x")
    _lock(file, alone=True)
    return file


def check_not_recorded(path: Path) -> None:
    """Raise CannotRecord where a file is to be replaced that is being recorded."""
    if is_written(path):
        raise CannotRecord(f"{path} is written by another recorder, so it cannot be replaced: name another file")


def is_written(path: Path) -> bool:
    """Whether a `FileWriter` of any program has this file open, as far as that can be told."""
    if not_a_file(path):
        return False
    with contextlib.suppress(OSError), open(path, "rb") as file:
        return not _lock(file, alone=False)
    return False


def _lock(file: IO[bytes], *, alone: bool) -> bool:
    """Lock a file until it is closed, also when the program is killed; False where another one has done so."""
    try:
        import fcntl

        fcntl.flock(file, (fcntl.LOCK_EX if alone else fcntl.LOCK_SH) | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    except (ModuleNotFoundError, OSError):  # Windows, and not every file system can
        pass
    return True


def _sync_folder(path: Path) -> None:
    """Have the disk know the name of a new file, too. Where that cannot be done, a power cut may cost the file."""
    with contextlib.suppress(OSError):
        folder = os.open(path.parent, os.O_RDONLY)
        try:
            os.fsync(folder)
        finally:
            os.close(folder)


def cannot_write(path: Path, error: OSError | MemoryError) -> CannotRecord:
    """What is told of a file that is there already, or cannot be written."""
    kind = not_a_file(path)
    if kind:
        return CannotRecord(f"{path} cannot be written: it is {kind}, which is not replaced by a file")
    if isinstance(error, FileExistsError):
        return CannotRecord(f"{path} exists already: overwrite=True, or --force, replaces it")
    return CannotRecord(f"{path} cannot be written: {cause_of(error)}")
