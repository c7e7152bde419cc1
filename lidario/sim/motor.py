"""A motor that rotates the head: commanded speed, spin-up, and the angle at any moment.

Speed approaches its target exponentially, which has a closed form for the angle as well. So the angle of every
sample is a function of its time alone. `spin_up_s` is the time from standstill until the speed is *stable*, within
2 % of the target: data sheets give this time, and a device withholds its samples for so long.
"""

import math

import numpy as np
import numpy.typing as npt

Floats = npt.NDArray[np.float64]

_STABLE = 0.02
_PLACES = 36
"""Places of a turn between which the speed of an uneven rotor changes."""


class Motor:
    """A motor with a commanded speed; times are integer monotonic nanoseconds that never go back.

    From standstill it is stable after `spin_up_s` seconds; 0 changes speed at once. At the beginning the head
    stands at so many `turns`. Over 10 degrees its speed is off by the part `uneven`, one standard deviation; over a
    turn it is even.
    """

    def __init__(self, *, spin_up_s: float = 1.0, turns: float = 0.0, uneven: float = 0.0) -> None:
        self.spin_up_s: float = spin_up_s
        off = np.random.default_rng(_PLACES).normal(size=_PLACES)
        off -= off.mean()
        # How far it is ahead of an even one, in turns, at each place.
        self._ahead = np.append(0.0, np.cumsum(off * (uneven / off.std() / _PLACES))) if uneven else np.empty(0)
        self._since = 0
        self._turns = turns
        self._rate = self._earlier = 0.0  # revolutions per second at `_since`, and right before
        self._target = 0.0
        self._tau = 0.0

    @property
    def target_rpm(self) -> float:
        """The commanded speed in revolutions per minute; 0 when the motor is off."""
        return self._target * 60.0

    @property
    def stable_at(self) -> int | None:
        """When the speed is (or was) first within 2 % of its target; None with the motor off."""
        if self._target <= 0.0:
            return None
        gap, allowed = abs(self._rate - self._target), _STABLE * self._target
        if gap <= allowed:
            return self._since
        return self._since + math.ceil(self._tau * math.log(gap / allowed) * 1e9)

    def reaches(self, rpm: float) -> int | None:
        """When it turns at least at that speed, on its way up; None where it will not."""
        rate = rpm / 60.0
        if self._rate >= rate or self._tau <= 0.0:
            return self._since if self._target >= rate else None
        if self._target <= rate:
            return None
        return self._since + math.ceil(
            self._tau * math.log((self._target - self._rate) / (self._target - rate)) * 1e9
        )

    def set_rpm(self, rpm: float, now: int) -> None:
        """Command a speed in revolutions per minute; 0 lets the head run down."""
        self._turns, self._rate = float(self._even(np.array([float(now)]))[0]), self.rpm(now) / 60.0
        self._since, self._earlier = now, self._rate
        self._target = rpm / 60.0
        self._tau = self.spin_up_s / -math.log(_STABLE)
        if self._tau <= 0.0:
            self._rate = self._target

    def spin_at_once(self, rpm: float, since: int) -> None:
        """Have had that speed since that time, without spinning up."""
        spin_up, self.spin_up_s = self.spin_up_s, 0.0
        self.set_rpm(rpm, since)
        self.spin_up_s = spin_up

    def rpm(self, now: int) -> float:
        """The actual speed at `now` in revolutions per minute."""
        if self._tau <= 0.0:
            return self._target * 60.0
        fade = math.exp(-(now - self._since) * 1e-9 / self._tau)
        return (self._target + (self._rate - self._target) * fade) * 60.0

    def turns(self, times: Floats) -> Floats:
        """Where the head stands at each time, in revolutions since the beginning; the fraction is the angle.

        Times are float64 (n,), nanoseconds, ascending; of a packet that the last `set_rpm` came upon, also before
        it.
        """
        angle = self._even(times)
        if self._ahead.size:
            angle += np.interp(angle % 1.0 * _PLACES, np.arange(_PLACES + 1), self._ahead)
        return angle

    def sampled(self, origin: int, first: int, count: int, sample_ns: float) -> tuple[Floats, Floats]:
        """Where the head stands at so many samples from number `first` on, as `turns` has it, and their times.

        The n-th sample is taken at ``origin + n * sample_ns``: a function of n alone.
        """
        times = np.arange(first, first + count, dtype=np.float64)
        times *= sample_ns
        times += origin
        return self.turns(times), times

    def _even(self, times: Floats) -> Floats:
        seconds = (times - self._since) * 1e-9
        angle = seconds * self._target + self._turns
        lag = (self._rate - self._target) * self._tau
        if lag:
            angle -= lag * np.expm1(-seconds / self._tau)
        if seconds.size and seconds[0] < 0:
            # Else the head would leap, by what it turns more or less from now on.
            np.copyto(angle, seconds * self._earlier + self._turns, where=seconds < 0)
        return angle
