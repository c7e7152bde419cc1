"""A revolution in the making that is divided into sectors: its decoded samples, open sectors and waiting packets.

Plain state and arithmetic; `lidario.revolution.sectors` drives it with each packet.
"""

import math
from collections.abc import Sequence
from dataclasses import InitVar, dataclass, field
from functools import cache
from operator import itemgetter
from typing import Final

import numpy as np

from lidario.families.base import DecodedRevolution, Decoder, Samples
from lidario.revolution.ended import FALSE_PART, UNEVEN, hides_a_turn
from lidario.revolution.partial import PartialRevolution, SampleArrays, part_of
from lidario.revolution.timing import begins_of
from lidario.revolution.together import joined
from lidario.scans.sector import Sector
from lidario.wire.blocks import Block, packet_offsets, some_blocks
from lidario.wire.events import Packets
from lidario.wire.formats import HEADING_MASK, Headings, StreamFormat

ROUNDING: Final = 1e-9
"""Far less than a packet, and more than the rounding error of a whole number."""
RETREAT_PART: Final = 12
"""Headings may tremble back by one twelfth of 360 degrees, as in `Seam`."""


@cache
def ends_of(full_turn: int, parts: tuple[int, ...]) -> tuple[tuple[int, tuple[int, ...]], ...]:
    """Where sectors end: angles behind the seam in heading units, and the sizes of the sectors that end there.

    The last end is that of the revolution, which no heading reaches.
    """
    found: dict[int, list[int]] = {}
    for count in parts:
        for number in range(1, count + 1):
            found.setdefault(-(-full_turn * number // count), []).append(count)
    return tuple((end, tuple(found[end])) for end in sorted(found))


@dataclass(slots=True)
class OpenSector:
    """The sector in the making, of one size."""

    index: int = 0  # its number in the revolution
    begin: int = 0  # samples of the revolution before it
    lost: int = 0  # packets of the revolution that were lost before it
    first: int = 0  # number of the first of its pieces
    last: Sector | None = None  # the last sector of this revolution that came before it


@dataclass(slots=True, eq=False)
class DividedRevolution:
    """The revolution in the making, as far as it was divided."""

    partial: PartialRevolution  # the same revolution, undivided
    began: int  # heading at which it began
    wire: StreamFormat  # the format of its packets
    parts: InitVar[tuple[int, ...]]  # how many sectors a revolution is divided into, for each size
    decoder: Decoder  # decodes its pieces
    usual_ns: float  # time of a revolution; 0 if unknown
    offset_deg: float  # zero-angle offset of all its sectors
    doubted: bool = False  # as `is_doubted`, of the revolution before, if that was broken
    usual_samples: float = 0.0  # samples of a revolution, by the latest speed that was certain; 0 if unknown
    by_speed_ns: float = 0.0  # nanoseconds a sample, where the speed decides that; else 0
    # Where sectors end, as `ends_of`; `at` is the number of the next end.
    ends: tuple[tuple[int, tuple[int, ...]], ...] = field(init=False)
    at: int = 0
    # The sectors in the making, by how many of them a revolution has.
    open: dict[int, OpenSector] = field(init=False)
    # Runs with packets that were not decoded yet: all but the first `begun` ones.
    waiting: list[Packets] = field(default_factory=list)
    begun: int = 0
    waiting_at: int = field(init=False)  # how far behind the seam the last packet begins that was looked at
    rest: SampleArrays | None = None  # decoded samples that belong to no sector yet
    decoded: list[Samples] = field(default_factory=list)  # the results of the decoder so far
    # The samples before `rest`, from those that were carried over on, divided where sectors end.
    pieces: list[SampleArrays] = field(default_factory=list)
    passed: int = 0  # how far behind the seam the headings have come
    last: int = 0  # how far behind the seam the last decoded packet begins
    last_samples: int = field(init=False)  # samples of the last decoded packet
    last_arc: float = field(init=False)  # how far the rotor turned during the last decoded packet
    given: int = 0  # samples in `pieces`
    lost: int = field(init=False)  # packets known to be missing so far
    # Where samples are missing so far: how many came before, and how many are missing there.
    gaps: list[tuple[int, int]] = field(default_factory=list)
    # Packets that are missing behind the last decoded packet, and belong to no sector yet.
    lost_behind: int = 0
    skipped_behind: int = field(init=False)  # samples that are missing behind the last decoded packet
    samples: int = 0  # samples that have come
    longest: int = 0  # bytes of the longest packet
    most_samples: int = field(init=False)  # samples of the longest packet
    packets: int = 0  # how many packets have come
    sample_ns: float = field(init=False)  # nanoseconds a sample, as far as known
    first_ns: float = math.inf  # earliest estimate of when the first sample arrived; infinite before the first
    gap: bool = False  # whether a gap is known, so that the number of samples shows no time any more
    certain: bool = True  # whether all decoded angles are certain, and no revolution passed unseen among them
    seq: int | None = None  # its number, once a sector told it
    unseen: int = 0  # revolutions before it that were counted as missing when the number was told
    is_finished: bool = False  # whether it has ended, and all of it was decoded
    crossed: int = field(init=False)  # at its end: how many samples of `rest` lie before the seam
    before_seam: int = field(init=False)  # at its end: how many samples of its packets lie before the seam

    def __post_init__(self, parts: tuple[int, ...]) -> None:
        self.ends = ends_of(self.wire.full_turn, parts)
        self.open = {count: OpenSector() for count in parts}
        carried, self.lost = self.partial.carried, self.partial.lost_behind_carried
        if carried is not None:
            self.rest, self.gap = carried, bool(self.lost)
            self.samples = self.last_samples = len(carried.angle)
        self.lost += self.partial.lost_before
        self.skipped_behind = self.partial.skipped_behind_carried
        if self.skipped_behind:
            self.gaps.append((self.samples, self.skipped_behind))

    def come(self, packets: Packets, headings: Headings) -> list[int]:
        """Packets come, and wait. Each arrival tells when the revolution may have begun, the earliest the best.

        Returns:
            How far behind the seam each packet begins.
        """
        wire, blocks, (count, _) = self.wire, packets.blocks, packets.arrivals[-1]
        all_samples = wire.samples_in(blocks)
        # Behind a gap the number of samples since the beginning is not known exactly.
        if not self.gap or math.isinf(self.first_ns):
            for complete, at_ns in packets.arrivals:
                some = complete < count
                samples = wire.samples_in(some_blocks(blocks, 0, complete)) if some else all_samples
                self.first_ns = min(self.first_ns, at_ns - (self.samples + samples - 1) * self.sample_ns)
        self.samples += all_samples
        for size, _ in blocks:
            if size > self.longest:
                self.longest, self.most_samples = size, wire.samples_in((Block(size, 1),))
        self.packets += count
        self.waiting.append(packets)
        plain = headings.tolist() if isinstance(headings, np.ndarray) else headings
        return [((heading & HEADING_MASK) - self.began) % wire.full_turn for heading in plain]

    def decode_until(self, number: int, known_ns: float) -> None:
        """Decode the waiting packets up to `number` of those that came last, if there are any.

        Args:
            number: Of the packet that has passed the end of a sector.
            known_ns: Nanoseconds a sample; 0 if unknown.
        """
        run, last = joined(self.waiting), self.waiting[-1]
        end, offsets = run.count - last.count + number, packet_offsets(run.blocks)
        if end > self.begun:
            packets = part_of(run, self.begun, end, offsets, self.wire, known_ns)
            self._decode(packets, run.data[offsets[end] : offsets[end + 1]], self.passed)
            self.waiting, self.begun = [last], number

    def _decode(self, packets: Packets, following: bytes | None, next_at: int, seam: int | None = None) -> Samples:
        """Decode the packets that waited; their samples follow those in `rest`.

        Args:
            packets: The packets.
            following: The packet behind them, if the decoder may use it.
            next_at: How far behind the seam that packet begins.
            seam: As for `Decoder.decode`.
        """
        rest = self.rest
        left = 0 if rest is None else len(rest.angle)
        samples = self.decoder.decode(packets, following, left, seam)
        ends, usual_samples = samples.ends, samples.last.samples
        arrays = SampleArrays(samples.angle_deg, samples.distance_mm, samples.intensity)
        if rest is not None:
            arrays.begin_with(rest)
        self.rest = arrays
        earlier = self.given + left
        if samples.certain:
            if self.gaps or samples.gaps or samples.sample_ns:
                before = earlier + sum([skipped for _, skipped in self.gaps])
                found = begins_of(packets, samples, before, self.sample_ns)
            else:
                # The estimates by the earlier packets were made as they came.
                found = [packets.arrivals[-1][1] - (earlier + ends[-1] - 1) * self.sample_ns]
            self.first_ns = min(self.first_ns, *found)
            # If whole revolutions passed unseen, these packets belong to another one, as in `EndedRevolution`.
            turn_ns = self.usual_ns or usual_samples * self.sample_ns
            gap = self.gap or samples.lost > samples.lost_behind
            self.certain &= not (turn_ns and hides_a_turn(found[-1] - self.first_ns, turn_ns, gap=gap))
            # If half a turn more is missing than the angles passed, they fell back: a part of another revolution is
            # among the packets.
            behind = samples.skipped_behind
            missing = self.skipped_behind + sum([skipped for _, skipped in samples.gaps]) - behind
            turned = (next_at - self.last) / self.wire.full_turn
            self.certain &= missing <= (turned + 0.5) * usual_samples
            # Time shows whether the rotor turns faster for a whole revolution, but not for a few packets.
            self.certain &= not (self.doubted and may_be_faster(samples))
            self.skipped_behind = behind
        else:
            self.certain &= self.wire.own_angles
        self.gaps += [(earlier + before, skipped) for before, skipped in samples.gaps]
        self.decoded.append(samples)
        self.lost += self.lost_behind + samples.lost - samples.lost_behind
        self.lost_behind = samples.lost_behind
        self.gap |= bool(samples.lost)
        self.last, self.last_samples = self.waiting_at, ends[-1] - (ends[-2] if len(ends) > 1 else 0)
        self.last_arc = (next_at - self.last) % self.wire.full_turn
        if not samples.certain:
            # A lone sample shows no step. The usual step tells how many samples are missing behind it.
            skipped = round(self.last_arc * self.usual_samples / self.wire.full_turn) - self.last_samples
            if skipped > 0:
                self.gaps.append((earlier + ends[-1], skipped))
                self.skipped_behind, self.gap = skipped, True
        elif usual_samples:
            self.usual_samples, self.by_speed_ns = usual_samples, samples.sample_ns
            if samples.lost_behind:
                self.last_arc = self.last_samples * self.wire.full_turn / usual_samples
        return samples

    def pass_end(self) -> tuple[int, ...]:
        """The rotor has passed an end of sectors: divide `rest` there, by the arc of the last packet.

        Returns:
            The sizes of the sectors that end there, each as how many of them a revolution has.
        """
        (end, parts), rest = self.ends[self.at], self.rest
        self.at += 1
        if rest is not None:
            inside, size = self.last_samples, len(rest.angle)
            if self.at == len(self.ends):
                upto = size
            else:
                if self.last_arc > 0:
                    by_arc = math.ceil((end - self.last) * inside / self.last_arc - ROUNDING)
                    inside = max(0, min(inside, by_arc))
                upto = max(0, size - self.last_samples + inside)
            if upto:
                self.pieces.append(rest.part(0, upto))
                self.rest = rest.part(upto)
                self.given += upto
            if upto == size:
                # The packets missing behind the last one belong to the sector that ends with it.
                self.lost, self.lost_behind = self.lost + self.lost_behind, 0
        return parts

    def placed(self, done: OpenSector, start_ns: int) -> tuple[int, list[tuple[int, int]]]:
        """When the first sample of a sector was measured, and where samples are missing in the sector.

        Args:
            done: The sector, whose end the rotor has passed.
            start_ns: When the first sample of the revolution was measured.
        """
        before, gaps = done.begin, list[tuple[int, int]]()
        for at, skipped in self.gaps:
            if at <= done.begin:
                before += skipped
            elif at < self.given:
                gaps.append((at - done.begin, skipped))
        stamp_ns = start_ns + round(before * self.sample_ns)
        if (last := done.last) is not None:
            less = round((last.stamp_ns + last.duration_ns - stamp_ns) / self.sample_ns)
            if gaps and less >= self.most_samples:
                # It would begin before the sector before it ended, by a packet or more: less is missing in the gap.
                at, skipped = gaps[0]
                less = min(skipped, less)
                gaps[0], stamp_ns = (at, skipped - less), stamp_ns + round(less * self.sample_ns)
            stamp_ns = max(stamp_ns, last.stamp_ns)
        return stamp_ns, gaps

    def finish(self, following: bytes, seam: int | None, *, broken: bool = False) -> None:
        """The revolution has ended: decode the rest of it.

        Args:
            following: The packet behind it.
            seam: As for `Decoder.decode`.
            broken: Whether the stream began anew with that packet.
        """
        wire, left = self.wire, 0 if self.rest is None else len(self.rest)
        first = Packets(following, (Block(len(following), 1),), ((1, 0),))
        behind = ((int(wire.headings(first)[0]) & HEADING_MASK) - self.began) % wire.full_turn
        run = joined(self.waiting)
        run = part_of(run, self.begun, run.count, None, wire, self.sample_ns) if self.begun else run
        piece = self._decode(run, None if broken else following, wire.full_turn + behind, seam)
        inside = piece.last.before_seam
        self.is_finished, self.crossed = True, left + inside
        self.before_seam = sum([each.ends[-1] for each in self.decoded]) - piece.ends[-1] + inside

    def all_samples(self) -> SampleArrays:
        """All decoded samples, also those of the last packet that lie behind the seam."""
        assert self.rest is not None
        return join_pieces([*self.pieces, self.rest]) if self.pieces else self.rest

    def whole(self) -> Samples | None:
        """The ended revolution, as `Decoder.decode` gives it; None if its pieces do not tell all of it."""
        if not self.certain or self.unseen or not all(piece.is_steady for piece in self.decoded):
            return None
        found, arrays = list[int](), self.all_samples()
        turns = sample_turns = told = told_rpm = 0.0
        for piece in self.decoded:
            (_, packets, samples, rpm), count, before = piece.last, len(piece.ends), found[-1] if found else 0
            found += [before + end for end in piece.ends]
            turns += count / packets
            sample_turns += piece.ends[-1] / samples
            if not math.isnan(rpm):
                told, told_rpm = told + count, told_rpm + count * rpm
        if not FALSE_PART <= sample_turns <= UNEVEN:
            # A rotor that stood shows no step, and a false seam ends no whole revolution.
            return None
        of_all = DecodedRevolution(
            self.before_seam, len(found) / turns, found[-1] / sample_turns, told_rpm / told if told else math.nan
        )
        return Samples(
            arrays.angle, arrays.distance, arrays.intensity, found, [of_all], lost=0, unbroken=len(found)
        )

    def leave_rest(self) -> None:
        """Leave the samples behind the seam in the last packet, and the gap behind it, to the next revolution."""
        assert self.rest is not None
        over = len(self.rest) - self.crossed
        if over:
            self.rest = self.rest.part(0, self.crossed)
            self.last_arc *= 1 - over / self.last_samples
            self.last_samples -= over
            self.lost_behind = 0


def may_be_faster(samples: Samples, begin: int = 0) -> bool:
    """Whether the gaps between all packets behind the first `begin` samples are equal.

    Then the packets may also be consecutive ones of a rotor that turns faster.
    """
    gaps = dict(samples.gaps)
    apart = {gaps.get(end, 0) for end in samples.ends if end > begin}
    return len(apart) == 1 and 0 not in apart


def is_doubted(samples: Samples) -> bool:
    """As `may_be_faster` for the packets behind the longest gap, where a revolution may have passed unseen.

    Also True if no packet came behind that gap.
    """
    begin, _ = max(samples.gaps, key=itemgetter(1))
    return 0 < begin == samples.ends[-1] or may_be_faster(samples, begin)


def join_pieces(pieces: Sequence[SampleArrays]) -> SampleArrays:
    """Join samples that follow each other; the arrays are new."""
    intensities = [piece.intensity for piece in pieces if piece.intensity is not None]
    return SampleArrays(
        np.concatenate([piece.angle for piece in pieces]),
        np.concatenate([piece.distance for piece in pieces]),
        np.concatenate(intensities) if intensities else None,
    )
