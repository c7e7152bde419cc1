"""From packets to full revolutions.

The assembler keeps the packets of the turn in progress as bytes, and looks only at their headings. At the seam
it joins them, has them decoded in one go, cuts the samples exactly where the rotor passed the seam (the rest of
the packet that crosses it begins the next turn), and builds one `Scan`.

What it will not deliver: the first, partial turn; a turn around a restart of the stream; a turn of which so much
is missing that parts of two may have met. The last two are counted as broken.

Time stamps: a packet arrives after its last sample was measured, by the time its bytes take on the wire plus a
sample and a half in the device (vendor's SDK 2.1.0 for one family, adopted for all), and then by whatever the
adapter, the kernel and the event loop add. The device's own clock is even, so of all packets of a turn the one
that was least delayed tells best when the turn began.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from lidario.families.base import Samples, Stream
from lidario.model import Scan
from lidario.seam import Seam
from lidario.wire.events import Packets

__all__ = ["Assembler", "AssemblerStats"]

_BITS_A_BYTE = 10
_DEVICE_DELAY_SAMPLES = 1.5
_BROKEN_TURNS = 0.9
"""Share of a turn that may be missing in time, not seen as a jump of the angle, before a turn is broken."""

_A = TypeVar("_A", bound=np.generic)


@dataclass(slots=True)
class AssemblerStats:
    """Running totals; they only grow.

    Attributes:
        scans: Revolutions delivered.
        broken_scans: Revolutions thrown away.
        lost_packets: Packets missing, also those of turns not delivered.
    """

    scans: int = 0
    broken_scans: int = 0
    lost_packets: int = 0


@dataclass(slots=True, eq=False)
class _Arrays:
    """Samples of a turn in the making; shape (n,) each."""

    angle: NDArray[np.float64]
    distance: NDArray[np.float32]
    intensity: NDArray[np.uint8] | None

    def cut(self, begin: int, end: int | None = None) -> _Arrays:
        intensity = None if self.intensity is None else self.intensity[begin:end]
        return _Arrays(self.angle[begin:end], self.distance[begin:end], intensity)

    def before(self, later: _Arrays) -> _Arrays:
        if not len(self.angle):
            return later
        intensity = None
        if self.intensity is not None and later.intensity is not None:
            intensity = np.concatenate((self.intensity, later.intensity))
        return _Arrays(
            np.concatenate((self.angle, later.angle)),
            np.concatenate((self.distance, later.distance)),
            intensity,
        )


class Assembler:
    """Builds the scans of one stream.

    Args:
        stream: The stream, as its family described it.
        baudrate: Speed of the line in bits a second; 0 when bytes take no time.
        wall_offset_ns: Wall clock minus monotonic clock.
        stats: Counters to add to; fresh ones by default.
    """

    def __init__(
        self, stream: Stream, baudrate: int = 0, wall_offset_ns: int = 0, stats: AssemblerStats | None = None
    ) -> None:
        self.stats = stats or AssemblerStats()
        self._stream = stream
        self._byte_ns = _BITS_A_BYTE * 1e9 / baudrate if baudrate else 0.0
        self._wall_offset_ns = wall_offset_ns
        self._seam = Seam(stream.format.full_turn, stream.format.first_seam)
        self._whole = False
        self._runs: list[bytes] = []
        self._arrivals: list[tuple[int, int]] = []
        self._packets = 0
        self._samples_seen = 0
        self._carry: _Arrays | None = None
        self._carry_arrival = 0
        self._last_start_ns: int | None = None
        self._last_turn_ns = 0.0

    def add(self, event: Packets) -> list[Scan]:
        """Take a run of packets; return the revolutions it completed, usually none."""
        stream_format = self._stream.format
        splits = self._seam.splits(stream_format.headings(event.data))
        if not splits:
            self._keep(event.data, event.count, event.received_ns)
            return []
        scans: list[Scan] = []
        offsets = [*stream_format.offsets(event.data), len(event.data)]
        begin = 0
        for split in splits:
            if split.packet > begin:
                behind = stream_format.samples_in(event.data[offsets[split.packet] :])
                # What stands behind it was measured after it and is here already: it was late by that much.
                arrived = event.received_ns - round(behind * self._stream.sample_ns)
                self._keep(event.data[offsets[begin] : offsets[split.packet]], split.packet - begin, arrived)
            following = event.data[offsets[split.packet] : offsets[split.packet + 1]]
            scan = self._close(following, marked=split.marked, broken=split.broken)
            if scan is not None:
                scans.append(scan)
            begin = split.packet
        self._keep(event.data[offsets[begin] :], event.count - begin, event.received_ns)
        return scans

    def _keep(self, data: bytes, count: int, received_ns: int) -> None:
        self._runs.append(data)
        self._packets += count
        self._arrivals.append((self._packets, received_ns))
        if self._too_long(received_ns):
            self._forget()

    def _too_long(self, received_ns: int) -> bool:
        """Whether the open turn has lasted longer than the slowest turn: it will never end as it should."""
        return received_ns - self._arrivals[0][1] > 2e9 * self._stream.slowest_turn_s

    def _forget(self) -> None:
        self.stats.broken_scans += self._whole
        self._whole = False
        self._reset()
        self._carry = None

    def _reset(self) -> None:
        self._runs = []
        self._arrivals = []
        self._packets = 0

    def _close(self, following: bytes, *, marked: bool, broken: bool) -> Scan | None:
        """End the open turn before the packet `following`."""
        if not self._runs and self._carry is None:
            self._whole = not broken
            return None
        samples = None
        if self._runs:
            samples = self._stream.decoder.decode(b"".join(self._runs), None if broken else following)
            self.stats.lost_packets += samples.lost
        turn, head, rest = self._cut(samples, marked=marked)
        arrivals, last_arrival = (
            self._arrivals,
            self._arrivals[-1][1] if self._arrivals else self._carry_arrival,
        )
        carry_arrival = self._carry_arrival
        whole, self._whole = self._whole, not broken
        self._reset()
        self._carry = None if broken or rest is None or not len(rest.angle) else rest
        self._carry_arrival = last_arrival
        if not len(turn.angle):
            return None
        start_ns = self._start_ns(samples, head, arrivals, carry_arrival)
        if broken or not whole:
            self.stats.broken_scans += broken and whole
            self._last_start_ns = None
            return None
        return self._scan(turn, samples, start_ns, last_arrival)

    def _cut(self, samples: Samples | None, *, marked: bool) -> tuple[_Arrays, int, _Arrays | None]:
        """The samples of the turn, how many of them the turn before carried over, and what goes to the next."""
        carry = self._carry
        head = 0 if carry is None else len(carry.angle)
        if samples is None:
            assert carry is not None
            return carry, head, None
        arrays = _Arrays(samples.angle_deg, samples.distance_mm, samples.intensity)
        rest: _Arrays | None = None
        if not marked and self._seam.angle is not None:
            first = int(samples.ends[-2]) if len(samples.ends) > 1 else 0
            beam = samples.beam_deg[first:]
            seam = self._seam.angle * 360.0 / self._stream.format.full_turn
            away = (beam[0] - seam) % 360.0 + (beam - beam[0])
            here = int(np.count_nonzero(away < 360.0))
            rest = arrays.cut(first + here)
            arrays = arrays.cut(0, first + here)
        return (arrays if carry is None else carry.before(arrays)), head, rest

    def _start_ns(
        self, samples: Samples | None, head: int, arrivals: list[tuple[int, int]], carry_arrival: int
    ) -> int:
        """When the first sample of the turn was measured, by the least delayed packet before the first gap."""
        sample_ns = self._stream.sample_ns
        candidates: list[float] = []
        if head:
            candidates.append(carry_arrival - (head - 1) * sample_ns)
        if samples is not None:
            for packets, received_ns in arrivals:
                if packets > samples.unbroken and candidates:
                    break
                candidates.append(received_ns - (head + int(samples.ends[packets - 1]) - 1) * sample_ns)
        wire_ns = self._stream.format.longest * self._byte_ns
        return round(min(candidates) - _DEVICE_DELAY_SAMPLES * sample_ns - wire_ns)

    def _scan(self, turn: _Arrays, samples: Samples | None, start_ns: int, last_arrival: int) -> Scan | None:
        count, lost = len(turn.angle), samples.lost if samples else 0
        last_start, self._last_start_ns = self._last_start_ns, start_ns
        sample_ns = self._stream.sample_ns
        spanned = count * sample_ns
        if samples is not None and lost:
            spanned += lost * sample_ns * len(samples.distance_mm) / len(samples.ends)
        if not sample_ns:
            spanned = float(last_arrival - start_ns)
            sample_ns = spanned / count
        ordinary = self._last_turn_ns or spanned
        if last_arrival - start_ns > spanned + _BROKEN_TURNS * ordinary:
            self.stats.broken_scans += 1
            self._last_start_ns = None
            return None
        interval = float(start_ns - last_start) if last_start is not None else spanned
        self._last_turn_ns = spanned
        self.stats.scans += 1
        return _build(
            self._stream,
            turn,
            start_ns,
            self._wall_offset_ns,
            spanned,
            sample_ns,
            interval,
            self.stats.scans - 1,
            lost,
        )


def _build(
    stream: Stream,
    turn: _Arrays,
    start_ns: int,
    wall_offset_ns: int,
    spanned_ns: float,
    sample_ns: float,
    interval_ns: float,
    seq: int,
    lost: int,
) -> Scan:
    degrees = turn.angle
    if stream.zero_offset_deg:
        degrees = (degrees + stream.zero_offset_deg) % 360.0
    device_angles = degrees.astype(np.float32)
    # Just below a turn, single precision rounds up to the turn itself.
    device_angles[device_angles >= np.float32(360.0)] = 0.0
    angles = -np.radians(degrees)
    angles[degrees > 180.0] += 2 * math.pi
    ranges = turn.distance * np.float32(1e-3)
    ranges[turn.distance <= 0] = np.nan
    return Scan(
        angles=_frozen(angles.astype(np.float32)),
        ranges=_frozen(ranges),
        intensities=None if turn.intensity is None else _frozen(turn.intensity),
        device_angles=_frozen(device_angles),
        device_distances=_frozen(turn.distance),
        stamp_ns=start_ns,
        wall_stamp_ns=start_ns + wall_offset_ns,
        time_increment_ns=round(sample_ns),
        duration_ns=round(spanned_ns),
        rpm=60e9 / interval_ns if interval_ns > 0 else math.nan,
        seq=seq,
        dropped_before=0,
        lost_packets=lost,
        mode=stream.mode.name,
    )


def _frozen(array: NDArray[_A]) -> NDArray[_A]:
    array.setflags(write=False)
    return array
