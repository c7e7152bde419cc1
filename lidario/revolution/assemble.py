"""From packets to whole revolutions.

The assembler keeps the packets of the revolution in the making as bytes, and reads only their headings. At the seam
it joins them, has them decoded in one go, divides the samples exactly where the rotor passed the seam (the rest of
the packet that crosses it begins the next revolution), and builds one `Scan`.

What it will not deliver: the first, partial revolution; a revolution around a restart of the stream; a revolution
of which so much is missing that parts of two may have met. The last two are counted as broken.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from lidario.families.base import Samples, Stream
from lidario.model import Scan, read_only
from lidario.revolution.count import NOISE, Beginning, RevolutionCount
from lidario.revolution.partial import PartialRevolution, SampleArrays
from lidario.revolution.seam import Seam, Split
from lidario.revolution.timing import first_sample_ns
from lidario.wire.blocks import packet_offsets, some_blocks
from lidario.wire.events import Arrival, Packets
from lidario.wire.formats import HEADING_MASK

__all__ = ["Assembler", "AssemblerStats"]

_BROKEN_SHARE = 0.9
"""Share of a revolution that may be missing in time, not seen as a jump of the angle, before it is broken."""

_ENDLESS_REVOLUTIONS = 2
"""Slowest revolutions' time after which a revolution that has not ended is given up."""

_FIRST_PACKETS = 0.9
_FIRST_SHARE = 0.01
"""Packets' arcs behind the seam, or share of 360 degrees, within which a revolution begins; farther on, its
beginning was lost."""
_WHOLE = 0.99
"""Share of a revolution that samples without a gap must be, for their time to tell the speed."""
_BEFORE_SEAM = 1 / 12
"""Part of 360 degrees by which a heading may tremble back behind the seam."""

_FEWEST_PACKETS = 3
_UNEVEN = 1.5
"""A revolution of which the angles are not certain is delivered when it has so many packets, and took at most so
many times the time of what it holds and misses."""


