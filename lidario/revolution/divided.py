"""A revolution in the making that is divided: what of it was decoded, what was handed out, and what waits.

Plain state and arithmetic; `lidario.revolution.sectors` leads it from packet to packet.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import InitVar, dataclass, field
from functools import cache
from operator import itemgetter
from typing import Final

import numpy as np

from lidario.families.base import DecodedRevolution, Decoder, Samples
from lidario.revolution.ended import FALSE_PART, UNEVEN, hides_a_turn
from lidario.revolution.partial import PartialRevolution, SampleArrays
from lidario.revolution.timing import begins_of
from lidario.revolution.together import joined
from lidario.sector import Sector
from lidario.wire.blocks import Block, some_blocks
from lidario.wire.events import Packets
from lidario.wire.formats import HEADING_MASK, Headings, StreamFormat

ROUNDING: Final = 1e-9
"""Much less than a packet, and more than what rounding makes of a whole number."""
RETREAT_PART: Final = 12
"""Headings may tremble back by this part of 360 degrees, a twelfth, as in `Seam`."""


@cache
def ends_of(full_turn: int, parts: tuple[int, ...]) -> tuple[tuple[int, tuple[int, ...]], ...]:
    """Where sectors end: angles behind the seam in heading units, and the parts that end there.

    The last of them is where the revolution ends. No heading is that far behind its beginning.
    """
    found: dict[int, list[int]] = {}
    for count in parts:
        for number in range(1, count + 1):
            found.setdefault(-(-full_turn * number // count), []).append(count)
    return tuple((end, tuple(found[end])) for end in sorted(found))


@dataclass(slots=True)
class OpenSector:
    """A sector in the making, of one size."""

    index: int = 0  # which one
    begin: int = 0  # samples of the revolution before it
    lost: int = 0  # packets of the revolution that were lost before it
    first: int = 0  # number of the first of its pieces
    last: Sector | None = None  # the sector before it, of those that came


@dataclass(slots=True, eq=False)
class DividedRevolution:
    """The revolution in the making, as far as it was divided."""

    partial: PartialRevolution  # what is known of it
    began: int  # heading at which it began
    wire: StreamFormat  # the format of its packets
    parts: InitVar[tuple[int, ...]]  # how many sectors it is divided into, of each size
    decoder: Decoder  # decodes its pieces
    usual_ns: float  # what a revolution takes; 0 where that is not known
    offset_deg: float  # zero-angle offset of all its sectors
    doubted: bool = False  # as `is_doubted`, of the revolution before, if that was broken
    usual_samples: float = 0.0  # what it has, by the latest speed that was certain; 0 where that is not known
    by_speed_ns: float = 0.0  # nanoseconds a sample, where the speed decides that; else 0
    # Where sectors end, as `ends_of`; `at` is the next one.
    ends: tuple[tuple[int, tuple[int, ...]], ...] = field(init=False)
    at: int = 0
    # The sectors in the making, by how many a revolution has.
    open: dict[int, OpenSector] = field(init=False)
    waiting: list[Packets] = field(default_factory=list)  # packets that were not decoded
    waiting_at: int = field(init=False)  # how far behind the seam the last of them begins
    rest: SampleArrays | None = None  # samples that were decoded and belong to no sector yet
    decoded: list[Samples] = field(default_factory=list)  # what was decoded so far
    # The samples before `rest`, those that were carried over first, divided where a sector ends.
    pieces: list[SampleArrays] = field(default_factory=list)
    passed: int = 0  # how far behind the seam the headings have come
    last: int = 0  # how far behind the seam the last packet that was decoded begins
    last_samples: int = field(init=False)  # its samples
    last_arc: float = field(init=False)  # how far the rotor turned during it
    given: int = 0  # samples in these pieces
    lost: int = field(init=False)  # packets known to be missing so far
    # Where samples are missing so far: how many came before, and how many are missing there.
    gaps: list[tuple[int, int]] = field(default_factory=list)
    # Those that are missing behind the last packet that was decoded, and belong to no sector yet.
    lost_behind: int = 0
    skipped_behind: int = field(init=False)  # samples that are missing behind it
    samples: int = 0  # samples that have come
    longest: int = 0  # bytes of the longest packet
    most_samples: int = field(init=False)  # its samples
    packets: int = 0  # how many packets they are
    sample_ns: float = field(init=False)  # nanoseconds a sample, as far as that is known
    first_ns: float = math.inf  # earliest estimate of when the first sample arrived; infinite when there is none
    gap: bool = False  # whether a gap is known, so that the number of samples tells no time any more
    certain: bool = True  # whether the angles of all that was decoded are, and no turn passed unseen among it
    seq: int | None = None  # its number, once told
    unseen: int = 0  # revolutions before it that were counted as missing when that was told
    is_finished: bool = False  # whether it has ended, and all of it was decoded
    crossed: int = field(init=False)  # how many samples of `rest` belong to it then; the others lie behind the seam
    before_seam: int = field(init=False)  # how many samples of its packets do

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
        """Take note of when packets came: each tells when the revolution began, the least delayed one best.

        Returns:
            How far behind the seam each of them begins.
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
        plain = headings.tolist() if isinstance(headings, np.ndarray) else headings
        return [((heading & HEADING_MASK) - self.began) % wire.full_turn for heading in plain]

    def decode_waiting(self, following: bytes | None, next_at: int, seam: int | None = None) -> Samples:
        """Decode what waits, behind the samples that were left over before.

        Args:
            following: The packet behind it, if that may be looked at.
            next_at: How far behind the seam that one begins.
            seam: As for `Decoder.decode`.
        """
        packets, rest = joined(self.waiting), self.rest
        left = 0 if rest is None else len(rest.angle)
        samples = self.decoder.decode(packets, following, left, seam)
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
                # Those before were dated as they came.
                found = [packets.arrivals[-1][1] - (earlier + samples.ends[-1] - 1) * self.sample_ns]
            self.first_ns = min(self.first_ns, *found)
            # Where whole turns passed unseen, these packets belong to another revolution, as in `EndedRevolution`.
            turn_ns = self.usual_ns or samples.last.samples * self.sample_ns
            gap = self.gap or samples.lost > samples.lost_behind
            self.certain &= not (turn_ns and hides_a_turn(found[-1] - self.first_ns, turn_ns, gap=gap))
            # Where half a turn more is missing than the angles passed, they fell back: a part of another revolution
            # is among them.
            missing = self.skipped_behind + sum([skipped for _, skipped in samples.gaps]) - samples.skipped_behind
            turned = (next_at - self.last) / self.wire.full_turn
            self.certain &= missing <= (turned + 0.5) * samples.last.samples
            # Of the whole revolution time tells whether the rotor turns faster, of a few packets it does not.
            self.certain &= not (self.doubted and may_be_faster(samples))
            self.skipped_behind = samples.skipped_behind
        else:
            self.certain &= self.wire.own_angles
        self.gaps += [(earlier + before, skipped) for before, skipped in samples.gaps]
        self.decoded.append(samples)
        self.waiting.clear()
        self.lost += self.lost_behind + samples.lost - samples.lost_behind
        self.lost_behind = samples.lost_behind
        self.gap |= bool(samples.lost)
        ends = samples.ends
        self.last, self.last_samples = self.waiting_at, ends[-1] - (ends[-2] if len(ends) > 1 else 0)
        self.last_arc = (next_at - self.last) % self.wire.full_turn
        if not samples.certain:
            # A lone sample tells no step. What is missing behind it, the usual step does.
            skipped = round(self.last_arc * self.usual_samples / self.wire.full_turn) - self.last_samples
            if skipped > 0:
                self.gaps.append((earlier + ends[-1], skipped))
                self.skipped_behind, self.gap = skipped, True
        if samples.certain and samples.last.samples:
            self.usual_samples, self.by_speed_ns = samples.last.samples, samples.sample_ns
            if samples.lost_behind:
                self.last_arc = self.last_samples * self.wire.full_turn / samples.last.samples
        return samples

    def pass_end(self) -> tuple[int, ...]:
        """The rotor has passed the end of sectors: divide the rest there, by the last packet's arc.

        Returns:
            How many sectors of their size a revolution has.
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
                # What is missing behind the last packet belongs to the sector that ends with it.
                self.lost, self.lost_behind = self.lost + self.lost_behind, 0
        return parts

    def placed(self, done: OpenSector, start_ns: int) -> tuple[int, list[tuple[int, int]]]:
        """When the first sample of a sector was measured, and where samples are missing among its own.

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
                # What came behind the gap was sooner than that allows, by a packet or more: less is missing.
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
            broken: Whether the stream began anew with that one.
        """
        wire, left = self.wire, 0 if self.rest is None else len(self.rest)
        first = Packets(following, (Block(len(following), 1),), ((1, 0),))
        behind = ((int(wire.headings(first)[0]) & HEADING_MASK) - self.began) % wire.full_turn
        piece = self.decode_waiting(None if broken else following, wire.full_turn + behind, seam)
        inside = piece.last.before_seam
        self.is_finished, self.crossed = True, left + inside
        self.before_seam = sum([each.ends[-1] for each in self.decoded]) - piece.ends[-1] + inside

    def all_samples(self) -> SampleArrays:
        """All that was decoded, also what lies behind the seam in the last packet."""
        assert self.rest is not None
        return join_pieces([*self.pieces, self.rest]) if self.pieces else self.rest

    def whole(self) -> Samples | None:
        """As `Decoder.decode`, of the revolution, which has ended; None where its pieces do not tell all of it."""
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
            # A rotor that stood tells of no step, and behind a false seam lies no whole revolution.
            return None
        of_all = DecodedRevolution(
            self.before_seam, len(found) / turns, found[-1] / sample_turns, told_rpm / told if told else math.nan
        )
        return Samples(
            arrays.angle, arrays.distance, arrays.intensity, found, [of_all], lost=0, unbroken=len(found)
        )

    def leave_rest(self) -> None:
        """Leave to the next revolution what lies behind the seam in the last packet, and what is missing there."""
        assert self.rest is not None
        over = len(self.rest) - self.crossed
        if over:
            self.rest = self.rest.part(0, self.crossed)
            self.last_arc *= 1 - over / self.last_samples
            self.last_samples -= over
            self.lost_behind = 0


def may_be_faster(samples: Samples, begin: int = 0) -> bool:
    """Whether all packets behind so many samples are as many arcs apart, or one of a rotor that turns faster."""
    gaps = dict(samples.gaps)
    apart = {gaps.get(end, 0) for end in samples.ends if end > begin}
    return len(apart) == 1 and 0 not in apart


def is_doubted(samples: Samples) -> bool:
    """The same behind the longest gap, where a turn may have passed unseen; or nothing came behind it."""
    begin, _ = max(samples.gaps, key=itemgetter(1), default=(0, 0))
    return 0 < begin == samples.ends[-1] or may_be_faster(samples, begin)


def join_pieces(pieces: Sequence[SampleArrays]) -> SampleArrays:
    """Samples that follow each other, in arrays of their own."""
    intensities = [piece.intensity for piece in pieces if piece.intensity is not None]
    return SampleArrays(
        np.concatenate([piece.angle for piece in pieces]),
        np.concatenate([piece.distance for piece in pieces]),
        np.concatenate(intensities) if intensities else None,
    )
