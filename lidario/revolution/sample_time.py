"""What a sample takes: what the device tells of it, unless the stream itself says otherwise.

Times, speeds and what is missing all rest on it, and some devices tell it wrong: configuration of another mode, or
none. So while a stream is young the samples of each read are counted against the time since the read before, for
two seconds. Where a line stalls, what comes late is early the next time, so that the mean is right and most of the
reads are not; where whole revolutions are lost, which angles hide, most of the reads are right and the mean is
not. So a time is believed when mean and median agree, in two windows alike, and are off by more than a tenth.
Samples that are known to be missing count as if they had come. Once a window agrees with what was told, nothing is
measured any more. Where a model has several rates and cannot be asked for the one that is set, a window tells it,
and before that the speed that packets tell, if they do.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Sequence
from statistics import median, median_low
from typing import Final

WINDOW_NS: Final = 2_000_000_000
OFF: Final = 0.1
"""The clocks of devices are right to a thousandth, and so is what most of them tell; one took 0.7 % longer."""
ALIKE: Final = 0.03
FEWEST: Final = 8
"""Reads of a window at least."""
_LATEST: Final = 15
"""Revolutions of which most are read in time, also where a program reads several of them late and together."""


class SampleTime:
    """Follows one stream, until it is sure.

    Args:
        told_ns: Nanoseconds that the device tells; 0 where it tells none.
        may_be_ns: Those of which one holds, where the device tells none.
        timed: As `Stream.timed`. Times that were made from the sample time cannot speak against it.
    """

    _last_ns: int  # when the samples before came; none did while `_begin_ns` is None

    def __init__(self, told_ns: float, may_be_ns: Sequence[float] = (), *, timed: bool = True) -> None:
        self.ns: float = told_ns  # what counts; 0 while nothing is told or sure
        self._note = ""
        self._likely_ns = [told_ns] if told_ns else [*may_be_ns]
        self._is_sure = not timed
        self._latest: deque[float] = deque(maxlen=_LATEST)
        self._forget()

    def _forget(self) -> None:
        # While `ns` is 0, what it takes in most of the last revolutions; 0 before the first.
        self.measured_ns: float = 0.0
        self._before_ns = 0.0
        self._begin_ns: int | None = None
        self._latest.clear()
        # Of the window: the time that passed before each read, and the samples that came with it.
        self._reads: list[tuple[int, int]] = []

    @property
    def known_ns(self) -> float:
        """What it takes, as far as that is known; 0 while it is not."""
        return self.ns or self.measured_ns

    def take_note(self) -> str:
        """What is to be told of it, once; mostly empty."""
        note, self._note = self._note, ""
        return note

    def restart(self) -> None:
        """How many samples are missing is not known: count anew."""
        self._begin_ns = None

    def suppose(self, revolution_samples: float, rpm: float) -> None:
        """Packets tell this speed, or NaN: while nothing is known, the likely time that fits it is taken."""
        if not (self.ns or self._is_sure or math.isnan(rpm)) and revolution_samples * rpm:
            self.ns = self._nearest(60e9 / (revolution_samples * rpm))

    def add(self, samples: int, came_ns: int) -> None:
        """So many samples more were measured, and came, the last of them then."""
        if self._is_sure:
            return
        if self._begin_ns is None:
            self._begin_ns, self._reads = came_ns, []
        elif came_ns <= self._last_ns:
            # They came together with the ones before.
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
        """So many samples came, that long behind those before."""
        self._reads.append((passed_ns, samples))
        self._latest.append(passed_ns / samples)
        if not self.ns:
            self.measured_ns = median(self._latest)

    def _is_told_by(self, reads: Sequence[tuple[int, int]]) -> bool:
        """Whether this window makes it sure; then what led to it is forgotten."""
        mean_ns = sum(passed_ns for passed_ns, _ in reads) / sum(samples for _, samples in reads)
        # Of two halves the faster: where an outage lies in every second one, the middle of both is the mean.
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
        # So that decoders that began elsewhere are alike.
        self._is_sure = True
        self._forget()
        return True

    def _nearest(self, measured_ns: float) -> float:
        """The likely time that is about what was measured; 0 where there is none."""
        near_ns = [each for each in self._likely_ns if abs(each - measured_ns) <= OFF * each]
        return min(near_ns, key=lambda each: abs(each - measured_ns), default=0.0)
