"""A revolution that has ended: its samples, gaps and times, and whether it is exactly one whole revolution."""

import math
from dataclasses import dataclass, field
from typing import Final

from lidario.families.base import Samples
from lidario.revolution.clock import NOISE, Beginning
from lidario.revolution.partial import PartialRevolution, SampleArrays
from lidario.wire.blocks import Block
from lidario.wire.events import Packets
from lidario.wire.formats import HEADING_MASK, StreamFormat

_WHOLE: Final = 0.9
"""If no angle shows a gap, a revolution passed unseen when a packet is late by more than this many revolutions."""
UNEVEN: Final = 1.5
"""A revolution with more than this many times the samples of one holds parts of two."""
_FEWEST_PACKETS: Final = 3
"""Without a sure speed, fewer packets are no proof of a revolution."""

FALSE_PART: Final = 0.5
"""If less than this part of a revolution lies between two splits, one of them was false. So there are never more
scans than revolutions."""

_ORDINARY: Final = 0.5
"""An ordinary packet has at least this part of the samples of the longest one. The last packet of a revolution may
be shorter, and a start packet is."""
_FIRST_PACKET: Final = 0.9
"""The first packet begins less than this many of its arcs behind the seam. If it begins later, the beginning of the
revolution was lost."""
_BEFORE_SEAM: Final = 1 / 12
"""Part of 360 degrees by which a heading may tremble back over the seam."""


# Not frozen: with so many fields, a frozen one would cost as much as a call of numpy, once a revolution.
@dataclass(slots=True, eq=False)
class EndedRevolution:
    """All that is known of a revolution when it has ended. It has no times until it is dated."""

    partial: PartialRevolution  # what was known of it before it ended
    packets: Packets  # its packets
    samples: Samples  # the packets, decoded
    arrays: SampleArrays  # its own samples, from the seam at its beginning to the seam at its end; at least one
    lost: int  # packets that are missing in it
    gaps: list[tuple[int, int]] | None  # where its own samples are missing, as `PartialRevolution.gaps` tells it
    # Missing packets just before its first one, found only after the samples before them were carried over.
    revoked: int
    start_ns: int = field(init=False)  # when its first sample was measured
    sample_ns: float = field(init=False)  # nanoseconds a sample
    spanned_ns: float = field(init=False)  # time of its samples, with those that are known to be missing
    # Whether the device says how long a sample takes. If not, it is measured, and `spanned_ns` proves nothing.
    told: bool = field(init=False)
    # Time of a whole revolution; NaN or 0 unless the times of other revolutions confirm it.
    revolution_ns: float = field(init=False, default=math.nan)

    @property
    def count(self) -> int:
        """How many samples came of it."""
        return len(self.arrays.angle)

    @property
    def elapsed_ns(self) -> int:
        """Time from its first sample to the arrival of its last packet; it must be dated."""
        return self.partial.last_ns - self.start_ns

    @property
    def turn_ns(self) -> float:
        """Time of a whole revolution, by the step of its angle; infinite if that is not sure."""
        samples = self.samples
        return samples.last.samples * self.sample_ns if samples.certain else math.inf

    @property
    def measured_sample_ns(self) -> float:
        """Time of a sample, measured from its own arrival times; it must be dated."""
        missing = self.missing_samples(gap_behind=False) if self.samples.certain else 0.0
        return self.elapsed_ns / (self.count + missing)

    def missing_samples(self, *, gap_behind: bool) -> float:
        """How many samples are missing in it.

        Args:
            gap_behind: Whether the packets missing behind its last one belong to it.
        """
        samples = self.samples
        behind = samples.skipped_behind if gap_behind and samples.certain else 0
        return _samples_of(samples, self.lost, sum([each for _, each in self.gaps or ()]) + behind)

    def is_broken(self, wire: StreamFormat, ordinary_ns: float) -> bool:
        """Whether its angles may be wrong, or parts of two revolutions may have met in it; it must be dated.

        Args:
            wire: The format.
            ordinary_ns: Time of the revolution before.
        """
        samples = self.samples
        # Without the packets missing behind its last one: their time has not passed when that one comes.
        lost = self.partial.lost_behind_carried + self.revoked + samples.lost - samples.lost_behind
        passed = self.count + _samples_of(samples, lost, sum([each for _, each in self.gaps or ()]))
        # The time of the packets missing behind its last one passed after that one was read. If less passed then,
        # the rest passed before: the read came late by it.
        partial, read_ns = self.partial, self.partial.last_ns
        waited_ns = samples.skipped_behind * self.sample_ns - (max(partial.ended_ns, read_ns) - read_ns)
        late_ns = self.elapsed_ns - passed * self.sample_ns - max(0.0, waited_ns)
        if hides_a_turn(late_ns, ordinary_ns, gap=bool(lost) or not samples.fits):
            return True
        if not samples.certain:
            return not wire.own_angles or self.packets.count < _FEWEST_PACKETS
        # More than one revolution by its angles: at the seam they went back so little that it looked like jitter.
        return passed > UNEVEN * samples.last.samples

    def least_ns(self, wire: StreamFormat, usual_ns: float) -> float:
        """Time that must have passed if this is more than a part of a revolution; 0 if enough of it came.

        It must be dated.

        Args:
            wire: The format.
            usual_ns: Time of a revolution, by those before; 0 if unknown.
        """
        if wire.first_seam is None:
            # Only marks tell where revolutions begin, and a check value keeps false marks away.
            return 0.0
        samples = self.samples
        if not samples.certain:
            return FALSE_PART * usual_ns
        least_ns = FALSE_PART * self.turn_ns
        # The part missing at its beginning counts too: it was lost.
        came_ns = self.spanned_ns + share_before(wire, self.partial, samples) * self.turn_ns
        return 0.0 if came_ns >= least_ns else least_ns

    def beginning(self, wire: StreamFormat, *, broken: bool, number: int, packets_before: int) -> Beginning:
        """The `Beginning` by which `RevolutionClock` counts it; it must be dated. The arguments are as there."""
        packets, samples = self.packets, self.samples
        packet_ns, ordinary = packet_time(wire, packets, samples, self.sample_ns)
        over = share_before(wire, self.partial, samples)
        longest = wire.samples_in((Block(wire.longest, 1),))
        # If the device tells no sample time, packets that came at one moment seem to have taken none.
        is_one = self.told and samples.certain and abs(self.spanned_ns / self.turn_ns - (1 - over)) < NOISE
        return Beginning(
            self.start_ns,
            over=over,
            revolution_ns=self.turn_ns if samples.certain else 0.0,
            packet_ns=packet_ns,
            packets=packets.count,
            lost=samples.lost,
            broken=broken,
            number=number,
            packets_before=packets_before,
            ordinary=ordinary,
            own=wire.own_angles and longest > 1 and packets.count >= _FEWEST_PACKETS,
            spanned_ns=self.spanned_ns if is_one else 0.0,
            came_ns=self.count * self.sample_ns if self.told else 0.0,
            read_ns=self.partial.read_ns,
            silences_ns=self.partial.silences_ns(packets, packet_ns),
        )


