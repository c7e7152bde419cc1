"""What a sample takes: what the device tells of it, unless the stream itself says otherwise.

Times, speeds and what is missing all rest on it, and some devices tell it wrong: configuration of another mode, or
none. So while a stream is young the samples that come are counted against the time in which they come. Bytes come
late by any amount, but what comes late once is early the next time: a time is believed when two windows of two
seconds each measure it alike, and both are off by more than a tenth. Samples that are known to be missing count as
if they had come. Once a window agrees with what was told, that is right, and nothing is measured any more.
"""

from __future__ import annotations

from typing import Final

from lidario.revolution.ended import EndedRevolution

__all__ = ["SampleTime"]

WINDOW_NS: Final = 2_000_000_000
OFF: Final = 0.1
"""The clocks of devices are right to a thousandth, and so is what most of them tell."""
ALIKE: Final = 0.02


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
        self._samples = 0

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
            self._begin_ns, self._samples = came_ns, 0
        elif came_ns <= self._last_ns:
            # They came together with the ones before.
            self._samples += samples if self._last_ns > self._begin_ns else 0
        else:
            if self._last_ns - self._begin_ns >= WINDOW_NS:
                self._judge((self._last_ns - self._begin_ns) / max(self._samples, 1))
                self._begin_ns, self._samples = self._last_ns, 0
            self._samples += samples
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
