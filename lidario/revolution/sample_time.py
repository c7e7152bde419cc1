"""The time of a sample: the one that the device tells, unless the stream itself shows another.

Times, speeds and the number of missing packets all rest on it, and some devices tell it wrong, for another mode, or
not at all. So at the beginning of a stream, in windows of two seconds, the samples of each read are compared with
the time since the read before. If a line stalls, late packets make the next read early: the mean is right, and most
reads are wrong. If whole revolutions are lost, which angles hide, most reads are right, and the mean is wrong. So a
measured time is believed if mean and median agree, in two windows alike, and differ from the told time by more than
a tenth. Samples that are known to be missing count as if they had come. Once a window agrees with the told time,
the measuring ends. If a model has several rates and cannot be asked which one is set, a window decides, and before
that the speed that packets tell, if they do.
"""

import math
from collections import deque
from collections.abc import Sequence
from statistics import median, median_low
from typing import Final

WINDOW_NS: Final = 2_000_000_000
OFF: Final = 0.1
"""A told time is wrong if it is off by this share. Device clocks are right to a thousandth, and so are the times
that most devices tell; one took 0.7 % longer."""
ALIKE: Final = 0.03
"""Share by which two measured times may differ and still agree."""
FEWEST: Final = 8
"""A window has at least this many reads."""
_LATEST: Final = 15
"""Revolutions whose median counts: most are read in time, even if a program reads several late and together."""


class SampleTime:
    """Follows one stream, until it is sure.

    Args:
        told_ns: Nanoseconds a sample as the device tells; 0 if it tells none.
        may_be_ns: The possible times, if the device tells none.
        timed: As `Stream.timed`. Times that were made from the sample time cannot disprove it.
    """

    _last_ns: int  # when the samples before came; unset while `_begin_ns` is None

    def __init__(self, told_ns: float, may_be_ns: Sequence[float] = (), *, timed: bool = True) -> None:
        self.ns: float = told_ns  # nanoseconds a sample that count; 0 while none are told or sure
        self._note = ""
        self._likely_ns = [told_ns] if told_ns else [*may_be_ns]
        self._is_sure = not timed
        self._latest: deque[float] = deque(maxlen=_LATEST)
        self._forget()

    def _forget(self) -> None:
        # While `ns` is 0: the median over the last revolutions; 0 before the first.
        self.measured_ns: float = 0.0
        self._before_ns = 0.0
        self._begin_ns: int | None = None
        self._latest.clear()
        # Reads of the window: the time since the read before, and the samples that came with it.
        self._reads: list[tuple[int, int]] = []

    @property
    def known_ns(self) -> float:
        """Nanoseconds a sample, as far as known; 0 while unknown."""
        return self.ns or self.measured_ns

    def take_note(self) -> str:
        """A sentence for the log, given once; mostly empty."""
        note, self._note = self._note, ""
        return note

    def restart(self) -> None:
        """Begin a new window, because it is not known how many samples are missing."""
        self._begin_ns = None

    def suppose(self, revolution_samples: float, rpm: float) -> None:
        """Take the speed that packets tell, or NaN. While no time is known, the likely time that fits it counts."""
        if not (self.ns or self._is_sure or math.isnan(rpm)) and revolution_samples * rpm:
            self.ns = self._nearest(60e9 / (revolution_samples * rpm))

    def add(self, samples: int, came_ns: int) -> None:
        """Count `samples` more that were measured; the last of them came at `came_ns`."""
        if self._is_sure:
            return
        if self._begin_ns is None:
            self._begin_ns, self._reads = came_ns, []
        elif came_ns <= self._last_ns:
            # They came together with those before, in one read.
            if self._reads:
                passed_ns, before = self._reads.pop()
                self._latest.pop()
                self._take(passed_ns, before + samples)
        else:
            if self._last_ns - self._begin_ns >= WINDOW_NS and len(self._reads) >= FEWEST:
                if self._is_told_by(self._reads):
                    return
                self._begin_ns, self._reads = self._last_ns, []
            self._take(came_ns - self._last_ns, samples)
        self._last_ns = came_ns

    def _take(self, passed_ns: int, samples: int) -> None:
        """Note a read of `samples`, `passed_ns` after the read before."""
        self._reads.append((passed_ns, samples))
        self._latest.append(passed_ns / samples)
        if not self.ns:
            self.measured_ns = median(self._latest)

    def _is_told_by(self, reads: Sequence[tuple[int, int]]) -> bool:
        """Whether this window makes the time sure; then all reads are forgotten."""
        mean_ns = sum(passed_ns for passed_ns, _ in reads) / sum(samples for _, samples in reads)
        # The lower median: with an outage in every second read, the middle of both kinds would equal the mean.
        middle_ns = median_low(passed_ns / samples for passed_ns, samples in reads)
        alike = abs(middle_ns - mean_ns) <= ALIKE * mean_ns
        before_ns, self._before_ns = self._before_ns, mean_ns if alike else 0.0
        likely_ns = self._nearest(mean_ns)
        if likely_ns and likely_ns == self._nearest(middle_ns):
            self.ns = likely_ns
        elif alike and abs(mean_ns - before_ns) <= ALIKE * mean_ns:
            measured_ns = (mean_ns + before_ns) / 2
            if [self.ns] == self._likely_ns:
                self._note = (
                    f"the device tells {self.ns * 1e-3:.4g} µs a sample, and takes {measured_ns * 1e-3:.4g}: "
                    "what is measured counts"
                )
            self.ns = measured_ns
        else:
            return False
        # Reads are forgotten, so that the state does not depend on where decoding began.
        self._is_sure = True
        self._forget()
        return True

    def _nearest(self, measured_ns: float) -> float:
        """The likely time that is about the measured one; 0 if there is none."""
        near_ns = [each for each in self._likely_ns if abs(each - measured_ns) <= OFF * each]
        return min(near_ns, key=lambda each: abs(each - measured_ns), default=0.0)
