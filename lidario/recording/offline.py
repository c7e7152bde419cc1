"""Raw bytes to scans, without a device, a session or an event loop.

The bytes are those that a device sent, without times. They pass through the same `Link`, `Assembler` and decoders
as live ones, in blocks that hold ten to a hundred revolutions: as many as a processor's cache holds together with
what is decoded from them. Time is counted in samples, from 0 at the first byte of the stream: bytes that were
damaged take the time of the samples that they would have held, bytes that are missing take none. Where the angles
tell that packets are missing in a scan, what follows begins when it has ended.

Nothing larger is held than one block and its scans, and those that the caller keeps; who keeps one scan of a block
keeps all of them, some two megabytes.
"""

import logging
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from lidario.basics.arguments import finite, shown, text_of
from lidario.errors import InvalidValue, RecordingError
from lidario.families.base import Family, Known, RawStream, Stream
from lidario.families.registry import FAMILIES, families_of_model, family_named
from lidario.recording.stored_times import StoredTimes
from lidario.revolution.pipeline import Pipeline
from lidario.scans.measured import later
from lidario.scans.scan import Scan
from lidario.wire.copies import copy_of
from lidario.wire.link import Link

_log = logging.getLogger("lidario")
RawBytes: TypeAlias = bytes | bytearray | memoryview
"""Or anything else that has one dimension of bytes in one piece, as `mmap` or an array of uint8. A file behind
`mmap` that is cut meanwhile kills the program (SIGBUS); `decode_file` does not map it."""

BLOCK = 256 * 1024
"""Bytes decoded at a time. Measured, in MB/s for 0x81, 0x85 and 0x84: 275, 227 and 107 at 64 KiB; 374, 300 and 126
at 128; 453, 383 and 127 at 256. Above that 0x84 falls to 57: its arrays then come from the system each time."""
_TRIED = 32 * 1024  # bytes from the beginning of a stream that must tell whose packets they are
_MOST_US = 1e6


@dataclass(frozen=True, slots=True, eq=False)
class ScanArrays:
    """The samples of many scans, back to back; n samples in k scans. The arrays belong to the caller.

    Attributes:
        device_angles: Degrees, float32, clockwise, in [0, 360), shape (n,).
        device_distances: Millimetres, float32, 0 where nothing came back, shape (n,).
        intensities: uint8, shape (n,); None where any of the scans has none.
        starts: Index of each scan's first sample, then n; int64, shape (k + 1,).
        stamps_ns: When each scan's first sample was measured, nanoseconds from 0 at the beginning of the stream; of
            an MCAP recording, on the monotonic clock of the program that recorded it; int64, shape (k,).
        lost_packets: Packets of each scan that were damaged or lost; int64, shape (k,).
    """

    device_angles: NDArray[np.float32]
    device_distances: NDArray[np.float32]
    intensities: NDArray[np.uint8] | None
    starts: NDArray[np.int64]
    stamps_ns: NDArray[np.int64]
    lost_packets: NDArray[np.int64]


def decode(
    data: RawBytes, *, family: str | None = None, model: str | None = None, sample_us: float | None = None
) -> Iterator[Scan]:
    """Decode recorded bytes of one device, one revolution after the other.

    As live, the parts of a revolution at the beginning and at the end are left out. Stamps count from 0 at the
    beginning of the stream, wall-clock stamps too. It does no input or output and needs no event loop. Its
    arguments and the scans can be pickled, so it can run on other processes.

    Args:
        data: The bytes as they were received; they are not changed, and must not change meanwhile. Where a family
            has several formats, from the descriptor of the stream on, and what is before it is skipped; where it
            has one, from the descriptor or the first packet on.
        family: Short name of the family, as in ``family=`` of a source; None to tell it from the bytes.
        model: The model, as in ``model=`` of a source, where its bytes do not tell it. None to tell it from the
            bytes; where they leave a choice, it is a guess, which is logged.
        sample_us: Microseconds a sample; None for what the bytes tell, or the model or format usually takes.

    Raises:
        RecordingError: There is no measurement stream in the bytes. Damaged bytes raise nothing.
        InvalidValue: `data` is not bytes, or `sample_us` is not a number above 0 and up to 1000000.
        ConnectFailed: There is no such family or model (reason ``source``).
    """
    return iter(_decoder(data, Known(family, model, sample_us)))


def decode_arrays(
    data: RawBytes, *, family: str | None = None, model: str | None = None, sample_us: float | None = None
) -> ScanArrays:
    """As `decode`, all scans at once as a few arrays; the arguments and errors are the same."""
    return arrays_of(_decoder(data, Known(family, model, sample_us)))


def _decoder(data: RawBytes, known: Known) -> "OfflineDecoder":
    decoder = OfflineDecoder(data, known)
    if decoder.guess:
        _log.warning("%s", decoder.guess)
    return decoder