def hides_a_turn(late_ns: float, turn_ns: float, *, gap: bool) -> bool:
    """Whether a revolution passed unseen, since a packet came so much later than the angles explain.

    A read may be late by much of a revolution. If a `gap` is known, a whole one more likely hides in it.
    """
    return late_ns > (1 - NOISE if gap else _WHOLE) * turn_ns


def _samples_of(samples: Samples, lost: int, skipped: int) -> float:
    """How many samples the `lost` packets held; by the angles at least `skipped` are missing."""
    # Damage spares short packets: a missing one may have held far more samples than the mean of those that came.
    return max(lost * samples.ends[-1] / len(samples.ends), skipped)


def packet_time(wire: StreamFormat, packets: Packets, samples: Samples, sample_ns: float) -> tuple[float, bool]:
    """Time of a packet, and whether an ordinary one came: as in `Beginning`."""
    most = wire.samples_in((Block(wire.ordinary, 1),))
    longest = wire.samples_in((Block(max([size for size, _ in packets.blocks]), 1),))
    if wire.first_seam is None and longest < most * _ORDINARY:
        # Packets are short before a mark. Damage spares them, and these alone do not show the time of an ordinary
        # one. The longest is taken: so never more packets are counted as lost than were sent.
        return most * sample_ns, False
    last = samples.last
    return (last.samples / last.packets if samples.certain else longest) * sample_ns, True


def share_before(wire: StreamFormat, revolution: PartialRevolution, samples: Samples) -> float:
    """Share of the revolution that passed before its first packet; 0 if that is the first behind the seam."""
    if revolution.carried is not None or not revolution.behind_gap:
        return 0.0
    run = revolution.runs[0]
    over = share_past(wire, run.data[: run.blocks[0].size], revolution.seam or 0)
    return over if over * samples.last.packets > _FIRST_PACKET else 0.0


def share_past(wire: StreamFormat, packet: bytes, seam: int) -> float:
    """Share of a revolution by which a packet begins behind the seam; 0 if its heading trembled back over it."""
    heading = int(wire.headings(Packets(packet, (Block(len(packet), 1),), ((1, 0),)))[0]) & HEADING_MASK
    over = (heading - seam) % wire.full_turn / wire.full_turn
    return over if over < 1 - _BEFORE_SEAM else 0.0
