"""A revolution in the making that is divided: what of it was decoded, what was handed out, and what waits.

Plain state and arithmetic; `lidario.revolution.sectors` leads it from packet to packet.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from typing import Final

import numpy as np

from lidario.families.base import Decoder, Samples
from lidario.revolution.ended import hides_a_turn
from lidario.revolution.partial import PartialRevolution, SampleArrays
from lidario.revolution.timing import begins_of
from lidario.wire.blocks import Block, some_blocks
from lidario.wire.events import Packets
from lidario.wire.formats import HEADING_MASK, Headings, StreamFormat

ROUNDING: Final = 1e-9
"""Much less than a packet, and more than what rounding makes of a whole number."""
RETREAT_PART: Final = 12
"""Headings may tremble back by this part of 360 degrees, a twelfth, as in `Seam`."""


@cache
def ends_of(full_turn: int, parts: tuple[int, ...]) -> tuple[tuple[int, tuple[int, ...]], ...]:
    """Where sectors end before the seam: angles behind it in heading units, and the parts that end there."""
    found: dict[int, list[int]] = {}
    for count in parts:
        for number in range(1, count):
            found.setdefault(-(-full_turn * number // count), []).append(count)
    return tuple((end, tuple(found[end])) for end in sorted(found))


@dataclass(slots=True)
class OpenSector:
    """A sector in the making, of one size.

    Attributes:
        index: Which one.
        begin: Samples of the revolution before it.
        lost: Packets of the revolution that were lost before it.
        first: Number of the first of its pieces.
    """

    index: int = 0
    begin: int = 0
    lost: int = 0
    first: int = 0


class DividedRevolution:
    """The revolution in the making, as far as it was divided.

    Attributes:
        partial: What is known of it.
        began: Heading at which it began.
        ends: Where sectors end before the seam, ascending; `at` is the next one.
        open: The sectors in the making, by how many a revolution has.
        decoder: Decodes its pieces.
        offset_deg: Zero-angle offset of all its sectors.
        waiting: Packets that were not decoded.
        waiting_at: How far behind the seam the last of them begins.
        rest: Samples that were decoded and belong to no sector yet.
        decoded: What was decoded so far.
        pieces: The samples before `rest`, those that were carried over first, divided where a sector ends.
        passed: How far behind the seam the headings have come.
        last: How far behind the seam the last packet that was decoded begins.
        last_samples: Its samples.
        last_arc: How far the rotor turned during it.
        given: Samples in these pieces.
        lost: Packets known to be missing so far.
        gaps: Where samples are missing so far: how many came before, and how many are missing there.
        lost_behind: Those that are missing behind the last packet that was decoded, and belong to no sector yet.
        samples: Samples that have come.
        longest: Bytes of the longest packet.
        most_samples: Its samples.
        bytes: The length of their packets.
        packets: How many they are.
        first_ns: Earliest estimate of when the first sample arrived; infinite when there is none.
        gap: Whether a gap is known, so that the number of samples tells no time any more.
        certain: Whether the angles of all that was decoded are, and no turn passed unseen among it.
        seq: Its number, once told.
        unseen: Revolutions before it that were counted as missing when that was told.
    """

    def __init__(self, partial: PartialRevolution, began: int, decoder: Decoder, offset_deg: float) -> None:
        self.partial = partial
        self.began = began
        self.ends: Sequence[tuple[int, tuple[int, ...]]] = ()
        self.at = 0
        self.open: dict[int, OpenSector] = {}
        self.decoder = decoder
        self.offset_deg = offset_deg
        self.waiting: list[Packets] = []
        self.waiting_at: int = 0
        self.rest: SampleArrays | None = partial.carried
        self.decoded: list[Samples] = []
        self.pieces: list[SampleArrays] = []
        self.passed: int = 0
        self.last: int = 0
        self.samples: int = 0 if partial.carried is None else len(partial.carried)
        self.last_samples: int = self.samples
        self.last_arc: float = 0.0
        self.given: int = 0
        self.lost: int = partial.lost_behind_carried
        self.lost_behind: int = 0
        self.gaps: list[tuple[int, int]] = []
        if partial.skipped_behind_carried:
            self.gaps.append((self.samples, partial.skipped_behind_carried))
        self.bytes: int = 0
        self.packets: int = 0
        self.longest: int = 0
        self.most_samples: int = 0
        self.first_ns: float = math.inf
        self.gap: bool = partial.carried is not None and partial.lost_behind_carried > 0
        self.certain: bool = True
        self.seq: int | None = None
        self.unseen = 0

    def upto(self, end: int) -> int:
        """How many samples of `rest` were measured before the rotor passed `end`, by the last packet's arc."""
        if self.rest is None:
            return 0
        inside = self.last_samples
        if self.last_arc > 0:
            inside = min(inside, math.ceil((end - self.last) * self.last_samples / self.last_arc - ROUNDING))
        return max(0, len(self.rest.angle) - self.last_samples + max(0, inside))

    def date(self, packets: Packets, wire: StreamFormat, sample_ns: float) -> None:
        """Take note of when packets came: each tells when the revolution began, the least delayed one best."""
        all_samples = wire.samples_in(packets.blocks)
        # Behind a gap the number of samples since the beginning is not known exactly.
        if not self.gap or math.isinf(self.first_ns):
            for count, at_ns in packets.arrivals:
                some = count < packets.count
                samples = wire.samples_in(some_blocks(packets.blocks, 0, count)) if some else all_samples
                self.first_ns = min(self.first_ns, at_ns - (self.samples + samples - 1) * sample_ns)
        self.samples += all_samples
        for size, _ in packets.blocks:
            if size > self.longest:
                self.longest, self.most_samples = size, wire.samples_in((Block(size, 1),))
        self.bytes += len(packets.data)
        self.packets += packets.count

    def take(
        self,
        packets: Packets,
        samples: Samples,
        next_at: int,
        wire: StreamFormat,
        sample_ns: float,
        usual_ns: float,
    ) -> None:
        """What waited was decoded to that, behind the samples that were left over before.

        Args:
            packets: What waited.
            samples: The samples.
            next_at: How far behind the seam the packet behind it begins.
            wire: The format.
            sample_ns: Nanoseconds a sample.
            usual_ns: What a revolution takes; 0 where that is not known.
        """
        arrays = SampleArrays(samples.angle_deg, samples.distance_mm, samples.intensity)
        earlier = self.given + (0 if self.rest is None else len(self.rest))
        if samples.certain:
            before = earlier + sum([skipped for _, skipped in self.gaps])
            found = begins_of(packets, samples, before, sample_ns)
            self.first_ns = min(self.first_ns, *found)
            # Where whole turns passed unseen, these packets belong to another revolution, as in `EndedRevolution`.
            unseen_ns, turn_ns = found[-1] - self.first_ns, usual_ns or samples.revolution_samples * sample_ns
            gap = self.gap or samples.lost > samples.lost_behind
            self.certain &= not (turn_ns and hides_a_turn(unseen_ns, turn_ns, gap=gap))
        if samples.gaps:
            self.gaps += [(earlier + before, skipped) for before, skipped in samples.gaps]
        if self.rest is not None:
            arrays.begin_with(self.rest)
        self.rest = arrays
        self.decoded.append(samples)
        self.waiting.clear()
        self.lost += self.lost_behind + samples.lost - samples.lost_behind
        self.lost_behind = samples.lost_behind
        self.gap |= samples.lost > 0
        self.certain &= samples.certain or wire.own_angles
        ends = samples.ends
        self.last, self.last_samples = self.waiting_at, ends[-1] - (ends[-2] if len(ends) > 1 else 0)
        self.last_arc = (next_at - self.last) % wire.full_turn
        if samples.certain and samples.revolution_samples and samples.lost_behind:
            self.last_arc = self.last_samples * wire.full_turn / samples.revolution_samples

    def give(self, upto: int) -> None:
        """Divide the rest: so many samples of it belong to every sector in the making."""
        if self.rest is None:
            return
        piece, self.rest = self.rest.part(0, upto), self.rest.part(upto)
        self.given += upto
        if not len(self.rest.angle):
            # What is missing behind the last packet belongs to the sector that ends with it.
            self.lost, self.lost_behind = self.lost + self.lost_behind, 0
        if upto:
            self.pieces.append(piece)


