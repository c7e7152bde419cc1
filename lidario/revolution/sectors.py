"""Sectors: parts of the revolution in the making, handed out as soon as the rotor has passed the end of each.

`SectorAssembler` is an `Assembler` that decodes the revolution in the making whenever the headings pass the end of
a sector: all its packets up to there, by a copy of the decoder. What was not handed out before is the sector. If a
packet lies across the end, its samples are divided as at the seam: by where the rotor stood. A packet that can only
be decoded together with the one behind it waits for that one.

When the revolution has ended, it is decoded, judged and counted as without sectors. Its last packets may show that
a gap was larger or smaller than it seemed. The scan keeps the angles that its sectors had.

The number of a revolution is known only at its end, when time shows how many revolutions passed unseen before it. A
sector needs the number earlier. So it is found in the same way from what is known when the first sector is
complete, and the scan keeps that number.
"""

import math
from collections.abc import Callable, Iterable, Sequence

from lidario.families.base import Samples
from lidario.revolution.assemble import Assembler
from lidario.revolution.build import turned_by
from lidario.revolution.clock import NOISE, Beginning
from lidario.revolution.divided import RETREAT_PART, ROUNDING, DividedRevolution, OpenSector, is_doubted
from lidario.revolution.ended import EndedRevolution, share_before
from lidario.revolution.late_reads import Ends
from lidario.revolution.partial import PartialRevolution, part_of
from lidario.revolution.seam import Split
from lidario.revolution.timing import earliest_ns
from lidario.revolution.together import joined
from lidario.scans.measured import made_of
from lidario.scans.samples import read_only
from lidario.scans.scan import Scan
from lidario.scans.sector import Sector
from lidario.wire.blocks import packet_offsets
from lidario.wire.copies import copy_of
from lidario.wire.events import Packets
from lidario.wire.formats import BEGINS, HEADING_MASK, Headings


