"""What a revolution takes, from a few packets of which each tells an angle and a time.

Where most packets are missing, no two follow each other, and so no step of the angle is ever seen. But the rotor
turns evenly: at its true speed the angles of all packets, less what the rotor has turned since, are nearly one
angle; not quite, for a packet is dated by the read that brought it. Many speeds are tried. The one at which these
angles agree best is taken, if random angles would hardly ever agree so well.
"""

from __future__ import annotations

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
"""Packets of one revolution. More would be too near each other."""
_SURE: Final = 9.0
"""How much better they must agree than random angles would: these do so in one of 8100 tries (Rayleigh's test)."""
_AS_WELL: Final = 2.0
"""A speed at which they agree less than at the best one by no more than that may be the right one: then the slowest
is taken, so that rather too few revolutions are counted than too many."""
_STEP: Final = 0.2
"""Revolutions from the first packet to the last by which two speeds that are tried differ."""
_NEAR: Final = np.arange(-_STEP, _STEP, 0.01)
"""The same, of those among which the best one is sought then."""
_LEAST_TURNS: Final = 6.0
"""Revolutions that the packets must be apart, for their angles to tell a speed within some percent."""
_FASTEST_HZ: Final = 1e9 / FASTEST_TURN_NS
_LONGEST_NS: Final = 20e9
"""Packets farther apart are not compared: no rotor is so even, and more speeds would have to be tried."""


def dated_angles(wire: StreamFormat, packets: Packets) -> list[tuple[float, int]]:
    """Where a few of these packets began, in revolutions, and when they came, as far as that is known."""
    headings = wire.headings(packets)
    return [
        ((int(headings[count - 1]) & HEADING_MASK) / wire.full_turn, at_ns)
        for count, at_ns in packets.arrivals[:: -(-len(packets.arrivals) // _OF_ONE)]
    ]


class SparseSpeed:
    """Finds the speed of one rotor.

    Args:
        slowest_ns: What a revolution takes at most.
    """

    def __init__(self, slowest_ns: float) -> None:
        self._slowest_hz = 1e9 / slowest_ns
        self._points: deque[tuple[float, int]] = deque(maxlen=_MOST)

    def add(self, angle: float, at_ns: int) -> None:
        """A packet came; `angle` is where it begins, in revolutions."""
        # What was read late and together may be dated before what came before it.
        if self._points and abs(at_ns - self._points[0][1]) > _LONGEST_NS:
            self._points.clear()
        self._points.append((angle, at_ns))

    def revolution_ns(self) -> float:
        """What a revolution takes; 0 while that is not known."""
        if len(self._points) <= _SURE:
            return 0.0
        first, lasted = self._points[0][1], (self._points[-1][1] - self._points[0][1]) * 1e-9
        points = [(angle, (at_ns - first) * 1e-9) for angle, at_ns in self._points]
        speeds = np.arange(self._slowest_hz, _FASTEST_HZ, _STEP / lasted) if lasted > 0 else np.empty(0)
        if not len(speeds):
            return 0.0
        agreeing = _agreeing(points, speeds)
        most = float(agreeing.max())
        # The longer it lasted, the more speeds there are that differ: chance finds one among them more easily.
        if most < _SURE + math.log(_FASTEST_HZ * lasted):
            return 0.0
        near = speeds[int((agreeing >= most - _AS_WELL).argmax())] + _NEAR / lasted
        hertz = float(near[int(_agreeing(points, near).argmax())])
        return 1e9 / hertz if hertz * lasted >= _LEAST_TURNS else 0.0


def _agreeing(points: list[tuple[float, float]], speeds: NDArray[np.float64]) -> NDArray[np.float64]:
    """How far points, each an angle in revolutions and its time in seconds, agree at each speed.

    It is their number where all agree, and mostly about 1 where none do.
    """
    sums = np.zeros(len(speeds), np.complex128)
    for angle, at in points:
        sums += np.exp(2j * np.pi * (angle - at * speeds))
    return np.abs(sums) ** 2 / len(points)
