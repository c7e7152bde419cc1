"""How the rotor turned during a scan, and so when it stood at each angle.

The rotor turns evenly, so time is proportional to the angle that it has turned. The speed follows from the samples:
the typical angle between neighbours, divided by the time between them. It is not taken from the duration of the
scan: when packets at the seam are lost, a scan begins late, and the scan before it counts the missing time.

Where samples are missing, the number of each tells more than its angle: models that correct angles by the distance
move those of returns by several degrees, and the others by none.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Self, TypeAlias

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from lidario.scans.scan import Scan

Gaps: TypeAlias = Sequence[tuple[int, int]]
"""Where samples are missing: how many there are before, and how many are missing there."""

_SEAM_TOLERANCE_DEG = 0.5
"""How far a revolution may begin before the stated seam, or end behind it, and still be said to begin there.

Formats without a correction of the angle stay within one sample of it (0.45 degrees at 9200 samples a second and
10 Hz); formats with one begin 1.4 degrees before it or more.
"""

_MOST_BACKWARD_DEG = 90.0
"""A step back of at most this much is one of a corrected angle; what seems longer is a gap ahead, of up to 270
degrees."""
_MOST_BEFORE_SEAM_DEG = 30.0
"""A first sample at most this far before the seam belongs to the revolution that begins there: corrections move one
by less than 20 degrees."""
_FARTHEST_DEG = 40.0
"""How far apart corrections move two samples of a revolution at most: by less than 20 degrees, either way."""
_LAG_SHARE = 32
"""The speed is measured over a 32nd of the samples: enough to average out the rounding of the angles (1/64 degree),
and so few that a jump of a corrected angle disturbs few of the measurements."""
_LAG_SHARE_PER_GAP = 8
"""At most one measurement in this many contains a given gap, so that the middle half of them contains few."""


@dataclass(frozen=True, slots=True)
class Rotor:
    """How the rotor turned during a scan: evenly."""

    begin_deg: float  # device angle where the revolution begins, degrees clockwise
    # When the rotor passed that angle, nanoseconds after the first sample of the scan; negative where samples at
    # the begin are missing.
    begin_ns: float
    period_ns: float  # time of a full revolution, nanoseconds
    # How much of it the device sees, from `begin_deg` on, degrees; negative where the rotor turns
    # counter-clockwise.
    field_deg: float = 360.0

    def beginning_at(self, begin_deg: float) -> Self:
        """The same rotor, with the revolution taken to begin at another angle, the nearest one before or behind."""
        later_deg = math.copysign(1.0, self.field_deg) * before(begin_deg - self.begin_deg, 180.0)
        begin_ns = self.begin_ns + later_deg / 360.0 * self.period_ns
        return replace(self, begin_deg=begin_deg % 360.0, begin_ns=begin_ns)


def follow_rotor(
    device_angles: NDArray[np.floating],
    time_increment_ns: float,
    duration_ns: float,
    seam: float = 0.0,
    lost_packets: int = 0,
    gaps: Gaps | None = None,
) -> Rotor:
    """Find out where a revolution begins and how fast the rotor turned; the arguments are fields of `Scan`.

    Gaps are allowed, of lost packets or of samples that a user took out; where they are not known, the angles tell
    them. Where the angles tell a speed that differs from `duration_ns` by more than a factor of two, `duration_ns`
    decides. Where they do not rise, they are not in the order of measuring: the revolution is then taken to begin
    at `seam` with the first sample.
    """
    if not len(device_angles):
        return Rotor(seam % 360.0, 0.0, float(duration_ns))
    travelled = _travelled(device_angles)
    # One missing sample must not pass for none: the samples after it would be taken for one step too early.
    complete = not lost_packets and abs(duration_ns - len(travelled) * time_increment_ns) <= time_increment_ns / 2
    numbers = None if gaps is None and not complete else numbers_of(len(travelled), gaps or ())
    step, numbers = _step(travelled, numbers)
    if len(travelled) > 1 and step <= 0:
        return Rotor(seam % 360.0, 0.0, float(duration_ns))
    first = before(float(device_angles[0]) - seam, _MOST_BEFORE_SEAM_DEG)
    period_ns = 360.0 / step * time_increment_ns if step else 0.0
    if period_ns and not duration_ns / 2 <= period_ns <= duration_ns * 2:
        period_ns = 0.0
    if period_ns:
        # The first sample alone may be an exception: a close return, whose angle is corrected by many degrees.
        first += float(np.median(travelled - step * numbers))
        last = first + step * float(numbers[-1])
    else:
        period_ns = float(duration_ns)
        last = first + float(travelled[-1])
    if first >= -_SEAM_TOLERANCE_DEG and last <= 360.0 + _SEAM_TOLERANCE_DEG:
        return Rotor(seam % 360.0, -first / 360.0 * period_ns, period_ns)
    return Rotor((seam + first) % 360.0, 0.0, period_ns)


def rotor_of(scan: "Scan", gaps: Gaps | None) -> Rotor:
    """How the rotor turned during a scan, whose samples are in the order of measuring."""
    angles, time_increment_ns, seam, field_deg = (
        scan.device_angles, scan.time_increment_ns, scan.seam, scan.field_of_view,
    )  # fmt: skip
    if abs(field_deg) != 360.0:
        # A whole scan of evenly spaced samples; each stands in the middle of its share of the field.
        period_ns = 360.0 / abs(field_deg) * len(angles) * time_increment_ns
        return Rotor(seam, -time_increment_ns / 2, period_ns, field_deg)
    if field_deg > 0:
        return follow_rotor(angles, time_increment_ns, scan.duration_ns, seam, scan.lost_packets, gaps)
    found = follow_rotor(_mirrored(angles), time_increment_ns, scan.duration_ns, -seam, scan.lost_packets, gaps)
    return Rotor(-found.begin_deg % 360.0, found.begin_ns, found.period_ns, field_deg)


def _mirrored(device_angles: NDArray[np.floating]) -> NDArray[np.floating]:
    mirrored: NDArray[np.floating] = -device_angles % 360.0
    return mirrored


def numbers_of(count: int, gaps: Gaps) -> NDArray[np.int64]:
    """The number of each sample, the missing ones counted; int64, shape (count,)."""
    numbers = np.arange(count, dtype=np.int64)
    for at, skipped in gaps:
        numbers[at:] += skipped
    return numbers


def times_of(
    device_angles: NDArray[np.floating], time_increment_ns: float, rotor: Rotor, gaps: Gaps | None
) -> NDArray[np.int64]:
    """When each sample of a scan with gaps was measured, nanoseconds after the first one; int64, shape (n,).

    Where the gaps are not known, the angles tell the times.
    """
    if gaps is not None:
        numbers = numbers_of(len(device_angles), gaps)
        times: NDArray[np.int64] = np.rint(numbers * time_increment_ns).astype(np.int64)
        return times
    if rotor.field_deg < 0:
        device_angles = _mirrored(device_angles)
        rotor = Rotor(-rotor.begin_deg % 360.0, rotor.begin_ns, rotor.period_ns)
    if not len(device_angles):
        return np.zeros(0, np.int64)
    degrees = turned(device_angles, rotor.begin_deg)
    return np.rint(rotor.begin_ns + degrees * (rotor.period_ns / 360.0)).astype(np.int64)


def before(degrees: float, most: float) -> float:
    """The same angle in [-most, 360 - most), degrees."""
    return (degrees + most) % 360.0 - most


def within_turn(degrees: NDArray[np.float64]) -> NDArray[np.float64]:
    """The same angles in [0, 360), as `%` has them, which takes much longer."""
    return degrees - 360.0 * np.floor(degrees / 360.0)


def turned(device_angles: NDArray[np.floating], begin_deg: float) -> NDArray[np.float64]:
    """Angle from the begin of the revolution to each sample, degrees, shape (n,), without jumps at 360."""
    return _travelled(device_angles) + before(float(device_angles[0]) - begin_deg, _MOST_BEFORE_SEAM_DEG)


def _travelled(device_angles: NDArray[np.floating]) -> NDArray[np.float64]:
    """Angle from the first sample to each sample, degrees, shape (n,), without jumps at 360."""
    travelled, steps = np.zeros(len(device_angles)), np.diff(device_angles.astype(np.float64))
    # A step is a forward one, up to a gap of three quarters, unless it goes back by less than a quarter.
    np.cumsum(within_turn(steps + _MOST_BACKWARD_DEG) - _MOST_BACKWARD_DEG, out=travelled[1:])
    return travelled


def _step(travelled: NDArray[np.float64], known: NDArray[np.int64] | None) -> tuple[float, NDArray[np.int64]]:
    """Degrees between neighbouring samples, and the number of each sample, the missing ones counted."""
    count = len(travelled)
    numbers = np.arange(count, dtype=np.int64) if known is None else known
    if count < 2:
        return 0.0, numbers
    steps = np.diff(travelled)
    gaps = int(np.count_nonzero(steps > 2.5 * np.median(steps))) if known is None else 0
    lag = max(1, min(count // _LAG_SHARE, count // (_LAG_SHARE_PER_GAP * (gaps + 1))))
    # The mean of the middle half: a median alone would keep the rounding of the angles.
    lagged = (travelled[lag:] - travelled[:-lag]) / (numbers[lag:] - numbers[:-lag])
    quarter = len(lagged) // 4
    middle = slice(quarter, len(lagged) - quarter)
    step = float(np.mean(np.partition(lagged, (middle.start, middle.stop - 1))[middle]))
    if step <= 0:
        return step, numbers
    if known is not None:
        # Where corrections cannot explain how angles differ from numbers, more or less is missing than that.
        agree = np.ptp(travelled - step * numbers) <= _FARTHEST_DEG
        return (step, numbers) if agree else _step(travelled, None)
    # Each step is a whole number of sample times. Corrected angles also jump back; both directions cancel.
    numbers[1:] = np.cumsum(np.rint(steps / step)).astype(np.int64)
    return (float(travelled[-1] / numbers[-1]) if numbers[-1] > 0 else 0.0), numbers
