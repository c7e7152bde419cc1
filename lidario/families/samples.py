"""What a family's decoder takes and gives: the samples of one revolution, or of several without a gap."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple, Protocol, Self

import numpy as np
from numpy.typing import NDArray

from lidario.wire.events import Packets


class DecodedRevolution(NamedTuple):
    """What its packets tell of one revolution, or of a part of one."""

    before_seam: int  # samples up to where the rotor passed the seam in its last packet; all where it did not
    packets: float  # how many packets a whole one has at the present speed; 0 when that is not known
    samples: float  # the same, samples
    reported_rpm: float = math.nan  # the speed that they tell, revolutions a minute; NaN where they tell none


# Not frozen: with so many fields that would cost as much as a call of numpy, once a revolution.
@dataclass(slots=True, eq=False)
class Samples:
    """The decoded packets of one stretch of stream; arrays of shape (room + n,), in measuring order."""

    # Where the beam went, float32 degrees clockwise, in [0, 360); corrections applied.
    angle_deg: NDArray[np.float32]
    distance_mm: NDArray[np.float32]  # millimetres, float32; 0 where nothing came back
    intensity: NDArray[np.uint8] | None  # uint8, or None where the format carries none
    ends: Sequence[int]  # samples up to and including each packet, shape (packets,), without the free elements
    revolutions: Sequence[DecodedRevolution]  # each of them; one, unless several were decoded together
    lost: int  # packets missing between these ones and before the one that follows
    unbroken: int  # leading packets before the first gap
    lost_behind: int = 0  # how many of the lost ones stood behind the last packet
    # Whether the angle that a packet covers is known for sure. Where it is not, as when nearly all packets are
    # missing, neither the angles nor `lost` can be relied on.
    certain: bool = True
    # Where packets are missing: how many of these samples come before, and how many samples are missing there, by
    # the angles of the rotor, which no correction has moved.
    gaps: Sequence[tuple[int, int]] = ()
    # How many packets are missing behind each of so many before these, which were told to follow each other, as
    # time tells now; ``(1, 0)`` where only what the last one measured is not to be used.
    revoked: tuple[int, int] = (0, 0)
    # Whether all headings are as far apart as packets are, or a whole number of them: where not, a turn may have
    # passed unseen.
    fits: bool = True
    # How long each of them took, nanoseconds, where the device measures at angles and tells its speed; 0 where that
    # is the same at any speed.
    sample_ns: float = 0.0

    @property
    def last(self) -> DecodedRevolution:
        """The last revolution, or the only one."""
        return self.revolutions[-1]

    @property
    def skipped_behind(self) -> int:
        """Samples that are missing behind the last packet."""
        return self.gaps[-1][1] if self.gaps and self.gaps[-1][0] == self.ends[-1] else 0

    @property
    def is_steady(self) -> bool:
        """Whether the speed is known, nothing is missing in them or before them, and all take the same time."""
        odd = self.lost or self.revoked[0] or self.sample_ns or not (self.certain and self.fits)
        return not odd and self.revolutions[-1].samples > 0


class Decoder(Protocol):
    """Turns packets into samples; one object follows one stream, in order. By default it remembers nothing."""

    def decode(self, packets: Packets, following: bytes | None, room: int = 0, seam: int | None = None) -> Samples:
        """Decode packets that follow each other.

        Args:
            packets: At least one packet.
            following: The packet after the last one, since some formats need it to know how far the rotor
                turned; None when there is none, and the last packet is then decoded with the step of its
                neighbours.
            room: Elements to leave at the front of the arrays, for samples the caller has already: filling them
                in is cheaper than joining arrays.
            seam: Heading at which the revolution ends, so that `DecodedRevolution.before_seam` can be told; None
                where no packet lies across its end.
        """
        ...

    def tell_time(self, sample_ns: float, *, passes: bool = True) -> None:  # noqa: ARG002
        """Take note of how long a sample takes, before the first packet.

        Args:
            sample_ns: In nanoseconds; 0 where the device does not say.
            passes: Whether time goes on while packets are missing. In a file of bytes it does not: there times are
                made of what came.
        """
        return

    def fork(self) -> Self:
        """Another decoder, which goes on from here without changing what this one remembers."""
        return self

    def decode_several(
        self,
        packets: Packets,  # noqa: ARG002
        following: bytes,  # noqa: ARG002
        ends: Sequence[int],  # noqa: ARG002
        room: int,  # noqa: ARG002
        seam: int | None,  # noqa: ARG002
    ) -> Samples | None:
        """Decode several revolutions at once, where nothing is missing; None where something may be.

        The samples are those that `decode` makes of one revolution after the other, to the last bit. Where there
        are none, nothing is remembered.

        Args:
            packets: The packets of all revolutions.
            following: The packet after the last one.
            ends: Packets up to the end of each revolution.
            room: As for `decode`.
            seam: As for `decode`, of each revolution.
        """
        return None
