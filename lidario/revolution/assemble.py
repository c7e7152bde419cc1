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
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from lidario.families.base import Samples, Stream
from lidario.model import Scan, read_only
from lidario.revolution.seam import Seam, Split
from lidario.wire.events import Packets

__all__ = ["Assembler", "AssemblerStats"]

_BITS_A_BYTE = 10
_DEVICE_DELAY_SAMPLES = 1.5
_BROKEN_TURNS = 0.9
"""Share of a turn that may be missing in time, not seen as a jump of the angle, before a turn is broken."""

_ENDLESS_TURNS = 2
"""Turns of the slowest kind after which a turn that has not ended is given up."""


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
    """Samples in measuring order; shape (n,) each."""

    angle: NDArray[np.float32]
    distance: NDArray[np.float32]
    intensity: NDArray[np.uint8] | None

    def __len__(self) -> int:
        return len(self.angle)

    def cut(self, begin: int, end: int | None = None) -> _Arrays:
        """Some of them; nothing is copied."""
        intensity = None if self.intensity is None else self.intensity[begin:end]
        return _Arrays(self.angle[begin:end], self.distance[begin:end], intensity)

    def begin_with(self, earlier: _Arrays) -> None:
        """Fill the front, which was left free, with `earlier`."""
        room = len(earlier)
        self.angle[:room] = earlier.angle
        self.distance[:room] = earlier.distance
        if self.intensity is not None and earlier.intensity is not None:
            self.intensity[:room] = earlier.intensity


