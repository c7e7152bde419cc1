"""Writing the scans of a recording to files that other programs read: NPZ and MCAP.

Memory does not grow with the file: the arrays of an NPZ are first written to files beside it, since their lengths,
which stand at their beginning, are known only at the end. What is written appears under its name when it is whole.
"""

import json
import shutil
import tempfile
import zipfile
from collections.abc import Iterable, Iterator
from contextlib import ExitStack, closing, contextmanager, suppress
from dataclasses import asdict
from functools import partial
from heapq import merge
from itertools import chain
from operator import itemgetter
from pathlib import Path
from typing import IO, Any

import numpy as np

from lidario.basics.whole_file import whole_file
from lidario.recording.decode_file import FileDecoder
from lidario.recording.read import Copy
from lidario.recording.write import FileWriter, cannot_write, check_not_recorded, file_time
from lidario.scans.laserscans import LaserScans
from lidario.scans.scan import Scan

CHUNK_NS = 1_000_000_000
_COPY = 1 << 20


@contextmanager
def write_whole(path: Path, *, overwrite: bool) -> Iterator[Path]:
    """As `whole_file`.

    Raises:
        CannotRecord: It cannot be written, or is there already.
    """
    try:
        if path.exists() and not overwrite:
            raise FileExistsError
        check_not_recorded(path)
        with whole_file(path) as part:
            yield part
    except OSError as error:
        raise cannot_write(path, error) from error


def must_be_writable(path: Path, *, overwrite: bool) -> None:
    """Begin to write a file, and give it up: before it takes long to make what shall be in it."""
    with suppress(_GivenUp), write_whole(path, overwrite=overwrite):
        raise _GivenUp


class _GivenUp(Exception):
    """Ends a block whose file shall not appear."""


def export_npz(decoder: FileDecoder, path: Path, *, overwrite: bool = False) -> int:
    """Write all scans to an NPZ file; returns how many.

    It holds `device_angles`, `device_distances`, `intensities` (absent where the format has none), `starts`,
    `stamps_ns`, `lost_packets` and `meta`, as `lidario.ScanArrays` describes them; `meta` is a text in JSON. Stamps
    are nanoseconds since the Unix epoch, and of bare bytes from 0 on.

    Raises:
        CannotRecord: It cannot be written, or is there already.
    """
    with write_whole(path, overwrite=overwrite) as part, ExitStack() as files:
        angles, distances, intensities = (
            files.enter_context(tempfile.TemporaryFile(dir=path.parent)) for _ in range(3)
        )
        starts, stamps, lost = [0], [], []
        modes: dict[str, None] = {}
        for scan in decoder:
            angles.write(scan.device_angles.data)
            distances.write(scan.device_distances.data)
            if scan.intensities is not None:
                intensities.write(scan.intensities.data)
            starts.append(starts[-1] + len(scan))
            stamps.append(scan.wall_stamp_ns)
            lost.append(scan.lost_packets)
            modes[scan.mode] = None
        recording = decoder.recording
        meta = {
            **asdict(recording.about.info),
            "source": recording.about.source,
            "modes": list(modes),
            "damage": recording.damage,
        }
        with zipfile.ZipFile(part, "w", zipfile.ZIP_STORED) as archive:
            _add_file(archive, "device_angles", angles, np.dtype("<f4"), starts[-1])
            _add_file(archive, "device_distances", distances, np.dtype("<f4"), starts[-1])
            # Not where some of the scans have none.
            if stamps and intensities.tell() == starts[-1]:
                _add_file(archive, "intensities", intensities, np.dtype("u1"), starts[-1])
            _add(archive, "starts", np.array(starts, np.int64))
            _add(archive, "stamps_ns", np.array(stamps, np.int64))
            _add(archive, "lost_packets", np.array(lost, np.int64))
            _add(archive, "meta", np.array(json.dumps(meta)))
    return len(stamps)


def export_mcap(
    decoder: FileDecoder, path: Path, messages: LaserScans | None = None, *, overwrite: bool = False
) -> int:
    """Write a recording that holds each scan on ``/scan`` too; returns how many scans. As `export_npz` else."""
    recording = decoder.recording
    begun_ns = None
    messages = messages or LaserScans()
    with write_whole(path, overwrite=overwrite) as part, closing(recording.copies()) as stored:
        writer = FileWriter(part, recording.about, overwrite=True, target=path)
        try:
            # Each scan before the first chunk that is later.
            scans = _messages(messages, decoder, recording.about.clock_offset_ns)
            for at_ns, write in merge(scans, stored, key=itemgetter(0)):
                write(writer)
                begun_ns = at_ns if begun_ns is None else begun_ns
                if at_ns - begun_ns >= CHUNK_NS:
                    writer.flush()
                    begun_ns = None
            writer.close()
        finally:
            writer.abandon()
    return writer.count_of_scans


def _messages(made: LaserScans, scans: Iterable[Scan], clock_offset_ns: int) -> Iterator[Copy]:
    for ready in chain(chain.from_iterable(map(made.take, scans)), made.rest()):
        yield file_time(*ready, clock_offset_ns), partial(FileWriter.add_scans, scans=(ready,))


def _add(archive: zipfile.ZipFile, name: str, array: np.ndarray[Any, Any]) -> None:
    with archive.open(f"{name}.npy", "w") as member:
        np.lib.format.write_array(member, array, allow_pickle=False)


def _add_file(archive: zipfile.ZipFile, name: str, file: IO[bytes], kind: np.dtype[Any], count: int) -> None:
    file.seek(0)
    with archive.open(f"{name}.npy", "w", force_zip64=True) as member:
        header = {"descr": kind.str, "fortran_order": False, "shape": (count,)}
        np.lib.format.write_array_header_1_0(member, header)
        shutil.copyfileobj(file, member, _COPY)
