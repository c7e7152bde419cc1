"""The device side: frames as long as the rotor turns; it hears nothing.

It takes its samples at equal times and sends those of one sixteenth or fifteenth of a revolution together, so how
many they are follows from the speed. Somebody else powers its motor: `power_motor`. Below four revolutions a second
and above ten it sends only that it fails, and how fast it turns.

Frames: big-endian, with their length, a version, a command, and a sum, as 3irobotix's protocol documents have them.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from lidario.sim.chassis import Maker, by_name, maker
from lidario.sim.talker import Floats, PacedByAngle, TalkerProfile

_SPEEDS = (240.0, 600.0)
_MOST = 80


@dataclass(frozen=True, slots=True)
class Profile(TalkerProfile):
    """What kind of device it is."""

    tells_end: bool = False  # whether frames have the angle of their last sample, and version 10


_REACH_MM = (150.0, 8000.0)
_DELTA2A = Profile(
    "irobotix-delta2a", 1, baudrate=230_400, rate=5000.0, hertz=6.0, slots=16, reach_mm=_REACH_MM, early=True
)
_DELTA2D = replace(_DELTA2A, name="irobotix-delta2d", model=3, baudrate=115_200, rate=2000.0, tells_end=True)
_DELTA2G = Profile("irobotix-delta2g", 4, rate=1890.0, hertz=5.25, slots=15, reach_mm=_REACH_MM, early=True)
PROFILES = by_name(
    _DELTA2A,
    replace(_DELTA2A, name="irobotix-delta2b", model=2),
    _DELTA2D,
    _DELTA2G,
    replace(_DELTA2G, name="irobotix-lds08rr", model=5),
)


class SimulatedIrobotix(PacedByAngle[Profile]):
    """One simulated device; arguments and attributes as in `Talker`."""

    def _samples(self, rpm: float) -> int:
        return int(np.clip(round(self.profile.rate * 60 / (max(rpm, 60.0) * self.profile.slots)), 1, _MOST))

    def _pack(self, slot: int, seen: Floats, rpm: float) -> bytes:
        if not _SPEEDS[0] <= rpm <= _SPEEDS[1]:
            return pack_failure(rpm / 60)
        signals = np.where(seen > 0, np.clip(130 - seen / 100, 20, 130), 0).astype(int)
        start = 36_000 * slot // self.profile.slots
        last = start + 36_000 * (len(seen) - 1) // (self.profile.slots * len(seen))
        more = {"end": last, "version": 0x10} if self.profile.tells_end else {}
        return pack_measurement(start, seen.tolist(), signals.tolist(), hertz=rpm / 60, **more)


make_simulated: Maker[SimulatedIrobotix] = maker(SimulatedIrobotix, PROFILES)


def pack_frame(command: int, data: bytes, *, version: int = 1) -> bytes:
    """Pack any frame."""
    body = b"\xaa" + (8 + len(data)).to_bytes(2, "big") + bytes((version, 0x61, command))
    body += len(data).to_bytes(2, "big") + data
    return body + (sum(body) % 65536).to_bytes(2, "big")


def pack_measurement(
    start: int,
    millimetres: Sequence[float],
    signals: Sequence[int],
    *,
    hertz: float = 6.0,
    end: int | None = None,
    version: int = 1,
) -> bytes:
    """Pack one measurement frame; angles are hundredths of a degree, and `end` is only of a model that sends it.

    0 mm is no return, as is what 16 bits cannot hold in quarters.
    """
    # The calibration is 0.
    data = bytes((min(round(hertz * 20), 255), 0, 0)) + start.to_bytes(2, "big")
    if end is not None:
        data += end.to_bytes(2, "big")
    for distance, signal in zip(millimetres, signals, strict=True):
        quarters = round(float(distance) * 4)
        data += bytes((int(signal),)) + (quarters if quarters < 65536 else 0).to_bytes(2, "big")
    return pack_frame(0xAD, data, version=version)


def pack_failure(hertz: float) -> bytes:
    """Pack the frame that tells of a rotor that is too slow or too fast."""
    return pack_frame(0xAE, bytes((min(round(hertz * 20), 255),)))