@dataclass(slots=True)
class AssemblerStats:
    """Running totals. All but `unfinished_packets` only grow.

    Every packet that was added is counted in exactly one of the fields that end in ``_packets``, but for
    `lost_packets`. A packet at the seam is counted with the revolution that it begins in.

    Attributes:
        scans: Revolutions delivered.
        broken_scans: Revolutions thrown away.
        lost_packets: Packets missing, also those of revolutions not delivered, and of those of which nothing came.
        missed_scans: Revolutions that are missing between the delivered ones: the broken ones, and those of which
            nothing came, and, by the speed before, those that passed while the device was away.
        scan_packets: Packets of revolutions delivered.
        discarded_packets: Packets of revolutions not delivered: broken ones, and the parts of one at the beginning
            and the end of each stream.
        unfinished_packets: Packets of the revolution in the making.
        left_off: Stamp and length in nanoseconds of the last revolution before the device went away, until the
            first one after it is back. Not a counter.
    """

    scans: int = 0
    broken_scans: int = 0
    lost_packets: int = 0
    missed_scans: int = 0
    scan_packets: int = 0
    discarded_packets: int = 0
    unfinished_packets: int = 0
    left_off: tuple[int, float] | None = None

    def leave_off(self, last: Scan) -> None:
        """The device is away; `last` was the last scan before that."""
        revolution_ns = 60e9 / last.rpm if last.rpm > 0 else float(last.duration_ns)
        self.left_off = last.stamp_ns, revolution_ns

    def resume(self, start_ns: int) -> None:
        """The first whole revolution since then begins at `start_ns`: count those between, at least one."""
        if self.left_off is not None:
            last_ns, revolution_ns = self.left_off
            self.left_off = None
            self.missed_scans += max(1, round((start_ns - last_ns) / max(revolution_ns, 1.0)) - 1)

    def break_scan(self) -> None:
        """Count a whole revolution that is thrown away."""
        self.broken_scans += 1
        self.missed_scans += 1

    def finish(self, packets: int, *, delivered: bool) -> None:
        """Count packets of a revolution that has ended."""
        self.unfinished_packets -= packets
        if delivered:
            self.scan_packets += packets
        else:
            self.discarded_packets += packets


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
        self.stats: AssemblerStats = stats or AssemblerStats()
        self._stream = stream
        self._baudrate = baudrate
        self._wall_offset_ns = wall_offset_ns
        self._seam = Seam(stream.format.full_turn, stream.format.first_seam)
        self._endless_ns = _ENDLESS_REVOLUTIONS * 1e9 * stream.slowest_turn_s
        self._partial = PartialRevolution(whole=False)
        self._count = RevolutionCount()
        self._last_spanned_ns = 0.0
        self._measured_sample_ns = 0.0

    def set_zero_offset(self, degrees: float) -> None:
        """Add another zero-angle offset, clockwise degrees, from the next scan on."""
        self._stream = replace(self._stream, zero_offset_deg=degrees)

    def add(self, event: Packets) -> list[Scan]:
        """Take the next packets of the stream; return the revolutions they completed, usually none."""
        splits = self._seam.splits(self._stream.format.headings(event))
        if not splits:
            self._keep(event)
            return []
        scans: list[Scan] = []
        offsets = packet_offsets(event.blocks)
        begin = 0
        for split in splits:
            if split.packet > begin:
                self._keep(self._part(event, begin, split.packet, offsets))
            held = self.stats.unfinished_packets
            scan = self._end(split, event.data[offsets[split.packet] : offsets[split.packet + 1]])
            self.stats.finish(held, delivered=scan is not None)
            if scan is not None:
                scans.append(scan)
            begin = split.packet
        self._keep(self._part(event, begin, event.count, offsets))
        return scans

    def end(self) -> None:
        """The stream has ended: discard the revolution in the making. Harmless when done before."""
        self.stats.finish(self.stats.unfinished_packets, delivered=False)
        self._partial = PartialRevolution(whole=False)

    def _part(self, packets: Packets, begin: int, end: int, offsets: Sequence[int]) -> Packets:
        """The packets from number `begin` to before number `end`."""
        arrivals: list[Arrival] = []
        complete, at_ns = packets.arrivals[-1]  # bound for type checkers too: there is always one
        for complete, at_ns in packets.arrivals:
            if complete >= end:
                break
            if complete > begin:
                arrivals.append((complete - begin, at_ns))
        if complete > end:
            # What stands behind them was measured after them and was there already: they were late by that much.
            behind = self._stream.format.samples_in(some_blocks(packets.blocks, end, complete))
            at_ns -= round(behind * self._stream.sample_ns)
        arrivals.append((end - begin, at_ns))
        blocks = some_blocks(packets.blocks, begin, end)
        return Packets(packets.data[offsets[begin] : offsets[end]], blocks, tuple(arrivals))

    def _keep(self, packets: Packets) -> None:
        """Add packets to the revolution in the making."""
        runs = self._partial.runs
        runs.append(packets)
        self.stats.unfinished_packets += packets.count
        if packets.arrivals[-1][1] - runs[0].arrivals[0][1] > self._endless_ns:
            # It will never end as it should; without a bound it would be kept for ever.
            if self._partial.whole:
                self.stats.break_scan()
            self._count.restart()
            self.stats.finish(self.stats.unfinished_packets, delivered=False)
            self._partial = PartialRevolution(whole=False)

    def _end(self, split: Split, following: bytes) -> Scan | None:
        """End the revolution in the making before the packet `following`, and begin the next."""
        ended, self._partial = self._partial, PartialRevolution(whole=not split.broken)
        self._partial.moved = split.moved
        arrays, samples, lost = ended.carried, None, ended.lost_behind_carried
        packets = ended.packets()
        if packets is not None:
            room = 0 if arrays is None else len(arrays)
            ends_inside = not (split.marked or split.broken)
            samples = self._stream.decoder.decode(
                packets,
                None if split.broken else following,
                room,
                self._seam.angle if ends_inside else None,
            )
            self.stats.lost_packets += samples.lost
            self._partial.behind_gap = samples.lost_behind > 0 or not samples.certain
            lost += samples.lost
            here = SampleArrays(samples.angle_deg, samples.distance_mm, samples.intensity)
            if arrays is not None:
                here.begin_with(arrays)
            unknown = ended.revoke_carried(samples.revolution_packets) if samples.certain else 0
            self.stats.lost_packets += unknown
            lost += unknown
            crossed = room + samples.before_seam
            if crossed < len(here):
                self._partial.carried = here.part(crossed)
                self._partial.carried_ns = ended.last_ns
                self._partial.lost_behind_carried = samples.lost_behind
                self._partial.carried_packets = 0.0 if samples.certain else samples.revolution_packets
                lost -= samples.lost_behind
            arrays = here.part(room if unknown else 0, crossed)
        if arrays is None or not len(arrays):
            return None
        if split.broken or split.moved:
            # Only the first mark may stand elsewhere by right. A false one moves the seam there and back.
            if ended.whole and not ended.moved and (split.broken or self._last_spanned_ns):
                self.stats.break_scan()
            self._count.restart()
            return None
        return self._scan(arrays, ended, packets, samples, lost)

    def _scan(
        self,
        arrays: SampleArrays,
        ended: PartialRevolution,
        packets: Packets | None,
        samples: Samples | None,
        lost: int,
    ) -> Scan | None:
        """Date a revolution and build its scan; None when it is not whole, or parts of two have met in it."""
        start_ns = first_sample_ns(
            ended,
            packets,
            samples,
            sample_ns=self._stream.sample_ns,
            packet_bytes=self._stream.format.shortest if packets is None else len(packets.data) / packets.count,
            baudrate=self._baudrate,
        )
        sample_ns = self._sample_ns(len(arrays), ended.last_ns - start_ns, lost)
        spanned_ns = len(arrays) * sample_ns
        if samples is not None:
            spanned_ns += lost * sample_ns * samples.ends[-1] / len(samples.ends)
        ordinary_ns = self._last_spanned_ns or spanned_ns
        broken = ended.last_ns - start_ns > spanned_ns + _BROKEN_SHARE * ordinary_ns
        broken |= not _known(packets, samples, ended.last_ns - start_ns, sample_ns)
        if samples is not None and samples.certain:
            # More than one revolution by its angles: they went back by so little that it looked like jitter.
            within = len(arrays) + (samples.lost - samples.lost_behind) * samples.ends[-1] / len(samples.ends)
            broken |= within > _UNEVEN * samples.revolution_samples
        revolution_ns = self._passed(ended, packets, samples, start_ns, sample_ns, spanned_ns, broken)
        if not ended.whole:
            return None
        if broken:
            self.stats.break_scan()
            return None
        self._last_spanned_ns = spanned_ns
        if math.isnan(revolution_ns) and not lost:
            # The revolution before was not seen: what this one holds tells its speed.
            complete = (
                samples is None
                or not samples.certain
                or spanned_ns > _WHOLE * samples.revolution_samples * sample_ns
            )
            revolution_ns = spanned_ns if complete else math.nan
        if self.stats.left_off is not None:
            self.stats.resume(start_ns)
        seq = self.stats.scans + self.stats.missed_scans
        self.stats.scans += 1
        return _build(
            self._stream,
            arrays,
            start_ns=start_ns,
            wall_ns=start_ns + self._wall_offset_ns,
            spanned_ns=spanned_ns,
            sample_ns=sample_ns,
            interval_ns=revolution_ns,
            seq=seq,
            lost=lost,
        )

    def _sample_ns(self, samples: int, elapsed_ns: int, lost: int) -> float:
        """Nanoseconds a sample: as the device says, or as the last revolution without a gap took."""
        if self._stream.sample_ns:
            return self._stream.sample_ns
        if not lost or not self._measured_sample_ns:
            self._measured_sample_ns = elapsed_ns / samples
        return self._measured_sample_ns

    def _passed(
        self,
        ended: PartialRevolution,
        packets: Packets | None,
        samples: Samples | None,
        start_ns: int,
        sample_ns: float,
        spanned_ns: float,
        broken: bool,
    ) -> float:
        """Count what is missing since the revolution before; return what one takes, NaN when it was not seen."""
        if packets is None or samples is None or not (ended.whole or self._stream.format.first_seam is not None):
            # Where only marks tell where revolutions begin, the first part may be longer than one.
            self._count.restart()
            return math.nan
        packet_ns = samples.ends[-1] / len(samples.ends) * sample_ns
        # A read that was completed only behind a gap dates what came before it too late. What follows is on time.
        behind_ns = samples.lost_behind * packet_ns if self._partial.carried is None else 0.0
        from_end_ns = round(ended.last_ns - spanned_ns + behind_ns)
        late = samples.certain and start_ns - from_end_ns > NOISE * samples.revolution_samples * sample_ns
        here = Beginning(
            from_end_ns if late else start_ns,
            over=0.0 if ended.carried is not None or not ended.behind_gap else self._over(packets, samples),
            revolution_ns=samples.revolution_samples * sample_ns if samples.certain else 0.0,
            revolution_packets=samples.revolution_packets,
            packet_ns=sample_ns * samples.revolution_samples / samples.revolution_packets
            if samples.certain
            else packet_ns,
            packets=packets.count,
            lost=samples.lost,
            broken=broken and ended.whole,
        )
        passed = self._count.follow(here)
        self.stats.lost_packets += passed.lost
        self.stats.missed_scans += passed.unseen
        return passed.revolution_ns

    def _over(self, packets: Packets, samples: Samples) -> float:
        """Share of the revolution before its first packet; 0 when that one is the first behind the seam."""
        wire, blocks = self._stream.format, some_blocks(packets.blocks, 0, 1)
        first = Packets(packets.data[: blocks[0].size], blocks, ((1, 0),))
        heading = int(wire.headings(first)[0]) & HEADING_MASK
        over = (heading - (self._seam.angle or 0)) % wire.full_turn / wire.full_turn
        behind = over * samples.revolution_packets
        return over if behind > _FIRST_PACKETS and _FIRST_SHARE < over < 1 - _BEFORE_SEAM else 0.0


def _known(packets: Packets | None, samples: Samples | None, elapsed_ns: int, sample_ns: float) -> bool:
    """Whether the angles of a revolution can be relied on: its step is certain, or nothing speaks against it."""
    if packets is None or samples is None or samples.certain:
        return True
    expected = (packets.count + samples.lost) * samples.ends[-1] / packets.count * sample_ns
    return packets.count >= _FEWEST_PACKETS and elapsed_ns <= _UNEVEN * expected


def _build(
    stream: Stream,
    arrays: SampleArrays,
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
        # Just below 360 degrees, single precision rounds up to 360.
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
