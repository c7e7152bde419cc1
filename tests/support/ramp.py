"""The angles of a rotor that is told another speed."""

import numpy as np
from numpy.typing import NDArray

from lidario.sim.motor import Motor

_SPIN_UP_S = 1.0
"""Time from standstill until the speed is stable, as in `Motor`."""


def ramp(first_hz: float, last_hz: float, every_s: float, *, before_s: float, until_s: float) -> NDArray[np.int64]:
    """Where a rotor stands, in 1/64 degrees counted on past 360, at equal intervals.

    Args:
        first_hz: Its speed at the beginning.
        last_hz: The speed that it is told.
        every_s: The interval, in seconds.
        before_s: When it is told.
        until_s: When the last angle is taken.
    """
    motor = Motor(spin_up_s=0.0)
    motor.set_rpm(60 * first_hz, 0)
    times = np.arange(0.0, until_s * 1e9, every_s * 1e9)
    told = int(np.searchsorted(times, before_s * 1e9))
    before = motor.turns(times[:told])
    motor.spin_up_s = _SPIN_UP_S
    motor.set_rpm(60 * last_hz, round(times[told]))
    turns: NDArray[np.float64] = np.concatenate((before, motor.turns(times[told:])))
    return np.floor(turns * 23040).astype(np.int64)
