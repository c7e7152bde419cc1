"""The interface of a family's decoder: it makes samples of the packets of one revolution, or of several."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple, Protocol, Self

import numpy as np
from numpy.typing import NDArray

from lidario.wire.events import Packets


class DecodedRevolution(NamedTuple):
    """What packets tell of one revolution, or of a part of one."""

    before_seam: int  # samples up to where the rotor passed the seam in the last packet; all if it did not
    packets: float  # packets of a whole revolution at the present speed; 0 if unknown
    samples: float  # samples of a whole revolution at the present speed; 0 if unknown
    reported_rpm: float = math.nan  # the speed that packets report, revolutions a minute; NaN if they report none


# Not frozen: with so many fields, a frozen one would cost as much as a call of numpy, once a revolution.
@dataclass(slots=True, eq=False)
class Samples:
    """The decoded packets of one stretch of stream; arrays of shape (room + n,), in measuring order."""

    angle_deg: NDArray[np.float32]  # angles, float32 degrees clockwise, in [0, 360); corrections applied
    distance_mm: NDArray[np.float32]  # millimetres, float32; 0 where nothing came back
    intensity: NDArray[np.uint8] | None  # uint8, or None where the format carries none
    ends: Sequence[int]  # samples up to and including each packet, shape (packets,), without the free elements
    revolutions: Sequence[DecodedRevolution]  # each revolution; one, unless several were decoded together
    lost: int  # packets missing between these packets and before the one that follows
    unbroken: int  # how many packets come before the first gap
    lost_behind: int = 0  # how many of the `lost` packets are missing behind the last packet
    # Whether the angle that a packet covers is known for sure. If it is not, for example because nearly all packets
    # are missing, neither the angles nor `lost` can be relied on.
    certain: bool = True
    # Where packets are missing: how many of these samples come before, and how many samples are missing there, by
    # the angles of the rotor before any correction.
    gaps: Sequence[tuple[int, int]] = ()
    revoked: tuple[int, int] = (0, 0)  # a correction of earlier results, as `Arcs.revoked`
    fits: bool = True  # as `Arcs.fits`: if not, a revolution may have passed unseen
    # Nanoseconds of a sample, if the device measures at angles and tells its speed; 0 if the time is the same at
    # any speed.
    sample_ns: float = 0.0

    @property
    def last(self) -> DecodedRevolution:
        """The last revolution, or the only one."""
        return self.revolutions[-1]

    @property
    def skipped_behind(self) -> int:
        """How many samples are missing behind the last packet."""
        return self.gaps[-1][1] if self.gaps and self.gaps[-1][0] == self.ends[-1] else 0

    @property
    def is_steady(self) -> bool:
        """Whether the speed is known, nothing is missing in or before these samples, and all take the same time."""
        odd = self.lost or self.revoked[0] or self.sample_ns or not (self.certain and self.fits)
        return not odd and self.revolutions[-1].samples > 0


class Decoder(Protocol):
    """Turns packets into samples; one object follows one stream, in order. By default it remembers nothing."""

    def decode(self, packets: Packets, following: bytes | None, room: int = 0, seam: int | None = None) -> Samples:
        """Decode packets that follow each other.

        Args:
            packets: At least one packet.
            following: The packet after the last one: some formats need it to know how far the rotor turned. With
                None, the last packet is decoded with the step of its neighbours.
            room: Elements to leave free at the front of the arrays, for samples the caller has already: filling
                them in is cheaper than joining arrays.
            seam: Heading at which the revolution ends, for `DecodedRevolution.before_seam`; None if no packet lies
                across its end.
        """
        ...

    def tell_time(self, sample_ns: float, *, passes: bool = True) -> None:  # noqa: ARG002
        """Take note of how long a sample takes, before the first packet.

        Args:
            sample_ns: Nanoseconds a sample; 0 if the device does not say.
            passes: Whether time goes on while packets are missing. In a file of bytes it does not: there, times are
                made of the packets that came.
        """
        return

    def fork(self) -> Self:
        """An independent copy of the decoder, which goes on from here."""
        return self

    def is_whole(self, packets: Packets, following: bytes) -> bool:  # noqa: ARG002
        """Whether nothing is missing among packets, up to the packet `following`, as `decode_several` would find.

        Quicker than decoding them. Nothing is remembered.
        """
        return False

    def decode_several(
        self,
        packets: Packets,  # noqa: ARG002
        following: bytes,  # noqa: ARG002
        ends: Sequence[int],  # noqa: ARG002
        room: int,  # noqa: ARG002
        seam: int | None,  # noqa: ARG002
    ) -> Samples | None:
        """Decode several revolutions at once if nothing is missing; None if something may be.

        The samples are those that `decode` makes of one revolution after the other, to the last bit. With None,
        nothing is remembered.

        Args:
            packets: The packets of all revolutions.
            following: The packet after the last one.
            ends: Packets up to the end of each revolution.
            room: As for `decode`.
            seam: As for `decode`, for each revolution.
        """
        return None
