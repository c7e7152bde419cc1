"""Finds the time of a revolution from a few packets, each with an angle and a time.

If most packets are missing, no two follow each other, so no step of the angle is ever seen. But the rotor turns
evenly. At its true speed, the angle of each packet, less the turn of the rotor up to its time, is nearly the same;
not quite, for a packet is dated by the read that brought it. Many speeds are tried. The speed at which these angles
agree best is taken, if random angles would hardly ever agree so well.
"""

import math
from collections import deque
from typing import Final

import numpy as np
from numpy.typing import NDArray

from lidario.revolution.doubled import FASTEST_TURN_NS
from lidario.wire.events import Packets
from lidario.wire.formats import HEADING_MASK, StreamFormat

_MOST: Final = 32
_OF_ONE: Final = 2
"""Packets that are compared, and how many of one revolution at most: more would be too near each other."""
_SURE: Final = 9.0
"""How much better angles must agree than random ones: those agree as well in one of 8100 tries (Rayleigh's
test)."""
_AS_WELL: Final = 0.75
"""Speeds that agree by this part of the best one may be right, too: reads at equal times fit several. The slowest
is taken, which counts rather too few revolutions than too many."""
_STEP: Final = 0.2
"""Two neighbouring speeds differ by this many revolutions from the first packet to the last."""
_NEAR: Final = np.arange(-_STEP, _STEP, 0.01)
"""The finer speeds around the one found, in the same unit, among which the best one is sought."""
_LEAST_TURNS: Final = 6.0
"""Least revolutions from the first packet to the last: only then the angles give a speed within some percent."""
_FASTEST_HZ: Final = 1e9 / FASTEST_TURN_NS
_LONGEST_NS: Final = 20e9
"""Packets farther apart are not compared: no rotor is so even, and more speeds would have to be tried."""


def dated_angles(wire: StreamFormat, packets: Packets) -> list[tuple[float, int]]:
    """Angles at which a few of these packets begin, in revolutions, each with the arrival of its read."""
    headings = wire.headings(packets)
    # A time that was computed and not measured tells nothing: packets may be missing behind it.
    reads = packets.arrivals[:-1] if packets.cut else packets.arrivals
    return [
        ((int(headings[count - 1]) & HEADING_MASK) / wire.full_turn, at_ns)
        for count, at_ns in reads[:: max(1, -(-len(reads) // _OF_ONE))]
    ]


class SparseSpeed:
    """Finds the speed of one rotor.

    Args:
        slowest_ns: Longest time of a revolution.
    """

    def __init__(self, slowest_ns: float) -> None:
        self._slowest_hz = 1e9 / slowest_ns
        self._points: deque[tuple[float, int]] = deque(maxlen=_MOST)

    def add(self, angle: float, at_ns: int) -> None:
        """Take a packet that came; `angle` is where it begins, in revolutions."""
        # Packets that were read late and together may be dated before those that came before them.
        if self._points and abs(at_ns - self._points[0][1]) > _LONGEST_NS:
            self._points.clear()
        self._points.append((angle, at_ns))

    def revolution_ns(self) -> float:
        """Time of a revolution; 0 while unknown."""
        if len(self._points) <= _SURE:
            return 0.0
        first, lasted = self._points[0][1], (self._points[-1][1] - self._points[0][1]) * 1e-9
        points = [(angle, (at_ns - first) * 1e-9) for angle, at_ns in self._points]
        speeds = np.arange(self._slowest_hz, _FASTEST_HZ, _STEP / lasted) if lasted > 0 else np.empty(0)
        if not len(speeds):
            return 0.0
        agreeing = _agreeing(points, speeds)
        most = float(agreeing.max())
        # The longer the time, the more speeds are tried, and the more easily one of them agrees by chance.
        if most < _SURE + math.log(_FASTEST_HZ * lasted):
            return 0.0
        is_peak = (agreeing >= np.append(0.0, agreeing[:-1])) & (agreeing >= np.append(agreeing[1:], 0.0))
        near = speeds[int((is_peak & (agreeing >= _AS_WELL * most)).argmax())] + _NEAR / lasted
        hertz = float(near[int(_agreeing(points, near).argmax())])
        return 1e9 / hertz if hertz * lasted >= _LEAST_TURNS else 0.0


def _agreeing(points: list[tuple[float, float]], speeds: NDArray[np.float64]) -> NDArray[np.float64]:
    """How well points agree at each speed; a point is an angle in revolutions and its time in seconds.

    The value is the number of points if all agree, and mostly about 1 if none do.
    """
    sums = np.zeros(len(speeds), np.complex128)
    for angle, at in points:
        sums += np.exp(2j * np.pi * (angle - at * speeds))
    return np.abs(sums) ** 2 / len(points)
