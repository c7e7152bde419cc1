"""The device side: ``b`` starts motor and stream, ``e`` stops both, and nothing is responded.

It measures at whole degrees, clockwise. Firmware since 2017.10 starts by itself when it gets power; before that it
waits for ``b``. No document says how long it boots or what it does with other bytes: half a second, and nothing.

Packets: as ROBOTIS' driver reads them; of the check value only that it stands twice is known.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from lidario.sim.chassis import Maker, by_name, maker
from lidario.sim.talker import Floats, PacedByAngle, TalkerProfile

_NAMES = {ord("b"): "start", ord("e"): "stop"}


_NEW = TalkerProfile(
    "hlds-lds01", 1, baudrate=230_400, slots=60, samples=6, reach_mm=(120.0, 3500.0), commands=True
)
_OLD = replace(
    _NEW, name="hlds-lds01-2016", model=2, waits=True, note="; firmware before 2017.10, which waits to be started"
)
PROFILES = by_name(_NEW, _OLD)


class SimulatedHlds(PacedByAngle[TalkerProfile]):
    """One simulated device; arguments and attributes as in `Talker`."""

    check: bytes | None = None  # the last two bytes of its packets; None for the usual ones

    def _hear(self, data: bytes, now: int) -> None:
        """Take bytes that the host sent: each is a request of its own."""
        for byte in data:
            name, why = _NAMES.get(byte), self._deaf_why if now < self._deaf_until else ""
            if name is None:
                continue
            if not why and name == "stop":
                self.halt(now)
            elif not why and self._stream is None:
                self._start(now)
            self.log.add(now, name, bytes((byte,)), why)

    def _pack(self, slot: int, seen: Floats, rpm: float) -> bytes:
        strength = np.where(seen > 0, np.clip(4000 - seen, 200, 4000), 0).astype(int)
        return pack_packet(slot, seen.tolist(), strength.tolist(), rpm=rpm, check=self.check)


make_simulated: Maker[SimulatedHlds] = maker(SimulatedHlds, PROFILES)


def pack_packet(
    index: int,
    millimetres: Sequence[float],
    intensities: Sequence[int],
    *,
    rpm: float = 300.0,
    check: bytes | None = None,
) -> bytes:
    """Pack one measurement packet of six samples; by default, `check` is 255 less the sum of all others, twice."""
    body = bytes((0xFA, 0xA0 + index)) + round(rpm * 10).to_bytes(2, "little")
    for distance, intensity in zip(millimetres, intensities, strict=True):
        body += int(intensity).to_bytes(2, "little") + round(float(distance)).to_bytes(2, "little") + bytes(2)
    if check is None:
        check = bytes((255 - sum(body) % 256,)) * 2
    return body + check
