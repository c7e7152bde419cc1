"""What a sample takes: what the device tells of it, unless the stream itself says otherwise.

Times, speeds and what is missing all rest on it, and some devices tell it wrong: configuration of another mode, or
none. So while a stream is young the samples of each read are counted against the time since the read before. Bytes
come late by any amount, but what comes late once is early the next time; and where whole revolutions are lost,
which angles hide, most reads still bring all that was measured. So the median of two seconds counts, and a time is
believed when two such windows measure it alike, both off by more than a tenth. Samples that are known to be missing
count as if they had come. Once a window agrees with what was told, that is right, and no more is measured.
"""

from __future__ import annotations

from collections.abc import Sequence
from statistics import median
from typing import Final

from lidario.revolution.ended import EndedRevolution

__all__ = ["SampleTime"]

WINDOW_NS: Final = 2_000_000_000
OFF: Final = 0.1
"""The clocks of devices are right to a thousandth, and so is what most of them tell."""
ALIKE: Final = 0.03
LIKELY: Final = 0.3
"""Part of the median by which reads may be off that count."""
FEWEST: Final = 8
"""Reads of a window at least."""


class SampleTime:
    """Follows one stream, until it is sure.

    Args:
        told_ns: Nanoseconds that the device tells; 0 where it tells none, and then nothing is measured here.

    Attributes:
        ns: What counts.
        measured_ns: What it takes where the device tells none, by `of`.
    """

    def __init__(self, told_ns: float) -> None:
        self.ns: float = told_ns
        self.measured_ns: float = 0.0
        self._note = ""
        self._told_ns = told_ns
        self._is_sure = not told_ns
        self._before_ns = 0.0
        self._begin_ns: int | None = None
        self._last_ns = 0
        # Of the window: the time that passed before each read, and the samples that came with it.
        self._reads: list[tuple[int, int]] = []

    def of(self, ended: EndedRevolution) -> float:
        """Where the device tells none: as the last revolution without a gap took."""
        if not ended.lost or not self.measured_ns:
            self.measured_ns = ended.elapsed_ns / ended.count
        return self.measured_ns

    def take_note(self) -> str:
        """What is to be told of it, once; mostly empty."""
        note, self._note = self._note, ""
        return note

    def restart(self) -> None:
        """How many samples are missing is not known: count anew."""
        self._begin_ns = None

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
                self._reads.append((passed_ns, before + samples))
        else:
            if self._last_ns - self._begin_ns >= WINDOW_NS and len(self._reads) >= FEWEST:
                self._judge(_likely(self._reads))
                self._begin_ns, self._reads = self._last_ns, []
            self._reads.append((came_ns - self._last_ns, samples))
        self._last_ns = came_ns

    def _judge(self, measured_ns: float) -> None:
        before_ns, self._before_ns = self._before_ns, measured_ns
        if abs(measured_ns / self._told_ns - 1) <= OFF:
            self._is_sure = True
        elif abs(measured_ns - before_ns) <= ALIKE * measured_ns:
            self._is_sure = True
            self.ns = (measured_ns + before_ns) / 2
            self._note = (
                f"the device tells {self._told_ns * 1e-3:.4g} µs a sample, and takes {self.ns * 1e-3:.4g}: "
                "what is measured counts"
            )


def _likely(reads: Sequence[tuple[int, int]]) -> float:
    """What a sample takes by most of the reads: by the median, and all that are near it."""
    middle = median(passed_ns / samples for passed_ns, samples in reads)
    near = [each for each in reads if abs(each[0] / each[1] - middle) <= LIKELY * middle]
    return sum(passed_ns for passed_ns, _ in near) / sum(samples for _, samples in near)
