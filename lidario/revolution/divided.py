"""A revolution in the making that is divided into sectors: where they end, and what was handed out of it so far.

Plain state and arithmetic; `lidario.revolution.sectors` drives it with each packet.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cache
from operator import itemgetter
from typing import Final

import numpy as np
from numpy.typing import NDArray

from lidario.families.base import Samples
from lidario.revolution.ended import hides_a_turn
from lidario.revolution.partial import PartialRevolution, SampleArrays
from lidario.revolution.timing import begins_of
from lidario.scans.sector import Sector
from lidario.wire.blocks import Block, some_blocks
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
    last: Sector | None = None  # the last sector of this revolution that came before it


@dataclass(slots=True, eq=False)
class Decoded:
    """What is known of a revolution up to a packet that has passed the end of a sector, or up to its own end."""

    samples: Samples | None  # its packets, decoded; None if there are none before the next one
    arrays: SampleArrays  # its samples so far, with those that were carried over
    gaps: Sequence[tuple[int, int]]  # where samples are missing, as `PartialRevolution.gaps` tells it
    lost: int  # packets that are missing before the last packet
    lost_behind: int  # packets that are missing behind it
    last: int  # how far behind the seam the last packet begins
    last_samples: int  # samples of that packet
    last_arc: float  # how far the rotor turned during it
    over: int = 0  # how many of its samples lie behind the end of the revolution

    def before(self, end: int) -> int:
        """How many samples lie before an angle behind the seam, divided by the arc of the last packet."""
        inside = self.last_samples
        if self.last_arc > 0:
            by_arc = math.ceil((end - self.last) * inside / self.last_arc - ROUNDING)
            inside = max(0, min(inside, by_arc))
        count = len(self.arrays)
        return max(0, min(count, count + self.over - self.last_samples + inside))


@dataclass(slots=True, eq=False)
class DividedRevolution:
    """The revolution in the making, as far as it was divided."""

    partial: PartialRevolution  # the same revolution, undivided
    began: int  # heading at which it began
    wire: StreamFormat  # the format of its packets
    parts: tuple[int, ...]  # how many sectors a revolution is divided into, for each size
    usual_ns: float  # time of a revolution; 0 if unknown
    offset_deg: float  # zero-angle offset of all its sectors
    sample_ns: float  # nanoseconds a sample, as far as known
    doubted: bool  # as `is_doubted`, of the revolution before, if that was broken
    usual_samples: float  # samples of a revolution, by the latest speed that was certain; 0 if unknown
    by_speed_ns: float  # nanoseconds a sample, where the speed decides that; else 0
    # Where sectors end, as `ends_of`; `at` is the number of the next end.
    ends: tuple[tuple[int, tuple[int, ...]], ...] = field(init=False)
    at: int = 0
    # The sectors in the making, by how many of them a revolution has.
    open: dict[int, OpenSector] = field(init=False)
    passed: int = 0  # how far behind the seam the headings have come
    latest: int = 0  # how far behind the seam the last packet begins that was looked at
    samples: int = 0  # samples that have come
    packets: int = 0  # packets that have come
    longest: int = 0  # bytes of the longest packet
    most_samples: int = 0  # samples of the longest packet
    first_ns: float = math.inf  # earliest estimate of when the first sample arrived; infinite before the first
    gap: bool = False  # whether a gap is known, so that the number of samples shows no time any more
    certain: bool = True  # whether all decoded angles are certain, and no revolution passed unseen among them
    decoded: Decoded | None = None  # the revolution up to the latest end of a sector
    # Up to the packet that was then the next one: how far behind the seam it begins, how many samples were
    # measured, and how many of them are missing, but for those right before it.
    judged_at: int = 0
    measured: int = 0
    missing: int = 0
    given: int = 0  # samples that were handed out
    angles: list[NDArray[np.float32]] = field(default_factory=list)  # their angles
    lost: int = 0  # packets that were lost before them, or among them
    seq: int | None = None  # its number, once a sector told it
    unseen: int = 0  # revolutions before it that were counted as missing when the number was told

    def __post_init__(self) -> None:
        self.ends = ends_of(self.wire.full_turn, self.parts)
        self.open = {count: OpenSector() for count in self.parts}
        if (carried := self.partial.carried) is not None:
            self.samples, self.gap = len(carried), bool(self.partial.lost_behind_carried)
            self.first_ns = self.partial.carried_ns - (self.samples - 1) * self.sample_ns

    def come(self, packets: Packets, headings: Headings) -> list[int]:
        """Packets come. Each arrival tells when the revolution may have begun, the earliest the best.

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
        self.packets += count
        for size, _ in blocks:
            if size > self.longest:
                self.longest, self.most_samples = size, wire.samples_in((Block(size, 1),))
        plain = headings.tolist() if isinstance(headings, np.ndarray) else headings
        behind = [((heading & HEADING_MASK) - self.began) % wire.full_turn for heading in plain]
        if self.packets == count and self.partial.carried is None:
            self.judged_at = behind[0]
        return behind

    def begin_with(self, first_at: int) -> None:
        """No packet has come before the first end of a sector: only samples that were carried over.

        Args:
            first_at: How far behind the seam the first packet begins.
        """
        if (carried := self.partial.carried) is None:
            return
        # The packet that crossed the seam ends where the first one begins, unless packets are missing between.
        arc, full_turn, count = float(first_at), self.wire.full_turn, len(carried)
        if self.gap and self.usual_samples:
            arc = count * full_turn / self.usual_samples
        if arc > full_turn - full_turn // RETREAT_PART:
            arc = 0.0
        lost = self.partial.lost_before + self.partial.lost_behind_carried
        self.decoded = Decoded(None, carried, (), lost, 0, last=0, last_samples=count, last_arc=arc)

    def take(self, packets: Packets, samples: Samples, room: int, next_at: int) -> None:
        """Take all packets so far, decoded: judge whether they are certain, and when the first sample came.

        Args:
            packets: The packets.
            samples: The same, decoded.
            room: How many samples were carried over; the first elements of the arrays.
            next_at: How far behind the seam the packet behind them begins.
        """
        partial, full_turn, ends = self.partial, self.wire.full_turn, samples.ends
        arrays = SampleArrays(samples.angle_deg, samples.distance_mm, samples.intensity)
        if partial.carried is not None:
            arrays.begin_with(partial.carried)
        last_samples, arc = ends[-1] - (ends[-2] if len(ends) > 1 else 0), float(next_at - self.latest) % full_turn
        if samples.certain:
            self._judge(packets, samples, room, next_at)
            if samples.lost_behind and self.usual_samples:
                arc = last_samples * full_turn / self.usual_samples
        else:
            self.certain &= self.wire.own_angles
        self.gap |= bool(samples.lost)
        lost = partial.lost_before + partial.lost_behind_carried + samples.lost - samples.lost_behind
        gaps = partial.gaps(samples, room, len(arrays), revoked=False) or ()
        self.decoded = Decoded(samples, arrays, gaps, lost, samples.lost_behind, self.latest, last_samples, arc)

    def _judge(self, packets: Packets, samples: Samples, room: int, next_at: int) -> None:
        skipped_before = self.partial.skipped_behind_carried
        skipped = skipped_before + sum([each for _, each in samples.gaps])
        measured, turned = room + samples.ends[-1] + skipped, (next_at - self.judged_at) / self.wire.full_turn
        if turned > 0:
            # The speed is that of the packets since the last time.
            self.usual_samples = (measured - self.measured) / turned
        self.sample_ns, self.by_speed_ns = samples.sample_ns or self.sample_ns, samples.sample_ns
        found = begins_of(packets, samples, room + skipped_before, self.sample_ns)
        self.first_ns = min(self.first_ns, *found)
        # If whole revolutions passed unseen, these packets belong to another one, as in `EndedRevolution`.
        turn_ns = self.usual_ns or self.usual_samples * self.sample_ns
        gap = self.gap or samples.lost > samples.lost_behind
        self.certain &= not (turn_ns and hides_a_turn(found[-1] - self.first_ns, turn_ns, gap=gap))
        # If half a turn more is missing than the angles passed, they fell back: a part of another revolution is
        # among the packets.
        missing = skipped - samples.skipped_behind
        passed = (next_at - (self.decoded.last if self.decoded else 0)) / self.wire.full_turn
        self.certain &= missing - self.missing <= (passed + 0.5) * samples.last.samples
        # Time shows whether the rotor turns faster for a whole revolution, but not for a few packets.
        self.certain &= not (self.doubted and may_be_faster(samples))
        self.judged_at, self.measured, self.missing = next_at, measured, missing

    def end(self, packets: Packets, samples: Samples, room: int, following: bytes) -> None:
        """The revolution has ended: take all its packets, as `take`.

        Args:
            packets: The packets.
            samples: The same, decoded. Where sectors had other angles, they get these.
            room: How many samples were carried over.
            following: The packet behind it.
        """
        wire, first = self.wire, Packets(following, (Block(len(following), 1),), ((1, 0),))
        behind = ((int(wire.headings(first)[0]) & HEADING_MASK) - self.began) % wire.full_turn
        self.take(packets, samples, room, wire.full_turn + behind)
        if self.certain and self.angles and not samples.is_steady:
            samples.angle_deg[: self.given] = np.concatenate(self.angles)
        here, end = self.decoded, room + samples.last.before_seam
        assert here is not None
        if over := len(here.arrays) - end:
            # The samples behind the seam, and the gap behind them, belong to the next revolution.
            here.arrays, here.over, here.lost_behind = here.arrays.part(0, end), over, 0

    def give(self, end: int) -> None:
        """Hand out the samples up to the next end of a sector, which lies so far behind the seam."""
        self.at += 1
        if (here := self.decoded) is None:
            return
        count = len(here.arrays)
        upto = count if self.at == len(self.ends) else here.before(end)
        if upto > self.given:
            self.angles.append(here.arrays.angle[self.given : upto])
            self.given = upto
        # The packets missing behind the last one belong to the sector that ends with it.
        self.lost = here.lost + (here.lost_behind if upto == count else 0)

    def placed(self, done: OpenSector, start_ns: int) -> tuple[int, list[tuple[int, int]]]:
        """When the first sample of a sector was measured, and where samples are missing in the sector.

        Args:
            done: The sector, whose end the rotor has passed.
            start_ns: When the first sample of the revolution was measured.
        """
        assert self.decoded is not None
        before, inside = done.begin, list[tuple[int, int]]()
        for at, skipped in self.decoded.gaps:
            if at <= done.begin:
                before += skipped
            elif at < self.given:
                inside.append((at - done.begin, skipped))
        stamp_ns = start_ns + round(before * self.sample_ns)
        if (last := done.last) is not None:
            less = round((last.stamp_ns + last.duration_ns - stamp_ns) / self.sample_ns)
            if inside and less >= self.most_samples:
                # It would begin before the sector before it ended, by a packet or more: less is missing in the gap.
                at, skipped = inside[0]
                less = min(skipped, less)
                inside[0], stamp_ns = (at, skipped - less), stamp_ns + round(less * self.sample_ns)
            stamp_ns = max(stamp_ns, last.stamp_ns)
        return stamp_ns, inside


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