@dataclass(slots=True, eq=False)
class _Turn:
    """A turn in the making: what the packet at the seam brought, and the packets since.

    Attributes:
        whole: Whether it began at the seam, so that it can become a scan.
        carried: Samples of this turn from the packet that crossed the seam.
        carried_ns: Arrival of that packet.
        lost: Packets missing right behind that packet.
        runs: The packets since.
        packets: Their number.
        arrivals: What came when: numbers of packets, counted from the first, and their arrival.
    """

    whole: bool
    carried: _Arrays | None = None
    carried_ns: int = 0
    lost: int = 0
    runs: list[bytes] = field(default_factory=list)
    packets: int = 0
    arrivals: list[tuple[int, int]] = field(default_factory=list)

    @property
    def last_ns(self) -> int:
        """Arrival of its latest packet."""
        return self.arrivals[-1][1] if self.arrivals else self.carried_ns


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
        self._turn = _Turn(whole=False)
        self._last_start_ns: int | None = None
        self._last_turn_ns = 0.0

    def add(self, event: Packets) -> list[Scan]:
        """Take a run of packets; return the revolutions it completed, usually none."""
        stream_format = self._stream.format
        splits = self._seam.splits(stream_format.headings(event.data))
        if not splits:
            self._keep(event, 0, event.count, event.data, event.received_ns)
            return []
        scans: list[Scan] = []
        offsets = stream_format.offsets(event.data)
        begin = 0
        for split in splits:
            if split.packet > begin:
                data = event.data[offsets[begin] : offsets[split.packet]]
                self._keep(event, begin, split.packet, data, self._arrival(event, split.packet, offsets))
            scan = self._close(split, event.data[offsets[split.packet] : offsets[split.packet + 1]])
            if scan is not None:
                scans.append(scan)
            begin = split.packet
        self._keep(event, begin, event.count, event.data[offsets[begin] :], event.received_ns)
        return scans

    def _arrival(self, event: Packets, packets: int, offsets: Sequence[int]) -> int:
        """When the first `packets` of a run had come."""
        count, received_ns = next(
            (each for each in event.earlier if each[0] >= packets), (event.count, event.received_ns)
        )
        # What stands behind them was measured after them and was there already: they were late by that much.
        behind = event.data[offsets[packets] : offsets[count]]
        return received_ns - round(self._stream.format.samples_in(behind) * self._stream.sample_ns)

    def _keep(self, event: Packets, begin: int, end: int, data: bytes, received_ns: int) -> None:
        """Add the packets of a run from `begin` to `end`, which are `data`, to the turn in the making."""
        turn = self._turn
        turn.runs.append(data)
        if event.earlier:
            before = turn.packets - begin
            turn.arrivals += [(before + count, at_ns) for count, at_ns in event.earlier if begin < count < end]
        turn.packets += end - begin
        turn.arrivals.append((turn.packets, received_ns))
        if received_ns - turn.arrivals[0][1] > _ENDLESS_TURNS * 1e9 * self._stream.slowest_turn_s:
            # It will never end as it should; without a bound it would be kept for ever.
            self.stats.broken_scans += turn.whole
            self._turn = _Turn(whole=False)

    def _close(self, split: Split, following: bytes) -> Scan | None:
        """End the turn in the making before the packet `following`, and begin the next."""
        turn, self._turn = self._turn, _Turn(whole=not split.broken)
        arrays, samples, lost = turn.carried, None, turn.lost
        if turn.runs:
            room = 0 if arrays is None else len(arrays)
            ends_inside = not (split.marked or split.broken)
            samples = self._stream.decoder.decode(
                b"".join(turn.runs),
                None if split.broken else following,
                room,
                self._seam.angle if ends_inside else None,
            )
            self.stats.lost_packets += samples.lost
            lost += samples.lost
            here = _Arrays(samples.angle_deg, samples.distance_mm, samples.intensity)
            if arrays is not None:
                here.begin_with(arrays)
            crossed = room + samples.before_seam
            if crossed < len(here):
                self._turn.carried = here.cut(crossed)
                self._turn.carried_ns = turn.last_ns
                self._turn.lost = samples.lost_behind
                lost -= samples.lost_behind
            arrays = here.cut(0, crossed)
        if arrays is None or not len(arrays):
            return None
        if split.broken or not turn.whole:
            self.stats.broken_scans += split.broken and turn.whole
            self._last_start_ns = None
            return None
        return self._scan(arrays, turn, samples, lost)

    def _start_ns(self, turn: _Turn, samples: Samples | None) -> int:
        """When the first sample of the turn was measured, by the least delayed packet before the first gap."""
        sample_ns = self._stream.sample_ns
        carried = 0 if turn.carried is None else len(turn.carried)
        candidates: list[float] = []
        if carried:
            candidates.append(turn.carried_ns - (carried - 1) * sample_ns)
        if samples is not None and not (turn.lost and candidates):
            for packets, received_ns in turn.arrivals:
                if packets > samples.unbroken and candidates:
                    break
                candidates.append(received_ns - (carried + samples.ends[packets - 1] - 1) * sample_ns)
        packet_bytes = sum(map(len, turn.runs)) / turn.packets if turn.packets else self._stream.format.shortest
        return round(min(candidates) - _DEVICE_DELAY_SAMPLES * sample_ns - packet_bytes * self._byte_ns)

    def _scan(self, arrays: _Arrays, turn: _Turn, samples: Samples | None, lost: int) -> Scan | None:
        start_ns = self._start_ns(turn, samples)
        last_start_ns, self._last_start_ns = self._last_start_ns, start_ns
        sample_ns = self._stream.sample_ns or (turn.last_ns - start_ns) / len(arrays)
        spanned_ns = len(arrays) * sample_ns
        if samples is not None:
            spanned_ns += lost * sample_ns * samples.ends[-1] / len(samples.ends)
        ordinary_ns = self._last_turn_ns or spanned_ns
        if turn.last_ns - start_ns > spanned_ns + _BROKEN_TURNS * ordinary_ns:
            self.stats.broken_scans += 1
            self._last_start_ns = None
            return None
        self._last_turn_ns = spanned_ns
        interval_ns = spanned_ns if last_start_ns is None else float(start_ns - last_start_ns)
        seq = self.stats.scans
        self.stats.scans += 1
        return _build(
            self._stream,
            arrays,
            start_ns=start_ns,
            wall_ns=start_ns + self._wall_offset_ns,
            spanned_ns=spanned_ns,
            sample_ns=sample_ns,
            interval_ns=interval_ns,
            seq=seq,
            lost=lost,
        )


def _build(
    stream: Stream,
    arrays: _Arrays,
    *,
    start_ns: int,
    wall_ns: int,
    spanned_ns: float,
    sample_ns: float,
    interval_ns: float,
    seq: int,
    lost: int,
) -> Scan:
    degrees = arrays.angle
    if stream.zero_offset_deg:
        degrees = ((degrees.astype(np.float64) + stream.zero_offset_deg) % 360.0).astype(np.float32)
        # Just below a turn, single precision rounds up to the turn itself.
        degrees[degrees >= 360.0] = 0.0
    return Scan(
        device_angles=read_only(degrees),
        device_distances=read_only(arrays.distance),
        intensities=None if arrays.intensity is None else read_only(arrays.intensity),
        stamp_ns=start_ns,
        wall_stamp_ns=wall_ns,
        time_increment_ns=round(sample_ns),
        duration_ns=round(spanned_ns),
        rpm=60e9 / interval_ns if interval_ns > 0 else math.nan,
        seq=seq,
        dropped_before=0,
        lost_packets=lost,
        mode=stream.mode.name,
        max_range=stream.mode.max_distance,
        seam=stream.zero_offset_deg % 360.0,
    )
