"""What a revolution takes, from a few packets of which each tells an angle and a time.

Where most packets are missing, no two follow each other, and so no step of the angle is ever seen. But the rotor
turns evenly: at its true speed the angles of all packets, less what the rotor has turned since, are one angle.
Speeds are tried from slow to fast, and the first one at which nearly all packets agree is taken. So never more
revolutions are counted than there were. Two such findings, with new packets between them, must be alike.
"""

from __future__ import annotations

from collections import deque
from typing import Final

import numpy as np
from numpy.typing import NDArray

from lidario.wire.events import Packets
from lidario.wire.formats import HEADING_MASK, StreamFormat

_MOST: Final = 16
_OF_ONE: Final = 2
"""Packets of one revolution. More would be too near each other."""
_FEWEST: Final = 12
"""Packets that a finding rests on. Random ones would agree once in a million tries."""
_AGAIN: Final = 4
"""New packets from one finding to the next."""
_TOLERANCE: Final = 0.05
"""Part of a revolution by which an angle may be off: a packet is dated by the read that brought it."""
_AGREEING: Final = 0.8
"""Share of the packets that must agree. Some are none: a few bytes whose check value is right by chance."""
_ALIKE: Final = 0.01
"""Share by which two findings may differ."""
_LEAST_TURNS: Final = 6.0
"""Revolutions that the packets must be apart, for their angles to tell a speed within 1 %."""
_FASTEST_HZ: Final = 30.0
_TOGETHER: Final = 256
"""Speeds that are tried at a time: slow ones first, and most rotors are found soon."""
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
        self._new = 0
        self._found_ns = 0.0

    def forget(self) -> None:
        """It is known otherwise."""
        self._points.clear()
        self._new, self._found_ns = 0, 0.0

    def add(self, angle: float, at_ns: int) -> None:
        """A packet came; `angle` is where it begins, in revolutions."""
        # What was read late and together may be dated before what came before it.
        if self._points and abs(at_ns - self._points[0][1]) > _LONGEST_NS:
            self._points.clear()
        self._points.append((angle, at_ns))
        self._new += 1

    def revolution_ns(self) -> float:
        """What a revolution takes; 0 while that is not known."""
        if self._new < _AGAIN or len(self._points) < _FEWEST:
            return 0.0
        self._new = 0
        before, self._found_ns = self._found_ns, self._find()
        return self._found_ns if abs(self._found_ns - before) < _ALIKE * before else 0.0

    def _find(self) -> float:
        first = self._points[0][1]
        angles = np.array([angle for angle, _ in self._points])
        seconds = np.array([(at_ns - first) * 1e-9 for _, at_ns in self._points])
        lasted = float(seconds[-1])
        if not lasted:
            return 0.0
        every = np.arange(self._slowest_hz, _FASTEST_HZ, _TOLERANCE / lasted)
        for begin in range(0, len(every), _TOGETHER):
            speeds = every[begin : begin + _TOGETHER]
            left = np.exp(2j * np.pi * (angles[:, None] - seconds[:, None] * speeds))
            strength = np.abs(left.mean(axis=0))
            # Those that agree add up to more than what the others can take away.
            for speed in speeds[strength >= 2 * _AGREEING - 1].tolist():
                found = _fitted(angles, seconds, speed)
                if found:
                    return 1e9 / found if found * lasted >= _LEAST_TURNS else 0.0
        return 0.0


def _fitted(angles: NDArray[np.float64], seconds: NDArray[np.float64], speed: float) -> float:
    """The speed near this one at which nearly all packets agree, in Hz; 0 where there is none."""
    for _ in range(2):
        left = angles - seconds * speed
        apart = (left[:, None] - left + 0.5) % 1.0 - 0.5
        agreeing = np.abs(apart) <= _TOLERANCE
        best = int(agreeing.sum(axis=0).argmax())
        these = agreeing[:, best]
        if np.count_nonzero(these) < _AGREEING * len(angles):
            return 0.0
        # What is left of their angles drifts with what the speed is off by.
        speed += float(np.polyfit(seconds[these], apart[these, best], 1)[0])
    return speed
