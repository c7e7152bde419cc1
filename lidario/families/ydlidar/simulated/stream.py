"""What the simulated device measures, and how it divides it into packets.

The n-th sample is taken at ``origin + n * sample time`` (4ROS data sheet: 20000 a second), where the
motor points then, and the world says how far it is: functions of n alone. So a revolution is built in one step with
numpy, ahead of its time, however short the steps in which the device is asked for bytes.

The first sample past the seam, 0 degrees mostly, stands alone, in a start packet that tells the speed. Packets of
40 follow, and the last one before the next seam is shorter. What some models do otherwise their `Profile` tells.
Angles are truncated to 1/64 degree, so none reads as 360.

Some relatives send time stamp records between the packets (vendor SDK 1.2.20); no source tells how often. Where
they are asked for, one stands before each packet and tells when the first sample of the packet was taken.
"""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from lidario.families.ydlidar.simulated.packers import TIME_STAMP_BYTES, pack_points, pack_time_stamp, start_control
from lidario.families.ydlidar.simulated.profiles import Profile
from lidario.sim.motor import Motor
from lidario.sim.talker import within
from lidario.sim.world import CheckedWorld, World

_FULL_TURN_Q6 = 360 * 64
_LATE_OFF = 7
"""A packet of one sample that comes late states 0.27 degrees for its first sample, and 0.16 for its last: a real
Tmini Plus did (Ar-Ray-code/tmini_plus_emulator)."""
_LIGHT_SCALES = {10: 4, 16: 256}
"""By the bits of an intensity, what makes one of 0 to 250 fill them."""
_MOST_AHEAD = 6000  # samples: a revolution at 3.5 Hz


class Burst(NamedTuple):
    """Packets of one size, the first made at `ready`, the others `period` nanoseconds apart."""

    data: bytes
    ready: int
    size: int
    period: int


class PointStream:
    """One measurement stream, from `origin` on, in nanoseconds; the motor keeps its speed while it lasts."""

    def __init__(self, origin: int, motor: Motor, world: World | CheckedWorld, profile: Profile) -> None:
        self._origin = origin
        self._motor = motor
        self._world = world
        self._profile = profile
        self._sample_ns = profile.sample_ns
        self._next = 0
        self._at_seam = False

    @property
    def ready(self) -> int:
        """When the first sample not built yet will have been taken."""
        return self._origin + (self._next + 1) * self._sample_ns

    def until(self, now: int) -> Iterator[Burst]:
        """Build revolutions until they reach beyond `now`."""
        while self.ready <= now:
            yield from self._turn()

    def _turn(self) -> list[Burst]:
        """The packets from the next sample to the seam behind it, or as far as is sensible."""
        first, each, seam = self._next, self._profile.per_packet, self._profile.seam_deg / 360.0
        hertz = self._motor.rpm(self._origin + first * self._sample_ns) / 60.0
        count = min(int(1.05e9 / self._sample_ns / max(hertz, 1.0)) + 2 * each, _MOST_AHEAD)
        turns, times = self._motor.sampled(self._origin, first, count, self._sample_ns)
        revolution = int(np.floor(turns[0] - seam))
        behind = int(np.searchsorted(turns, revolution + 1.0 + seam))
        lone = int(self._at_seam)
        self._at_seam = behind < count - 1
        full = (min(behind, count) - lone) // each
        end = behind if self._at_seam else lone + full * each
        late = self._at_seam and self._profile.late_seam and revolution % self._profile.late_seam == 0
        self._next = first + end + late

        turns, times = turns[: end + late], times[: end + late]
        q6 = np.floor(turns * _FULL_TURN_Q6).astype(np.int64) % _FULL_TURN_Q6
        mm = self._world.ranges_mm(turns * 360.0, times * 1e-9)
        if self._profile.triangle:
            # What is measured lies beside the beam, by about the distance that the beam itself would have met.
            mm = self._world.ranges_mm(turns * 360.0 + _aside(mm), times * 1e-9)
        mm = within(mm, self._profile.reach_mm)
        bursts = []
        if lone:
            told = hertz if self._profile.tells_speed else 0.0
            bursts.append(self._burst(q6[:1], mm[:1], 1, first, start_control(told, self._profile.speed_base)))
        middle = slice(lone, lone + full * each)
        if full:
            bursts.append(self._burst(q6[middle], mm[middle], each, first + lone))
        if end > middle.stop:
            rest = slice(middle.stop, end)
            bursts.append(self._burst(q6[rest], mm[rest], end - middle.stop, first + middle.stop))
        if late:
            bursts.append(self._burst(q6[end:], mm[end:], 1, first + end, last_off=_LATE_OFF))
        return bursts

    def _burst(
        self,
        q6: npt.NDArray[np.int64],
        mm: npt.NDArray[np.float64],
        samples: int,
        first: int,
        control: int | None = None,
        last_off: int = 0,
    ) -> Burst:
        """Packets of `samples`, of which the first begins with sample number `first`.

        The angle that they state of their last sample is lower by `last_off`.
        """
        layout = self._profile.layout
        rows = mm.reshape(-1, samples)
        lights = np.where(rows > 0, np.clip(1000 - rows / 20, 40, 1000), 0) / 4 if layout.bits else 0
        data = pack_points(
            rows,
            q6[::samples],
            (q6[samples - 1 :: samples] - last_off) % _FULL_TURN_Q6,
            control=self._profile.control if control is None else control,
            layout=layout,
            intensities=np.asarray(lights * _LIGHT_SCALES.get(layout.bits, 1), np.uint16),
        )
        ready = self._origin + (first + samples) * self._sample_ns
        size, period = 10 + layout.size * samples, samples * self._sample_ns
        if self._profile.stamps:
            data = self._with_stamps(data, size, ready - period, period)
            size += TIME_STAMP_BYTES
        return Burst(data, ready, size, period)

    def _with_stamps(self, packets: bytes, size: int, began: int, period: int) -> bytes:
        """A time stamp record before each packet; the first sample of the first packet was taken at `began`."""
        count = len(packets) // size
        times = [(began + k * period) // 1_000_000 & 0xFFFFFFFF for k in range(count)]
        return b"".join(pack_time_stamp(time) + packets[k * size : (k + 1) * size] for k, time in enumerate(times))


def _aside(mm: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    """Degrees from the beam to the target, of a lens 21.8 mm aside (the vendor's SDK); 0 where there is none."""
    away = np.degrees(np.arctan2(21.8 * (155.3 - mm), 155.3 * np.maximum(mm, 1.0)))
    return np.where(mm > 0, away, 0.0)
