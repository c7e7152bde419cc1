"""What the simulated device measures, and how it packs it: one builder for each response type.

The n-th sample of a stream is taken at `origin + n * µs_per_sample`, where the motor points then, and the
world says how far it is. All three are functions of n alone, so a stretch of packets is built in one go
with numpy, ahead of its time, however short the steps in which the device is asked for bytes.

Angles in the capsule formats go in equal steps from one start angle to the next (S-series interface manual,
DenseBoost response). Two formats shift each sample by an amount of its own, which the host subtracts: 0x82
carries it, in 0x84 it follows from the distance (vendor SDK 2.1.0, ultra capsule unpacker). In 0x81 models that
triangulate do that themselves: a return has the angle at which it lies, a sample without one that of the beam
(users' transcripts of an A1M8, which agree with 0x84's formula). What 0x82 carries is taken to be the same: of an
A2 it was 7 degrees, and less of what is near (change 4 of Roboticia/RPLidar).

An A1M8 marks in 0x81 the sample before its beam passes 0: at 351.4 to 359.5 degrees, by the distance (cpane/heron).
"""

from collections.abc import Iterator

import numpy as np
import numpy.typing as npt

from lidario.families.rplidar.simulated import packers
from lidario.families.rplidar.simulated.profile import Mode
from lidario.sim.motor import Motor
from lidario.sim.world import CheckedWorld, World

Floats = npt.NDArray[np.float64]

_STRETCH = 4096  # samples built in one go: numpy's overhead is negligible, and it fits in the caches


