"""Parts of the revolution in the making, handed out as soon as the rotor has passed the end of each.

`SectorAssembler` is an `Assembler` that ends a revolution also where it has not ended: each time the headings pass
the end of a sector, all its packets up to there are decoded, as they are at the seam. To decode a part of a
revolution costs hardly less than to decode all of it. Where a packet lies across the end of a sector, its samples
are divided by where the rotor stood. What was handed out stays as it was, whatever is known later, so that the
sectors and the scan hold the same samples; all else, the scan tells as if there were no sectors.

The number of a revolution is known only at its end, when the time tells how many passed unseen before it. A sector
needs it earlier; so it is found in the same way with what is known when the first sector is complete, and the scan
then keeps it.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from typing import Final

import numpy as np

from lidario.families.base import Samples
from lidario.measured import with_gaps
from lidario.revolution.assemble import Assembler
from lidario.revolution.build import turned_by
from lidario.revolution.clock import NOISE, Beginning
from lidario.revolution.divided import RETREAT_PART, ROUNDING, DividedRevolution, OpenSector
from lidario.revolution.ended import hides_a_turn, share_before, share_past
from lidario.revolution.partial import PartialRevolution, joined, part_of
from lidario.revolution.seam import Split
from lidario.revolution.timing import begins_of, earliest_ns
from lidario.samples import read_only
from lidario.scan import Scan
from lidario.sector import Sector
from lidario.wire.blocks import packet_offsets
from lidario.wire.copies import copy_of
from lidario.wire.events import Packets
from lidario.wire.formats import BEGINS, HEADING_MASK, Headings

MOST_PARTS: Final = 72
"""Sectors of 5 degrees: the narrowest packet of any format is not much narrower."""


class SectorAssembler(Assembler):
    """As `Assembler`; once it was told to divide revolutions, it hands out their sectors before."""

    _publish_sector: Callable[[int, Sector], None]
    _parts: tuple[int, ...] = ()
    _latest: DividedRevolution | None = None

    def divide(self, parts: Iterable[int], publish: Callable[[int, Sector], None]) -> None:
        """Hand out sectors from the next revolution on.

        Args:
            parts: How many sectors each revolution is divided into; several sizes at the same time, or none.
            publish: Called with how many sectors of its size a revolution has, and the sector.
        """
        self._parts, self._publish_sector = tuple(sorted(parts)), publish

    @property
    def _by_blocks(self) -> bool:
        # What was begun in pieces is ended in pieces, even if nobody reads sectors any more.
        return not self._parts and self.partial.divided is None

    @property
    def next_ns(self) -> float:
        """When the packet that completes the next sector arrives if it is not late; NaN where unknown."""
        here = self.partial.divided
        if here is None or not here.usual_samples:
            return math.nan
        wire, each, (end, _) = here.wire, here.most_samples, here.ends[here.at]
        sample_ns = here.by_speed_ns or self.incoming.time.known_ns
        varies = wire.shortest != wire.longest
        # From the beginning of the last packet to the end of the sector.
        away = (end - here.passed) * here.usual_samples / wire.full_turn
        if varies and end == wire.full_turn:
            # The last packet is as short as need be, and so is the first one of the next revolution.
            more = max(1.0, away - each + 1)
        else:
            # Where packets hold a sample more or fewer, a whole number of them may be off by two samples.
            more = float(max(1, math.ceil(away / each - (2 / each if varies else ROUNDING))) * each)
        if here.has_gap or math.isinf(here.first_ns):
            return here.partial.last_ns + more * sample_ns
        return here.first_ns + (here.came + more - 1) * sample_ns

    @property
    def keeps_offset(self) -> bool:
        """Whether the revolution in the making keeps its zero-angle offset: where sectors of it were handed out."""
        return self.partial.divided is not None

    def set_zero_offset(self, degrees: float, *, behind: bool = False) -> None:
        """As `Assembler.set_zero_offset`; a revolution of which sectors were handed out keeps the one before."""
        super().set_zero_offset(degrees, behind=behind or self.keeps_offset)

    # ------------------------------------------------------------------------------------------------ packets come

    def _keep(self, packets: Packets, headings: Headings) -> None:
        super()._keep(packets, headings)
        here = self.partial.divided
        if here is None:
            if not self._parts or (here := self._begin(int(headings[0]))) is None:
                return
            self.partial.divided = self._latest = here
        wire, number = here.wire, here.packets
        here.note(packets)
        # A reading that trembles back over the seam seems to be almost a revolution ahead.
        most = wire.full_turn - wire.full_turn // RETREAT_PART
        for heading in headings.tolist() if isinstance(headings, np.ndarray) else headings:
            angle = ((heading & HEADING_MASK) - here.began) % wire.full_turn
            if 0 < angle - here.passed <= most:
                here.passed = angle
            if here.passed >= here.ends[here.at][0]:
                if number:
                    self._decode_some(here, number)
                while here.passed >= here.ends[here.at][0]:
                    self._hand_out(here)
            here.last_at, number = angle, number + 1

    def _begin(self, first: int) -> DividedRevolution | None:
        """A revolution may begin with the packet of that heading; None where none does, or it cannot be divided."""
        partial, wire, before = self.partial, self._stream.format, self._latest
        # Where the angles are not certain, samples that were carried over may still be dropped.
        sure = partial.whole and not partial.moved and not partial.carried_packets and len(partial.runs) == 1
        sample_ns = (before.by_speed_ns if before else 0.0) or self.incoming.time.known_ns
        if not sure or partial.seam is None or not sample_ns:
            return None
        began = first & HEADING_MASK if first & BEGINS else partial.seam
        here = DividedRevolution(
            partial, began, wire, self._parts, self._clock.usual_ns, self._stream.zero_offset_deg
        )
        if before is not None:
            here.usual_samples, here.by_speed_ns = before.usual_samples, before.by_speed_ns
        if here.room:
            here.first_ns = partial.carried_ns - (here.room - 1) * sample_ns
            # The packet that crossed the seam ends where the first one begins, unless others are missing between.
            here.last_arc = ((first & HEADING_MASK) - began) % wire.full_turn
            if here.has_gap and here.usual_samples:
                here.last_arc = here.room * wire.full_turn / here.usual_samples
            if here.last_arc > wire.full_turn - wire.full_turn // RETREAT_PART:
                here.last_arc = 0.0
        return here

    def _decode_some(self, here: DividedRevolution, count: int) -> None:
        """Decode the packets so far up to that one, as if the revolution had ended there."""
        partial, wire = here.partial, here.wire
        partial.runs = [joined(partial.runs)]
        offsets = packet_offsets(partial.runs[0].blocks)
        packets = part_of(partial.runs[0], 0, count, offsets, wire, self.incoming.time.known_ns)
        following = partial.runs[0].data[offsets[count] : offsets[count + 1]]
        samples = self._decoder.fork().decode(packets, following, here.room)
        self._take(here, packets, samples, here.passed)

    def _take(self, here: DividedRevolution, packets: Packets, samples: Samples, next_at: int) -> None:
        """These packets were decoded to those samples."""
        here.take(samples, next_at)
        sample_ns = here.by_speed_ns or self.incoming.time.known_ns
        found = begins_of(here.partial, packets, samples, sample_ns)
        here.first_ns = min(found)
        if samples.certain:
            # Where whole turns passed unseen, these packets belong to another revolution, as in `EndedRevolution`.
            turn_ns = here.usual_ns or samples.last.samples * sample_ns
            gap = here.partial.lost_behind_carried > 0 or samples.lost > samples.lost_behind
            here.certain &= not (turn_ns and hides_a_turn(found[-1] - here.first_ns, turn_ns, gap=gap))
        else:
            here.certain &= here.wire.own_angles

    # ------------------------------------------------------------------------------------------------ sectors

    def _hand_out(self, here: DividedRevolution) -> None:
        """The rotor has passed the end of sectors: publish those of which samples came and angles are certain."""
        sample_ns, mode = here.by_speed_ns or self.incoming.time.known_ns, self._stream.mode
        (end, parts), arrays = here.ends[here.at], here.arrays
        upto = here.upto(end)
        here.at += 1
        here.given = upto
        lost = here.lost(upto)
        for count in parts:
            done = here.open[count]
            if arrays is None or upto == done.begin or not here.certain:
                # What is missing is told with the next one, whose index says that this one did not come.
                done.index += 1
                continue
            # When the first sample of the revolution was measured, as far as the packets so far tell.
            start_ns = earliest_ns(here.first_ns, sample_ns, here.partial.size / here.packets * self._byte_ns)
            if here.seq is None:
                here.seq = self._number(here, start_ns)
            gaps = here.gaps()
            before = done.begin + sum([skipped for at, skipped in gaps if at <= done.begin])
            gaps = [(at - done.begin, skipped) for at, skipped in gaps if done.begin < at < upto]
            stamp_ns = max(start_ns + round(before * sample_ns), done.after_ns)
            part, missing = arrays.part(done.begin, upto), max(0, lost - done.lost)
            sector = Sector(
                device_angles=read_only(turned_by(part.angle, here.offset_deg)),
                device_distances=read_only(part.distance),
                intensities=None if part.intensity is None else read_only(part.intensity),
                stamp_ns=stamp_ns,
                wall_stamp_ns=stamp_ns + self.wall_offset_ns,
                time_increment_ns=round(sample_ns),
                duration_ns=round((upto - done.begin + sum([skipped for _, skipped in gaps])) * sample_ns),
                rpm=60e9 / (here.usual_samples * sample_ns) if here.usual_samples else math.nan,
                seq=here.seq,
                index=done.index,
                degrees=360.0 / count,
                dropped_before=0,
                lost_packets=missing,
                mode=mode.name,
                max_range=mode.max_distance,
                field_of_view=here.wire.field_deg,
            )
            here.open[count] = OpenSector(done.index + 1, upto, done.lost + missing, stamp_ns)
            self._publish_sector(count, with_gaps(sector, gaps) if missing else sector)

    def _number(self, here: DividedRevolution, start_ns: int) -> int:
        """The number of the revolution; those that passed unseen before it are counted."""
        stats, partial = self.stats, here.partial
        stats.resume(start_ns)
        if self._clock.last is not None and (samples := here.samples) is not None:
            over = share_before(here.wire, partial, samples)
            turn_ns = samples.last.samples * (here.by_speed_ns or self.incoming.time.known_ns)
            from_end_ns = round(partial.last_ns - (here.passed / here.wire.full_turn - over) * turn_ns)
            # A read that was completed only behind a gap dates what came before it too late, as in `beginning_of`.
            late = samples.certain and start_ns - from_end_ns > NOISE * turn_ns
            # A copy follows: at the end of the revolution more is known, and remembered.
            passed = copy_of(self._clock).follow(
                Beginning(
                    from_end_ns if late else start_ns,
                    over=over,
                    revolution_ns=turn_ns if samples.certain else 0.0,
                    revolution_packets=samples.last.packets,
                    packet_ns=0.0,
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

    def add_block(self, event: Packets, offsets: Sequence[int], splits: Sequence[Split], first: int) -> list[Scan]:
        here = self.partial.divided
        made = super().add_block(event, offsets, splits, first)
        if made and here is not None:
            here.seq = made[0].seq
            self._finish(here)
        return made

    def _end(self, split: Split, following: bytes) -> Scan | None:
        here, broken = self.partial.divided, self.stats.broken_scans
        scan = super()._end(split, following)
        if here is not None:
            if here.seq is None and scan is not None:
                here.seq = scan.seq
            elif here.seq is None and self.stats.broken_scans > broken:
                # It has used a number up.
                here.seq = self.stats.scans + self.stats.missed_scans - 1
            self._finish(here)
        return scan

    def _decode(
        self, ended: PartialRevolution, packets: Packets, split: Split, following: bytes, room: int
    ) -> Samples:
        found, here = super()._decode(ended, packets, split, following, room), ended.divided
        if here is not None:
            self._told_seq, self._told_unseen = here.seq, here.unseen
            if not (split.broken or split.moved):
                behind = share_past(here.wire, following, here.began) * here.wire.full_turn
                self._take(here, packets, found, round(here.wire.full_turn + behind))
                here.crossed = room + found.last.before_seam
        return found

    def _finish(self, here: DividedRevolution) -> None:
        """The revolution has ended: hand out its last sectors, if it has a number."""
        self._told_seq, self._told_unseen = None, 0
        if here.crossed and here.seq is not None:
            here.lost_past = self.partial.lost_before
            while here.at < len(here.ends):
                self._hand_out(here)
