"""Sectors: parts of the revolution in the making, handed out as soon as the rotor has passed the end of each.

`SectorAssembler` is an `Assembler` that decodes the revolution piece by piece. Each time the headings pass the end
of a sector, the packets up to there are decoded, by a decoder that goes on where the revolution before ended. If a
packet lies across the end, its samples are divided as at the seam: by where the rotor stood. A packet that can only
be decoded together with the one behind it waits for that one.

When the revolution has ended, its scan is made of the same pieces, so that sectors and scan hold the same samples.
The whole revolution is judged and counted. If nothing was missing, it is the sum of its pieces. Otherwise all its
packets are decoded once more, by a decoder in the state at its beginning.

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
from lidario.revolution.divided import (
    RETREAT_PART,
    ROUNDING,
    DividedRevolution,
    OpenSector,
    is_doubted,
    join_pieces,
)
from lidario.revolution.ended import EndedRevolution, share_before
from lidario.revolution.late_reads import Ends
from lidario.revolution.partial import PartialRevolution
from lidario.revolution.seam import Split
from lidario.revolution.timing import earliest_ns
from lidario.scans.measured import made_of
from lidario.scans.samples import read_only
from lidario.scans.scan import Scan
from lidario.scans.sector import Sector
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
        known_ns = self.incoming.time.known_ns
        here.sample_ns = here.by_speed_ns or known_ns
        full_turn = here.wire.full_turn
        # A heading that trembles back over the seam seems to be almost a revolution ahead.
        most = full_turn - full_turn // RETREAT_PART
        for number, angle in enumerate(here.come(packets, headings)):
            if 0 < angle - here.passed <= most:
                here.passed = angle
                if angle >= here.ends[here.at][0]:
                    here.decode_until(number, known_ns)
                    here.sample_ns = here.by_speed_ns or known_ns
                    while angle >= here.ends[here.at][0]:
                        self._hand_out(here)
            here.waiting_at = angle

    def _begin(self, first: int) -> DividedRevolution | None:
        """Begin to divide a revolution at the heading of its first packet; None if it cannot be divided."""
        partial, wire, before = self.partial, self._stream.format, self._latest
        # If angles are not certain (`carried_packets`), samples that were carried over may still be dropped.
        sure = partial.whole and not partial.moved and not partial.carried_packets and len(partial.runs) == 1
        sample_ns = (before.by_speed_ns if before else 0.0) or self.incoming.time.known_ns
        if not sure or partial.seam is None or not sample_ns:
            return None
        began = first & HEADING_MASK if first & BEGINS else partial.seam
        offset_deg, usual_ns = self._stream.zero_offset_deg, self._clock.usual_ns
        here = DividedRevolution(
            partial, began, wire, self._parts, self._decoder.fork(), usual_ns, offset_deg, self._doubted
        )
        if before is not None:
            here.usual_samples, here.by_speed_ns = before.usual_samples, before.by_speed_ns
        if here.samples:
            here.first_ns = partial.carried_ns - (here.samples - 1) * sample_ns
            # The packet that crossed the seam ends where the first one begins, unless packets are missing between.
            here.last_arc = ((first & HEADING_MASK) - began) % wire.full_turn
            if here.gap and here.usual_samples:
                here.last_arc = here.samples * wire.full_turn / here.usual_samples
            if here.last_arc > wire.full_turn - wire.full_turn // RETREAT_PART:
                here.last_arc = 0.0
        return here

    # ------------------------------------------------------------------------------------------------ sectors

    def _hand_out(self, here: DividedRevolution) -> None:
        """The rotor has passed an end of sectors: publish those that have samples and certain angles."""
        sample_ns, mode = here.sample_ns, self._stream.mode
        for count in here.pass_end():
            done = here.open[count]
            pieces = here.pieces[done.first :]
            if not pieces or not here.certain:
                # This sector is left out, as the next index shows. The next one counts the packets missing here.
                done.index += 1
                continue
            arrays = pieces[0] if len(pieces) == 1 else join_pieces(pieces)
            # When the first sample of the revolution was measured, by the packets so far.
            packet_bytes = here.partial.size / here.packets
            start_ns = earliest_ns(here.first_ns, sample_ns, packet_bytes * self._byte_ns)
            if here.seq is None:
                here.seq = self._number(here, start_ns)
            lost = max(0, here.lost - done.lost)
            stamp_ns, gaps = here.placed(done, start_ns)
            duration_ns = round((len(arrays.angle) + sum([skipped for _, skipped in gaps])) * sample_ns)
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
                lost_packets=lost,
                mode=mode.name,
                max_range=mode.max_distance,
                field_of_view=here.wire.field_deg,
                _gaps=gaps,
            )
            here.open[count] = OpenSector(done.index + 1, here.given, here.lost, len(here.pieces), sector)
            self._publish_sector(count, sector)

    def _number(self, here: DividedRevolution, start_ns: int) -> int:
        """The number of the revolution; counts the revolutions that passed unseen before it."""
        stats, partial = self.stats, here.partial
        stats.resume(start_ns)
        if self._clock.last is not None and here.decoded:
            samples = here.decoded[0]
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
                self._finish_all(here, made[0])
        return made

    def _end(self, split: Split, following: bytes) -> Scan | None:
        here, broken = self.partial.divided, self.stats.broken_scans
        self._doubted = False
        scan = super()._end(split, following)
        self._told_seq, self._told_unseen = None, 0
        if here is not None and here.is_finished and not (split.broken or split.moved):
            if here.seq is None and scan is not None:
                here.seq = scan.seq
            elif here.seq is None and self.stats.broken_scans > broken:
                # A broken revolution has used up a number.
                here.seq = self.stats.scans + self.stats.missed_scans - 1
            if here.seq is not None:
                self._finish_all(here, scan)
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
        here = ended.divided
        if here is not None:
            seam = None if split.marked or split.broken else split.seam
            here.finish(following, seam, broken=split.broken)
            self._told_seq, self._told_unseen = here.seq, here.unseen
            if not split.broken and (whole := here.whole()) is not None:
                self._decoder = here.decoder
                return whole
        found = super()._decode(ended, packets, split, following, room)
        if here is not None and here.certain:
            arrays = here.all_samples()
            found.revolutions = [found.last._replace(before_seam=here.before_seam)]
            found.angle_deg, found.distance_mm, found.intensity = arrays.angle, arrays.distance, arrays.intensity
        return found

    def _finish_all(self, here: DividedRevolution, scan: Scan | None) -> None:
        """The revolution has ended: hand out its last sectors. The last one counts all lost packets found late."""
        here.leave_rest()
        if scan is not None:
            here.lost_behind = scan.lost_packets - here.lost
        here.sample_ns = here.by_speed_ns or self.incoming.time.known_ns
        while here.at < len(here.ends):
            self._hand_out(here)