class MeasurementStream:
    """One measurement stream, from `origin` on, in nanoseconds; the motor keeps its speed until `built_until`."""

    def __init__(
        self, mode: Mode, origin: int, motor: Motor, world: World | CheckedWorld, *, triangulates: bool = False
    ) -> None:
        self.mode = mode
        self._triangulates = triangulates
        self.size: int
        self.size, self._per_packet = mode.packet
        self.period: int = mode.period_ns
        self._origin = origin
        self._motor = motor
        self._world = world
        self._built = 0
        self._sample_ns = self.period / self._per_packet  # so that samples and packets never drift apart
        self._max_mm = mode.max_distance_q8 * 1000.0 / 256.0
        self._build = {
            0x81: self._standard,
            0x82: self._express,
            0x83: self._hq,
            0x84: self._ultra,
            0x85: self._dense,
            0x86: self._ultra_dense,
        }[mode.format]

    @property
    def ready(self) -> int:
        """When the first packet not built yet will be made: after its last sample."""
        return self._origin + (self._built + 1) * self.period

    @property
    def built_until(self) -> int:
        """When the last sample was taken that is built already."""
        return self._origin + self._built * self.period

    def until(self, now: int) -> Iterator[tuple[bytes, int]]:
        """Build stretches of packets until they reach beyond `now`; each with when its first one is made."""
        count = _STRETCH // self._per_packet
        while (made := self.ready) <= now:
            data = self._build(self._built, count)
            self._built += count
            yield data, made

    def _head(self, first: int, count: int) -> tuple[Floats, Floats]:
        """Revolutions since the beginning, and times (ns), of `count` samples from number `first` on."""
        return self._motor.sampled(self._origin, first, count, self._sample_ns)

    def _measure(self, degrees: Floats, times: Floats) -> Floats:
        """Distances in mm at these angles and times; 0 beyond the mode's reach."""
        mm = self._world.ranges_mm(degrees, times * 1e-9)
        mm *= mm <= self._max_mm
        return mm

    def _triangulate(self, degrees: Floats, times: Floats) -> Floats:
        """As `_measure`, where returns lie beside the beam, which is at these angles."""
        mm = self._measure(degrees - 8.0, times)
        for _ in range(2):  # the shift depends on the distance, the distance on the shift
            mm = self._measure(degrees - _ultra_shift(mm), times)
        return mm

    def _capsules(self, packet: int, count: int) -> tuple[npt.NDArray[np.int64], Floats, Floats]:
        """Start angles (count,) in q6, and degrees and times of all samples of these packets."""
        turns, times = self._head(packet * self._per_packet, count * self._per_packet)
        return _q6(turns[:: self._per_packet]), turns * 360.0, times

    def _standard(self, packet: int, count: int) -> bytes:
        turns, times = self._head(packet - 1, count + 2)  # one more at either end, to see where a revolution begins
        passes = np.diff(np.floor(turns)) > 0.0
        turns, times = turns[1:-1], times[1:-1]
        degrees = turns * 360.0
        mm = self._triangulate(degrees, times) if self._triangulates else self._measure(degrees, times)
        mm = _carried(mm, 65535 / 4)
        behind = np.where(mm > 0.0, _ultra_shift(mm), 0.0) if self._triangulates else 0.0
        begins = passes[1:] if self._triangulates else passes[:-1]
        distance = np.rint(mm * 4.0).astype(np.int64)
        return packers.pack_standard(_q6(turns - behind / 360.0), distance, _strength(mm) >> 2, begins)

    def _express(self, packet: int, count: int) -> bytes:
        start, degrees, times = self._capsules(packet, count)
        mm = self._triangulate(degrees, times)
        offsets = np.where(mm > 0.0, np.clip(np.rint(_ultra_shift(mm) * 8.0), 0.0, 63.0), 0.0).astype(np.int64)
        mm = _carried(self._measure(degrees - offsets / 8.0, times), 16383.0)
        return packers.pack_express(start, mm, offsets, new_stream=packet == 0)

    def _hq(self, packet: int, count: int) -> bytes:
        turns, times = self._head(packet * 96 - 1, count * 96 + 1)
        mm = self._measure(turns[1:] * 360.0, times[1:])
        angle = np.floor((turns[1:] % 1.0) * 65536.0).astype(np.int64) & 0xFFFF
        begins = np.diff(np.floor(turns)) > 0.0
        stamp = (times[1::96] * 1e-3).astype(np.uint64)
        return packers.pack_hq(
            angle, np.rint(mm * 4.0).astype(np.int64), _strength(mm), np.where(begins, 1, 2), time_us=stamp
        )

    def _ultra(self, packet: int, count: int) -> bytes:
        samples = count * 96
        turns, times = self._head(packet * 96, samples + 1)  # one more: predictions need the next packet
        mm = self._triangulate(turns * 360.0, times)
        return packers.pack_ultra(
            _q6(turns[:samples:96]), mm[:samples].reshape(count, 96), float(mm[samples]), new_stream=packet == 0
        )

    def _dense(self, packet: int, count: int) -> bytes:
        start, degrees, times = self._capsules(packet, count)
        return packers.pack_dense(start, self._measure(degrees, times), new_stream=packet == 0)

    def _ultra_dense(self, packet: int, count: int) -> bytes:
        start, degrees, times = self._capsules(packet, count)
        mm = self._measure(degrees, times)
        stamp = (times[::64] * 1e-3).astype(np.int64)
        return packers.pack_ultra_dense(start, mm, _strength(mm), time_us=stamp, new_stream=packet == 0)


def _q6(turns: Floats) -> npt.NDArray[np.int64]:
    """Angles in 1/64 degree, below 360°."""
    return np.floor(turns * 23040.0).astype(np.int64) % 23040


def _carried(mm: Floats, top: float) -> Floats:
    """No return where the format's distance field is too short."""
    return np.where(mm <= top, mm, 0.0)


def _strength(mm: Floats) -> npt.NDArray[np.int64]:
    """An echo's strength, 0..255: it falls with the distance, and nothing comes back from nowhere."""
    return np.where(mm > 0.0, np.clip(250.0 - mm / 80.0, 40.0, 250.0), 0.0).astype(np.int64)


def _ultra_shift(mm: Floats) -> Floats:
    """Degrees by which a return lies behind the beam, of a model that triangulates.

    The host subtracts them from samples of response type 0x84 (vendor SDK 2.1.0, without rounding).
    """
    k = 98361.0 / np.maximum(mm * 4.0, 1.0)
    far = 8.0 - np.degrees((k * 64.0 + k**3 / 98304.0) / 65536.0)
    return np.where(mm * 4.0 < 200.0, 7.5, far)
