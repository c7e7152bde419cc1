"""Whether there was time for what is told as missing: a device measures at an even pace, whatever its rotor does.

Bytes come late, never early. So the time up to a read is enough for all samples that the device has measured by
then, those included that did not come. Angles can only guess how many these are: a rotor that slows down, or that
something holds, looks like one of which less comes. Where as many samples came as the time allows, and so it was in
the revolutions before, nothing is missing.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from typing import Final, Self, TypeAlias

from lidario.wire.copies import copy_of

_FEWEST: Final = 3
"""Revolutions, or reads, in a row in which the pace must have been even."""
_OFF: Final = 0.01
"""Part of the samples by which the device's clock and ours may be apart."""

Reads: TypeAlias = Sequence[tuple[int, int]]
"""Of each read, how many samples had been measured by its last packet, and when it was."""


class Tally:
    """Counts the samples of one stream, and holds them against the time."""

    def __init__(self) -> None:
        # Nanoseconds that a sample takes; 0 where time tells nothing.
        self._sample_ns = 0.0
        # When the next sample is due, by each of the latest revolutions. Where decoding began makes no difference.
        self._due_ns: deque[float] = deque(maxlen=_FEWEST)

    def copy(self) -> Self:
        """Another one, which goes on from here."""
        twin = copy_of(self)
        twin._due_ns = self._due_ns.copy()  # noqa: SLF001 - its own
        return twin

    def tell_time(self, sample_ns: float) -> None:
        """A sample takes so long from now on; 0 where time tells nothing."""
        self._sample_ns = sample_ns
        self._due_ns.clear()

    def add(self, reads: Reads, missing: int = 0) -> None:
        """What came by these reads is decoded, and so many samples are missing among it."""
        if not (self._sample_ns and reads):
            return
        if missing:
            # A read in the midst of a gap is late for what it brings.
            self._due_ns.clear()
            return
        if len(reads) > 1:
            # The last read may have brought more than this, and so came later.
            self._due_ns.append(self._least(reads[:-1]))
        passed_ns = reads[-1][0] * self._sample_ns
        for at, due_ns in enumerate(self._due_ns):
            self._due_ns[at] = due_ns + passed_ns

    def has_room(self, came: Reads, told: Reads, packet: float) -> bool:
        """Whether there was time for what is told as missing. True where that is not known.

        Args:
            came: The reads, with what came by each since what was added.
            told: The same with what is told as missing before.
            packet: Samples of a packet.
        """
        if not (self._sample_ns and came):
            return True
        off, packet_ns = _OFF * came[-1][0] * self._sample_ns, packet * self._sample_ns
        before = sum([there == with_missing for (there, _), (with_missing, _) in zip(came, told, strict=True)])
        # The last read before a gap may have come in the midst of it; the very last one may have brought more.
        known = [*self._due_ns, *(self._least([read]) for read in came[: max(0, before - 1)])]
        behind = came[before:-1][-_FEWEST:]
        if len(known) < _FEWEST or max(known) - min(known) > packet_ns + off or not behind:
            return True
        # A packet comes whole, and so its samples are late, the last one of several reads by little.
        base, spare = min(known), packet_ns / 2 + off
        as_many = abs(self._least(behind) - base) <= spare
        return not as_many or self._least(told) >= base - spare

    def _least(self, reads: Reads) -> float:
        """When the first of the next samples was due, by these reads."""
        return min([at_ns - samples * self._sample_ns for samples, at_ns in reads])
