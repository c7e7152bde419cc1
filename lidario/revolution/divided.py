"""A revolution in the making that is divided: how far the rotor has come, and what was handed out.

Plain state and arithmetic; `lidario.revolution.sectors` leads it from packet to packet.
"""

from __future__ import annotations

import math
from dataclasses import InitVar, dataclass, field
from functools import cache
from typing import Final

from lidario.families.base import Samples
from lidario.revolution.partial import PartialRevolution, SampleArrays
from lidario.wire.blocks import Block
from lidario.wire.events import Packets
from lidario.wire.formats import StreamFormat

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
    lost: int = 0  # packets of the revolution that were told as lost before it
    after_ns: int = 0  # when the sector before it began


@dataclass(slots=True, eq=False)
class DividedRevolution:
    """The revolution in the making, as far as it was divided."""

    partial: PartialRevolution  # what is known of it
    began: int  # heading at which it began
    wire: StreamFormat  # the format of its packets
    parts: InitVar[tuple[int, ...]]  # how many sectors it is divided into, of each size
    usual_ns: float  # what a revolution takes; 0 where that is not known
    offset_deg: float  # zero-angle offset of all its sectors
    usual_samples: float = 0.0  # what it has, by the latest speed that was certain; 0 where that is not known
    by_speed_ns: float = 0.0  # nanoseconds a sample, where the speed decides that; else 0
    ends: tuple[tuple[int, tuple[int, ...]], ...] = ()  # where sectors end, as `ends_of`; `at` is the next one
    at: int = 0
    # The sectors in the making, by how many a revolution has.
    open: dict[int, OpenSector] = field(default_factory=dict)
    passed: int = 0  # how far behind the seam the headings have come
    last_at: int = 0  # how far behind the seam its latest packet begins
    packets: int = 0  # its packets that have come
    came: int = 0  # the samples of these, and those that were carried over
    longest: int = 0  # bytes of the longest packet
    most_samples: int = 0  # its samples
    # Its samples as they were decoded last, those that were carried over first.
    arrays: SampleArrays | None = None
    given: int = 0  # how many of them were handed out: the scan has the same
    samples: Samples | None = None  # what they were decoded to
    turns: float = 0.0  # how far the rotor turned during them, without those that were carried over
    last_samples: int = 0  # samples of the last packet of them
    last_begin: int = 0  # how far behind the seam that one begins
    last_arc: float = 0.0  # how far the rotor turned during it
    first_ns: float = math.inf  # earliest estimate of when its first sample arrived; infinite when there is none
    certain: bool = True  # whether the angles of all that was decoded are, and no turn passed unseen among it
    seq: int | None = None  # its number, once told
    unseen: int = 0  # revolutions before it that were counted as missing when that was told
    crossed: int = 0  # how many of its samples lie before the seam at its end; 0 until it has ended
    lost_past: int = 0  # of the packets that are missing behind its last one, those of the next revolution

    def __post_init__(self, parts: tuple[int, ...]) -> None:
        self.ends = ends_of(self.wire.full_turn, parts)
        self.open = {count: OpenSector() for count in parts}
        self.arrays = self.partial.carried
        if self.arrays is not None:
            self.came = self.last_samples = len(self.arrays)

    @property
    def room(self) -> int:
        """Samples that were carried over."""
        return 0 if self.partial.carried is None else len(self.partial.carried)

    @property
    def size(self) -> int:
        """Samples that were decoded."""
        return 0 if self.arrays is None else len(self.arrays)

    @property
    def has_gap(self) -> bool:
        """Whether a gap is known, so that the number of samples tells no time."""
        return self.partial.lost_behind_carried > 0 or (self.samples is not None and self.samples.lost > 0)

    def note(self, packets: Packets) -> None:
        """These have come."""
        self.packets += packets.count
        self.came += self.wire.samples_in(packets.blocks)
        for size, _ in packets.blocks:
            if size > self.longest:
                self.longest, self.most_samples = size, self.wire.samples_in((Block(size, 1),))

    def take(self, samples: Samples, next_at: int) -> None:
        """Take what its packets so far were decoded to; what was handed out stays as it was.

        Args:
            samples: That, behind room for those that were carried over.
            next_at: How far behind the seam the packet behind them begins.
        """
        arrays = SampleArrays(samples.angle_deg, samples.distance_mm, samples.intensity)
        if self.arrays is not None:
            arrays.begin_with(self.arrays.part(0, max(self.given, self.room)))
        ends, (_, _, usual, _) = samples.ends, samples.last
        self.last_begin, self.last_samples = self.last_at, ends[-1] - (ends[-2] if len(ends) > 1 else 0)
        self.last_arc = (next_at - self.last_begin) % self.wire.full_turn
        if samples.certain and usual:
            turns, before = ends[-1] / usual, 0 if self.samples is None else self.samples.ends[-1]
            # The speed of those that are new.
            self.usual_samples = (ends[-1] - before) / (turns - self.turns) if turns > self.turns else usual
            self.turns, self.by_speed_ns = turns, samples.sample_ns
            if samples.lost_behind:
                self.last_arc = self.last_samples * self.wire.full_turn / self.usual_samples
        self.arrays, self.samples = arrays, samples

    def upto(self, end: int) -> int:
        """How many of its samples lie before the end of a sector, by the arc of the last packet."""
        if self.crossed and end == self.wire.full_turn:
            return self.crossed
        inside = self.last_samples
        if self.last_arc > 0:
            by_arc = math.ceil((end - self.last_begin) * inside / self.last_arc - ROUNDING)
            inside = max(0, min(inside, by_arc))
        return max(self.given, min(self.size - self.last_samples + inside, self.crossed or self.size))

    def gaps(self) -> list[tuple[int, int]]:
        """Where samples are missing so far: how many came before, and how many are missing there."""
        behind, found = self.partial.skipped_behind_carried, list[tuple[int, int]]()
        if behind:
            found.append((self.room, behind))
        if self.samples is not None:
            found += [(self.room + before, skipped) for before, skipped in self.samples.gaps]
        return found

    def lost(self, upto: int) -> int:
        """Packets that are missing among so many of its samples."""
        found, samples = self.partial.lost_before + self.partial.lost_behind_carried, self.samples
        if samples is not None:
            # What is missing behind the last packet belongs to the sector that ends with it.
            found += samples.lost - (samples.lost_behind if upto < self.size else self.lost_past)
        return found
