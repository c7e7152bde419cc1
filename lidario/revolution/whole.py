"""Makes scans of packets that are whole scans: each is delivered when it came, without waiting for the next.

There is no seam to find, and nothing is missing inside a scan. Only whole scans may be missing, since one damaged
byte costs the whole packet. The device's clock in the packets, or else the time between them, shows how many.
Angles outside the field of the device were never measured, so they are neither missing nor lost.
"""

import math
from collections.abc import Iterator
from itertools import pairwise
from typing import Final

import numpy as np

from lidario.families.base import Stream
from lidario.revolution.build import DatedRevolution, turned_by
from lidario.revolution.incoming import Clock
from lidario.revolution.partial import SampleArrays, part_of
from lidario.revolution.sectors import SectorAssembler
from lidario.revolution.stats import AssemblerStats
from lidario.revolution.timing import earliest_ns
from lidario.scans.scan import Scan
from lidario.scans.sector import Sector
from lidario.wire.blocks import packet_offsets
from lidario.wire.events import Packets
from lidario.wire.formats import Headings

_LEAP_NS: Final = 60_000_000_000
_MOST_UNSEEN: Final = 1_000_000
"""Most scans that may be counted as missing at once: times come from the device, a peer or a file."""


class WholeAssembler(SectorAssembler):
    """Builds the scans of one stream whose packets are whole scans; the sectors of each come just before it."""

    _last_ns: int | None = None

    def _ends_in(self, packets: Packets, headings: Headings) -> Iterator[list[Scan]]:  # noqa: ARG002 - all are alike
        offsets, ended, done = packet_offsets(packets.blocks), self.ended, 0
        try:
            for number, came_ns in enumerate(self._came(packets)):
                part = part_of(packets, number, number + 1, offsets, self._stream.format, self._stream.sample_ns)
                done += 1
                scan = self._scan_of(part, came_ns)
                self.stats.scan_packets += 1
                for count in self._parts:
                    for sector in sectors_of(scan, count):
                        self._publish_sector(count, sector)
                yield [scan]
                if self.ended != ended:
                    return
        finally:
            self.stats.discarded_packets += packets.count - done

    def _came(self, event: Packets) -> list[float]:
        """When each packet would have come without a delay: by the device's clock, if it has one."""
        wire, count, turn_ns = self._stream.format, event.count, self._turn_ns
        if wire.ticks is not None and self._stream.timed:
            tick_ns, wrap = wire.ticks
            stamps = wire.stamps(event)
            apart = np.diff(stamps, prepend=stamps[:1]) % wrap * float(tick_ns)
            # A clock that leaps was set back: the device was restarted.
            apart[apart > _LEAP_NS] = turn_ns
            since = np.cumsum(apart).tolist()
        else:
            since = [number * turn_ns for number in range(count)]
        found: list[float] = []
        # Each by its own read, so that it does not matter how many reads are looked at together.
        for end, at_ns in event.arrivals:
            found += [at_ns - (since[end - 1] - each) for each in since[len(found) : end]]
        return found

    @property
    def _turn_ns(self) -> float:
        return self._stream.format.pitch * self._stream.sample_ns

    def _scan_of(self, packet: Packets, came_ns: float) -> Scan:
        stream = self._stream
        samples = self._decoder.decode(packet, None)
        count, sample_ns, turn_ns = len(samples.distance_mm), stream.sample_ns, self._turn_ns
        wire_ns = len(packet.data) * self._byte_ns
        start_ns = earliest_ns(came_ns - (count - 1) * sample_ns, sample_ns, wire_ns)
        interval_ns = turn_ns or math.nan
        if self._last_ns is not None and turn_ns:
            start_ns = max(start_ns, self._last_ns)
            unseen = min(max(round((start_ns - self._last_ns) / turn_ns) - 1, 0), _MOST_UNSEEN)
            interval_ns = (start_ns - self._last_ns) / (unseen + 1)
            self.stats.missed_scans += unseen
            self.stats.lost_packets += unseen
        self._last_ns = start_ns
        arrays = SampleArrays(
            turned_by(samples.angle_deg, stream.zero_offset_deg), samples.distance_mm, samples.intensity
        )
        made = DatedRevolution(arrays, start_ns, count * sample_ns, interval_ns, samples.last.reported_rpm)
        scan = self._deliver(made, sample_ns, 0)
        if self._next_offset_deg is not None:
            self.set_zero_offset(self._next_offset_deg)
        return scan


def sectors_of(scan: Scan, parts: int) -> Iterator[Sector]:
    """Divide a scan that came whole into `parts` sectors; the first one has its lost packets.

    A sector of which nothing came is left out, as the indices of the others show. A sector outside the field of the
    device was never measured: it is handed out without samples.
    """
    count, field = len(scan), abs(scan.field_of_view)
    away = math.copysign(1.0, scan.field_of_view) * (scan.device_angles.astype(np.float64) - scan.seam) % 360.0
    numbers = np.minimum((away * (parts / 360.0)).astype(np.intp), parts - 1)
    # Corrected angles may lie before the seam, or fall back over the end of a sector.
    numbers[: count // 4][numbers[: count // 4] > parts // 2] = 0
    numbers = np.maximum.accumulate(numbers)
    bounds = np.searchsorted(numbers, np.arange(parts + 1)).tolist()
    times_ns = [*scan.times_ns.tolist(), scan.stamp_ns + scan.duration_ns]
    lost = scan.lost_packets
    for index, (begin, end) in enumerate(pairwise(bounds)):
        stamp_ns = times_ns[begin]
        if begin == end:
            if begin < count or field >= 360.0:
                continue
            # The time at which the rotor comes there.
            stamp_ns = scan.stamp_ns + round(scan.duration_ns * 360.0 / field * index / parts)
        yield Sector(
            device_angles=scan.device_angles[begin:end],
            device_distances=scan.device_distances[begin:end],
            intensities=None if scan.intensities is None else scan.intensities[begin:end],
            stamp_ns=stamp_ns,
            wall_stamp_ns=scan.wall_stamp_ns + stamp_ns - scan.stamp_ns,
            time_increment_ns=scan.time_increment_ns,
            duration_ns=times_ns[end] - times_ns[begin],
            rpm=scan.rpm,
            seq=scan.seq,
            index=index,
            degrees=360.0 / parts,
            dropped_before=0,
            lost_packets=lost,
            mode=scan.mode,
            max_range=scan.max_range,
            field_of_view=scan.field_of_view,
        )
        lost = 0


def assembler_of(
    stream: Stream, baudrate: int, wall_offset_ns: int, stats: AssemblerStats | None, clock: Clock | None
) -> SectorAssembler:
    """Make the assembler for a stream; the arguments are those of `Assembler`."""
    made = WholeAssembler if stream.format.whole else SectorAssembler
    return made(stream, baudrate, wall_offset_ns, stats, clock)