class SectorAssembler(Assembler):
    """An `Assembler` that also hands out the sectors of each revolution, once `divide` was called."""

    _publish_sector: Callable[[int, Sector], None]
    _latest: DividedRevolution | None = None
    _doubted: bool = False  # `is_doubted`, for the revolution before the one in the making

    def divide(self, parts: Iterable[int], publish: Callable[[int, Sector], None]) -> None:
        """Hand out sectors from the next revolution on.

        Args:
            parts: How many sectors each revolution is divided into; several sizes at the same time, or none.
            publish: Called for each sector, with how many sectors of its size a revolution has, and the sector.
        """
        self._parts, self._publish_sector = tuple(sorted(parts)), publish

    @property
    def next_ns(self) -> float:
        """When the packet that completes the next sector arrives, if it is not late; NaN if unknown."""
        here = self.partial.divided
        if here is None or not here.usual_samples:
            return math.nan
        wire, sample_ns, each, (end, _) = here.wire, here.sample_ns, here.most_samples, here.ends[here.at]
        varies = wire.shortest != wire.longest
        # Samples from the beginning of the last packet to the end of the sector.
        away = (end - here.passed) * here.usual_samples / wire.full_turn
        if varies and end == wire.full_turn:
            # The last packet of a revolution, and the first one of the next, may be as short as one sample.
            more = max(1.0, away - each + 1)
        else:
            # Packets may hold a sample more or fewer, so a whole number of them may be off by two samples.
            more = float(max(1, math.ceil(away / each - (2 / each if varies else ROUNDING))) * each)
        if here.gap:
            return here.partial.last_ns + more * sample_ns
        return here.first_ns + (here.samples + more - 1) * sample_ns

    @property
    def keeps_offset(self) -> bool:
        """Whether the revolution in the making keeps its zero-angle offset, because it is divided into sectors."""
        return self.partial.divided is not None

    def set_zero_offset(self, degrees: float, *, behind: bool = False) -> None:
        """As `Assembler.set_zero_offset`, but a revolution that is divided into sectors keeps the offset before."""
        super().set_zero_offset(degrees, behind=behind or self.keeps_offset)

    # ------------------------------------------------------------------------------------------------ packets come

    def _keep(self, packets: Packets, headings: Headings) -> None:
        super()._keep(packets, headings)
        here = self.partial.divided
        if here is None:
            if not self._parts or (here := self._begin(int(headings[0]))) is None:
                return
            self.partial.divided = self._latest = here
        here.sample_ns = here.by_speed_ns or self.incoming.time.known_ns
        full_turn, before = here.wire.full_turn, here.packets
        # A heading that trembles back over the seam seems to be almost a revolution ahead.
        most = full_turn - full_turn // RETREAT_PART
        for number, angle in enumerate(here.come(packets, headings), before):
            if 0 < angle - here.passed <= most:
                here.passed = angle
                if angle >= here.ends[here.at][0]:
                    self._decode_until(here, number, angle)
                    while angle >= here.ends[here.at][0]:
                        self._hand_out(here)
            here.latest = angle

    def _begin(self, first: int) -> DividedRevolution | None:
        """Begin to divide a revolution at the heading of its first packet; None if it cannot be divided."""
        partial, wire, before = self.partial, self._stream.format, self._latest
        # If angles are not certain (`carried_packets`), samples that were carried over may still be dropped.
        sure = partial.whole and not partial.moved and not partial.carried_packets and len(partial.runs) == 1
        by_speed_ns = before.by_speed_ns if before else 0.0
        sample_ns = by_speed_ns or self.incoming.time.known_ns
        if not sure or partial.seam is None or not sample_ns:
            return None
        return DividedRevolution(
            partial,
            first & HEADING_MASK if first & BEGINS else partial.seam,
            wire,
            self._parts,
            usual_ns=self._clock.usual_ns,
            offset_deg=self._stream.zero_offset_deg,
            sample_ns=sample_ns,
            by_speed_ns=by_speed_ns,
            doubted=self._doubted,
            usual_samples=before.usual_samples if before else 0.0,
        )

    def _decode_until(self, here: DividedRevolution, number: int, at: int) -> None:
        """Decode the packets of the revolution before packet `number`, which begins `at` behind the seam."""
        if not number:
            here.begin_with(at)
            return
        partial, wire = self.partial, here.wire
        run = joined(partial.runs)
        partial.runs = [run]
        offsets = packet_offsets(run.blocks)
        packets = part_of(run, 0, number, offsets, wire, self.incoming.time.known_ns)
        room = 0 if partial.carried is None else len(partial.carried)
        samples = self._decoder.fork().decode(packets, run.data[offsets[number] : offsets[number + 1]], room)
        here.take(packets, samples, room, at)

    # ------------------------------------------------------------------------------------------------ sectors

    def _hand_out(self, here: DividedRevolution) -> None:
        """The rotor has passed an end of sectors: publish those that have samples and certain angles."""
        (end, parts), decoded, sample_ns = here.ends[here.at], here.decoded, here.sample_ns
        here.give(end)
        for count in parts:
            done = here.open[count]
            if decoded is None or done.begin == here.given or not here.certain:
                # This sector is left out, as the next index shows. The next one counts the packets missing here.
                done.index += 1
                continue
            arrays = decoded.arrays.part(done.begin, here.given)
            # When the first sample of the revolution was measured, by the packets so far.
            packet_bytes = here.partial.size / here.packets
            start_ns = earliest_ns(here.first_ns, sample_ns, packet_bytes * self._byte_ns)
            if here.seq is None:
                here.seq = self._number(here, decoded.samples, start_ns)
            stamp_ns, gaps = here.placed(done, start_ns)
            duration_ns = round((len(arrays) + sum([skipped for _, skipped in gaps])) * sample_ns)
            sector = made_of(
                Sector,
                device_angles=read_only(turned_by(arrays.angle, here.offset_deg)),
                device_distances=read_only(arrays.distance),
                intensities=None if arrays.intensity is None else read_only(arrays.intensity),
                stamp_ns=stamp_ns,
                wall_stamp_ns=stamp_ns + self.wall_offset_ns,
                time_increment_ns=round(sample_ns),
                duration_ns=duration_ns,
                rpm=60e9 / (here.usual_samples * sample_ns) if here.usual_samples else math.nan,
                seq=here.seq,
                index=done.index,
                degrees=360.0 / count,
                dropped_before=0,
                lost_packets=max(0, here.lost - done.lost),
                mode=self._stream.mode.name,
                max_range=self._stream.mode.max_distance,
                field_of_view=here.wire.field_deg,
                _gaps=gaps,
            )
            here.open[count] = OpenSector(done.index + 1, here.given, here.lost, sector)
            self._publish_sector(count, sector)

    def _number(self, here: DividedRevolution, samples: Samples | None, start_ns: int) -> int:
        """The number of the revolution; counts the revolutions that passed unseen before it."""
        stats, partial = self.stats, here.partial
        stats.resume(start_ns)
        if self._clock.last is not None and samples is not None:
            over = share_before(here.wire, partial, samples)
            # 0 where angles are not certain: no step is known then.
            turn_ns = samples.last.samples * here.sample_ns
            from_end_ns = round(partial.last_ns - (here.passed / here.wire.full_turn - over) * turn_ns)
            # If a read was completed only behind a gap, the packets before the gap are dated too late.
            late = samples.certain and start_ns - from_end_ns > NOISE * turn_ns
            # Only a copy of the clock follows: at the end of the revolution more is known, and that is remembered.
            passed = copy_of(self._clock).follow(
                Beginning(
                    from_end_ns if late else start_ns,
                    over=over,
                    revolution_ns=turn_ns,
                    packet_ns=samples.ends[-1] / len(samples.ends) * here.sample_ns,
                    packets=here.packets,
                    lost=0,
                    broken=False,
                    number=stats.scans + stats.missed_scans,
                    packets_before=stats.all_packets - here.packets,
                )
            )
            here.unseen = max(0, passed.unseen)
            stats.missed_scans += here.unseen
        return stats.scans + stats.missed_scans

    # ------------------------------------------------------------------------------------------------ the end

    def add_block(
        self, event: Packets, offsets: Sequence[int], splits: Sequence[Split], first: int, late: Ends
    ) -> list[Scan]:
        here = self.partial.divided
        made = super().add_block(event, offsets, splits, first, late)
        if made:
            self._doubted = False
            if here is not None:
                here.seq, self._told_seq = made[0].seq, None
                self._finish(here, made[0])
        return made

    def _end(self, split: Split, following: bytes) -> Scan | None:
        here, broken = self.partial.divided, self.stats.broken_scans
        self._doubted = False
        scan = super()._end(split, following)
        self._told_seq, self._told_unseen = None, 0
        if here is not None and not (split.broken or split.moved):
            if here.seq is None and scan is not None:
                here.seq = scan.seq
            elif here.seq is None and self.stats.broken_scans > broken:
                # A broken revolution has used up a number.
                here.seq = self.stats.scans + self.stats.missed_scans - 1
            if here.seq is not None:
                self._finish(here, scan)
        return scan

    def _scan(self, ended: EndedRevolution) -> Scan | None:
        broken, samples = self.stats.broken_scans, ended.samples
        scan = super()._scan(ended)
        if self.stats.broken_scans > broken and samples.gaps and not self._stream.format.own_angles:
            self._doubted = is_doubted(samples)
        return scan

    def _decode(
        self, ended: PartialRevolution, packets: Packets, split: Split, following: bytes, room: int
    ) -> Samples:
        samples, here = super()._decode(ended, packets, split, following, room), ended.divided
        if here is not None:
            self._told_seq, self._told_unseen = here.seq, here.unseen
            here.end(packets, samples, room, following)
        return samples

    def _finish(self, here: DividedRevolution, scan: Scan | None) -> None:
        """The revolution has ended: hand out its last sectors. The last one counts all lost packets found late."""
        decoded = here.decoded
        if decoded is not None and scan is not None:
            decoded.lost_behind = scan.lost_packets - decoded.lost
        while here.at < len(here.ends):
            self._hand_out(here)