def arrays_of(decoder: Iterable[Scan]) -> ScanArrays:
    """All scans of a decoder, as a few arrays."""
    scans = list(decoder)
    starts = np.zeros(len(scans) + 1, np.int64)
    np.cumsum([len(scan) for scan in scans], out=starts[1:])
    none = np.empty(0, np.float32)
    # A file may hold streams of several formats, of which only some carry intensities.
    parts = [scan.intensities for scan in scans if scan.intensities is not None]
    return ScanArrays(
        device_angles=np.concatenate([none, *(scan.device_angles for scan in scans)]),
        device_distances=np.concatenate([none, *(scan.device_distances for scan in scans)]),
        intensities=np.concatenate(parts) if parts and len(parts) == len(scans) else None,
        starts=starts,
        stamps_ns=np.array([scan.stamp_ns for scan in scans], np.int64),
        lost_packets=np.array([scan.lost_packets for scan in scans], np.int64),
    )


class UntimedScans:
    """Makes scans of the bytes of a stream that has no times; it is used once.

    `pipeline` decodes them, and counts what became of bytes and packets.
    """

    def __init__(self, stream: Stream) -> None:
        self.stream: Stream = stream
        link = Link(BLOCK)
        link.enter_stream(stream.format)
        self.pipeline: Pipeline = Pipeline(stream, link=link, clock=StoredTimes(stream))
        self._end_ns = self._behind_ns = 0

    def scans_of(self, blocks: Iterable[RawBytes]) -> Iterator[Scan]:
        """The scans of all bytes of the stream, in blocks of at most `BLOCK` bytes."""
        for block in blocks:
            yield from map(self._in_time, self.pipeline.receive(block))
        yield from map(self._in_time, self.pipeline.assembler.end())

    def _in_time(self, scan: Scan) -> Scan:
        """The scan, not before the one before has ended: packets that are missing without a trace took time too."""
        early_ns = self._end_ns - scan.stamp_ns - self._behind_ns
        if early_ns > self.stream.sample_ns:
            self._behind_ns += early_ns
        if self._behind_ns:
            scan = later(scan, self._behind_ns)
        self._end_ns = scan.stamp_ns + scan.duration_ns
        return scan


class OfflineDecoder(UntimedScans):
    """Decodes recorded bytes as `decode` does, and with its errors. It is iterated over once.

    The stream begins at the offset `begin` in `data`; `title` and `guess` are those of `RawStream`.
    """

    def __init__(self, data: RawBytes, known: Known = Known()) -> None:  # noqa: B008 - it cannot be changed
        try:
            self._data = memoryview(data).cast("B")
        except (TypeError, ValueError):
            raise InvalidValue(f"recorded bytes are bytes in one piece, not {shown(data)}") from None
        if known.sample_us is not None:
            if not 0 < finite(known.sample_us, "sample_us") <= _MOST_US:
                raise InvalidValue(f"sample_us is above 0 and at most {_MOST_US:.0f}, not {known.sample_us!r}")
            known = known._replace(sample_us=float(known.sample_us))
        family, found = _recognise(self._data, known)
        self.family: Family = family
        self.begin: int = found.begin
        self.title: str = found.title
        self.guess: str = found.guess
        super().__init__(found.stream)

    def __iter__(self) -> Iterator[Scan]:
        return self.scans_of(self._data[at : at + BLOCK] for at in range(self.begin, len(self._data), BLOCK))


def _recognise(data: memoryview, known: Known) -> tuple[Family, RawStream]:
    """Whose stream is in the bytes, and where it begins."""
    families: Sequence[Family] = FAMILIES
    if known.model is not None:
        model = text_of(known.model, "the name of a model").casefold()
        known, families = known._replace(model=model), families_of_model(model, known.family)
    elif known.family is not None:
        families = (family_named(known.family),)
    best: tuple[Family, RawStream] | None = None
    most = 0
    for each in families:
        found = each.find_stream(data, known)
        if found is None:
            continue
        # Two families may announce their streams alike: the one whose packets follow is right.
        link = Link()
        # A format remembers what it has seen.
        link.enter_stream(copy_of(found.stream.format))
        link.receive_data(data[found.begin : found.begin + _TRIED], 0)
        if best is None or link.stats.packet_bytes > most:
            best, most = (each, found), link.stats.packet_bytes
        if 2 * most > min(len(data), found.begin + _TRIED):
            # Most of the bytes so far. The packets of other families would have to be searched for in all bytes.
            break
    if best is None or not (most or known.family):
        of = f" of the family {known.family!r}" if known.family else ""
        of += f" of the model {known.model!r}" if known.model else ""
        raise RecordingError(
            f"no measurement stream{of} among {len(data)} bytes; it must be recorded from its start on"
        )
    return best
