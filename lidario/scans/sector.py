"""A part of a revolution, as a user gets it before the revolution is whole.

The convention of angles, and everything that the arrays mean, is that of `lidario.scans.scan`.
"""

import math
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from lidario.basics.words import counted
from lidario.scans.measured import MeasuredSamples
from lidario.scans.plain import plain_of
from lidario.scans.rotor import Rotor

_PLAIN: Final = (
    "seq", "index", "degrees", "stamp_ns", "wall_stamp_ns", "time_increment_ns", "duration_ns", "rpm", "mode",
    "max_range", "dropped_before", "lost_packets", "angles", "ranges", "intensities",
)  # fmt: skip


@dataclass(frozen=True, eq=False, repr=False)
class Sector(MeasuredSamples):
    """A part of one revolution, its samples in the order they were measured. All arrays are read-only, shape (n,).

    Sector ``index`` holds what was measured while the rotor turned from ``index * degrees`` to
    ``(index + 1) * degrees``, clockwise from the angle where the revolution began, or the other way where the rotor
    turns so. Formats that correct angles by the distance may show samples a few degrees outside. The sectors of a
    revolution together hold the samples of its `Scan`, each exactly once.

    What is missing can be told from `seq` and `index`: they name every sector in order, so a step of more than one
    is a sector that did not come.

    Attributes:
        device_angles: As `Scan.device_angles`.
        device_distances: As `Scan.device_distances`.
        intensities: As `Scan.intensities`.
        stamp_ns: When the first sample was measured, on the monotonic clock of the event loop. It rests on the
            packets that have come so far; the stamp of the `Scan` rests on all of them, and so may be a little
            earlier. That of the next sector is never before it.
        wall_stamp_ns: The same instant in nanoseconds since the Unix epoch. Where the clock is set while a stream
            runs, it goes on by the new time; in a recording, by that with which the recording began.
        time_increment_ns: Time from one sample to the next.
        duration_ns: Time from the first sample to the end of the sector.
        rpm: Speed of the rotor during the sector, revolutions a minute, by its angles; NaN where they do not tell.
        seq: Number of the revolution: that of its `Scan`.
        index: Which part of the revolution, from 0.
        degrees: Size of a sector, as it was asked for.
        dropped_before: Sectors this reader missed since the one before, because it was slow.
        lost_packets: Packets that were damaged or lost on the wire since the sector before, of this revolution.
        mode: Name of the scan mode.
        max_range: As `Scan.max_range`.
        field_of_view: As `Scan.field_of_view`.
    """

    index: int
    degrees: float
    dropped_before: int
    lost_packets: int
    mode: str
    max_range: float = 0.0
    field_of_view: float = 360.0

    def __repr__(self) -> str:
        hits = int(np.count_nonzero(self.device_distances))
        return (
            f"<Sector {self.seq}.{self.index}: {counted(len(self), 'sample')}, {counted(hits, 'return')}, "
            f"{counted(self.lost_packets, 'packet')} lost, {counted(self.dropped_before, 'sector')} dropped before>"
        )

    @property
    def is_last(self) -> bool:
        """Whether the revolution ends with this sector."""
        return self.index == round(360.0 / self.degrees) - 1

    def to_dict(self) -> dict[str, Any]:
        """The sector as plain numbers and lists, for JSON: as `Scan.to_dict`."""
        return plain_of(self, _PLAIN)

    def _follow_rotor(self) -> Rotor | None:
        if math.isnan(self.rpm) or not len(self):
            return None
        return Rotor(float(self.device_angles[0]), 0.0, 60e9 / self.rpm, self.field_of_view)
