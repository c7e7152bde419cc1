"""A revolution that has ended: its samples, what is missing in it, and its times, before it is judged."""

from __future__ import annotations

import math
from dataclasses import dataclass

from lidario.families.base import Samples
from lidario.revolution.partial import PartialRevolution, SampleArrays
from lidario.wire.events import Packets

__all__ = ["EndedRevolution"]


# Not frozen: with so many fields that would cost as much as a call of numpy, once a revolution.
@dataclass(slots=True, eq=False)
class EndedRevolution:
    """What is known of a revolution when it has ended. The times are 0 until it is dated.

    Attributes:
        partial: What was known of it before.
        packets: Its packets; None when it has none, only samples that were carried over.
        samples: What they were decoded to; None when it has none.
        arrays: Its own samples, from the seam at its beginning to the seam at its end; at least one.
        lost: Packets that are missing in it.
        gaps: Where its own samples are missing, as `PartialRevolution.gaps` tells it.
        revoked: Of the packets that are missing, those right before its first one that were not known to be missing
            when the samples before them were carried over (`PartialRevolution.revoke_carried`).
        start_ns: When its first sample was measured.
        elapsed_ns: Time from then to the arrival of its last packet.
        sample_ns: Nanoseconds a sample.
        spanned_ns: Time that its samples take, and those that are known to be missing.
        told: Whether the device says how long a sample takes. If not, it is measured: `spanned_ns` proves nothing.
    """

    partial: PartialRevolution
    packets: Packets | None
    samples: Samples | None
    arrays: SampleArrays
    lost: int
    gaps: list[tuple[int, int]] | None
    revoked: int = 0
    start_ns: int = 0
    elapsed_ns: int = 0
    sample_ns: float = 0.0
    spanned_ns: float = 0.0
    told: bool = True

    @property
    def count(self) -> int:
        """How many samples it has."""
        return len(self.arrays.angle)

    @property
    def by_speed_ns(self) -> float:
        """What each of its samples took, by the speed that its packets tell; 0 where they do not."""
        return 0.0 if self.samples is None else self.samples.sample_ns

    @property
    def turn_ns(self) -> float:
        """What a whole one takes, by the step of its angle; infinite where that is not sure."""
        samples = self.samples
        return samples.revolution_samples * self.sample_ns if samples and samples.certain else math.inf