def away_of(headings: Headings, began: int, full_turn: int) -> list[int]:
    """How far behind the beginning of the revolution each heading is."""
    plain = headings.tolist() if isinstance(headings, np.ndarray) else headings
    return [((heading & HEADING_MASK) - began) % full_turn for heading in plain]


def join_pieces(pieces: Sequence[SampleArrays]) -> SampleArrays:
    """Samples that follow each other, in arrays of their own."""
    intensities = [piece.intensity for piece in pieces if piece.intensity is not None]
    return SampleArrays(
        np.concatenate([piece.angle for piece in pieces]),
        np.concatenate([piece.distance for piece in pieces]),
        np.concatenate(intensities) if intensities else None,
    )


def sum_of(pieces: Sequence[Samples]) -> Samples:
    """What pieces of a revolution tell together, where nothing is missing among them: the last one, changed.

    The arrays stay the last's. So does the time of a sample: where packets tell it, it is that of the revolution
    before their end.
    """
    ends, packets = list[int](), 0
    turns = sample_turns = told = told_rpm = 0.0
    for piece in pieces:
        count, before = len(piece.ends), ends[-1] if ends else 0
        ends += [before + end for end in piece.ends]
        packets += count
        turns += count / piece.revolution_packets
        sample_turns += piece.ends[-1] / piece.revolution_samples
        if not math.isnan(piece.reported_rpm):
            told, told_rpm = told + count, told_rpm + count * piece.reported_rpm
    found = pieces[-1]
    found.ends, found.unbroken = ends, packets
    found.revolution_packets, found.revolution_samples = packets / turns, ends[-1] / sample_turns
    found.reported_rpm = told_rpm / told if told else math.nan
    return found
