"""The device side: samples at equal times, as long as there is power; it hears nothing.

While its rotor speeds up it sends packets without angles, as users of a real one saw. No document says how long it
boots or what it does when its rotor is blocked: half a second, and it falls silent.

Packets: as Camsense's SDK reads them.
"""

from collections.abc import Sequence

import numpy as np

from lidario.sim.chassis import Maker, by_name, maker
from lidario.sim.talker import Floats, PacedByTime, TalkerProfile, folded, within

_NOTHING = 0x8000
_KINDS = {8: (3, 1), 12: (7, 2)}  # by the number of samples: how they are told to lie, and the bytes of a quality
_ZERO = 0xA000
_TURN = 360 * 64


PROFILES = by_name(
    TalkerProfile("camsense-x1", 1, samples=8, rate=2080.0, hertz=5.2, reach_mm=(80.0, 8000.0)),
    TalkerProfile("camsense-lds08rr", 8, samples=12, rate=2080.0, hertz=5.2, reach_mm=(80.0, 8000.0)),
)


class SimulatedCamsense(PacedByTime[TalkerProfile]):
    """One simulated device; arguments and attributes as in `Talker`."""

    def _greeting(self) -> bytes:
        none = [0.0] * self.profile.samples, [0] * self.profile.samples
        return b"".join(pack_packet(at, at, *none, rpm=60.0 + at / 500) for at in (0, 0, _ZERO, _ZERO))

    def _pack(self, turns: Floats, seconds: Floats, rpm: float) -> bytes:
        beam = turns * 360.0
        # Where the return at the true distance lies beside the beam; the second look is at the right place.
        distance = np.hypot(self._stated(self._world.ranges_mm(beam.ravel() + 11.0, seconds.ravel())), 20.0)
        beside = 101.0 - np.degrees(np.arctan(np.sqrt(np.maximum(distance**2 - 400.0, 1.0)) / 20.0))
        seen = self._world.ranges_mm(beam.ravel() + beside, seconds.ravel())
        stated = self._stated(within(seen, self.profile.reach_mm)).reshape(beam.shape)
        quality = np.where(stated > 0, np.clip(104 - stated / 80, 6, 104), 0).astype(int)
        angles = _ZERO + np.floor(turns * _TURN).astype(np.int64) % _TURN
        return b"".join(
            pack_packet(int(at[0]), int(at[-1]), row.tolist(), each.tolist(), rpm=rpm)
            for at, row, each in zip(angles, stated, quality, strict=True)
        )

    @staticmethod
    def _stated(mm: Floats) -> Floats:
        """What is stated of a true distance from the axis."""
        return np.sqrt(np.maximum(mm**2 - 400.0, 0.0))


make_simulated: Maker[SimulatedCamsense] = maker(SimulatedCamsense, PROFILES)


def pack_packet(
    start: int, end: int, millimetres: Sequence[float], qualities: Sequence[int], *, rpm: float = 312.0
) -> bytes:
    """Pack one measurement packet of 8 or 12 samples.

    Angles are as they are sent: A000 hexadecimal and 64ths of a degree. 0 mm is no return, as is what 14 bits
    cannot hold.
    """
    kind, width = _KINDS[len(millimetres)]
    body = bytes((0x55, 0xAA, kind, len(millimetres)))
    body += round(rpm * 64).to_bytes(2, "little") + start.to_bytes(2, "little")
    for distance, quality in zip(millimetres, qualities, strict=True):
        whole = round(float(distance))
        word = whole if 0 < whole < 0x4000 else _NOTHING
        body += word.to_bytes(2, "little") + int(quality if word != _NOTHING else 0).to_bytes(width, "little")
    body += end.to_bytes(2, "little")
    return body + folded(body)
