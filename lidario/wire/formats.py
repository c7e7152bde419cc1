"""How a measurement stream is cut into packets: the one thing every format must answer.

No format has framing beyond its own first bytes and a check value, so a packet is believed when three things
agree: it begins as one does (`StreamFormat.header`), its length is known (`measure`), and its check value
holds (`intact`). `cut` builds on those three and is the same for every format:

* while in step, whole runs of packets are taken;
* a packet that fails its check is searched *inside*: the next one may begin in its middle, when bytes were
  lost or added;
* a packet found that way must be followed by the beginning of another, because an 8-bit check value lets one
  false packet in 256 pass. One that stands exactly where the damaged packet says it ends needs no such proof.

Every decision waits until the bytes it rests on are there, so results do not depend on how the stream was
chopped. A format object belongs to one stream: it remembers whether it is in step.
"""

from __future__ import annotations

import re
from abc import ABC, abstractmethod
from collections.abc import Sequence
from typing import Any, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

__all__ = ["BEGINS", "NO_PACKET", "RESTARTS", "Cut", "Headings", "StreamFormat"]

NO_PACKET = -1
"""Answer of `measure` and `aside`: nothing of the kind can begin here."""

BEGINS = 1 << 28
"""Added to a heading: the device marks this packet as the first of a revolution."""

RESTARTS = 1 << 29
"""Added to a heading: the stream began anew with this packet; it does not continue the one before."""


Headings: TypeAlias = Sequence[int] | NDArray[np.integer[Any]]
"""Start angles of consecutive packets: a list where they are few, an array where that is cheaper."""


class Cut(NamedTuple):
    """Where the next stretch of a stream ends.

    Attributes:
        run: End of the intact packets that begin at the place asked about.
        noise: End of the noise behind them; equal to `run` when there is none.
        packets: Number of packets in the run.
    """

    run: int
    noise: int
    packets: int


class StreamFormat(ABC):
    """One measurement format, following one stream.

    Attributes:
        name: The documents' name of the format.
        answer_type: The type byte of the descriptor that announces it.
        header: What the first bytes of a packet look like.
        shortest: Bytes of the shortest packet; with fewer at hand, nothing can be decided.
        longest: Bytes of the longest packet.
        samples: Samples in one packet, where every packet has as many.
        full_turn: One turn in the unit of `headings`.
        first_seam: Heading at which revolutions begin; None when only marked packets (`BEGINS`) tell.
        self_evident: True when the check value is strong enough to need no second proof.
    """

    name: str
    answer_type: int
    header: re.Pattern[bytes]
    shortest: int
    longest: int
    samples: int
    full_turn: int
    first_seam: int | None = 0
    self_evident: bool = False

    def __init__(self) -> None:
        self._in_step = True
        self._due = 0

    @abstractmethod
    def measure(self, data: bytearray, at: int) -> int:
        """Length of the packet that begins at `at`: 0 to wait for more bytes, `NO_PACKET` if none can."""

    @abstractmethod
    def intact(self, data: bytearray, at: int, size: int) -> bool:
        """Whether the check value of the `size` bytes at `at` holds; they are all there."""

    @abstractmethod
    def headings(self, packets: bytes) -> Headings:
        """Start angle of each packet in units of one `full_turn`-th, `BEGINS` or `RESTARTS` added."""

    def offsets(self, packets: bytes) -> Sequence[int]:
        """Where each packet of a run begins, and where the last one ends; as it stands, for packets of one size."""
        return range(0, len(packets) + 1, self.shortest)

    def samples_in(self, packets: bytes) -> int:
        """Samples in a run of packets; as it stands, for packets of one size."""
        return len(packets) // self.shortest * self.samples

    def aside(self, data: bytearray, at: int) -> int:  # noqa: ARG002
        """Length of a known record that may stand between packets and is no measurement; as `measure`."""
        return NO_PACKET

    def run(self, data: bytearray, at: int) -> tuple[int, int]:
        """End and number of the intact packets that follow each other from `at`."""
        count, available = 0, len(data)
        while available - at >= self.shortest:
            size = self.measure(data, at)
            if size <= 0 or size > available - at or not self.intact(data, at, size):
                break
            at += size
            count += 1
        return at, count

    def cut(self, data: bytearray, at: int) -> Cut:
        """The next run of packets or stretch of noise from `at`; both ends at `at` mean: wait for more."""
        if self._in_step:
            end, count = self.run(data, at)
            if count:
                return Cut(end, end, count)
            aside = self._whole_aside(data, at)
            if aside:
                return Cut(at, at + aside, 0)
            size = self.measure(data, at) if at < len(data) else 0
            if not self._decidable(data, at, size):
                return Cut(at, at, 0)
            if size == NO_PACKET and self.aside(data, at) == 0:
                return Cut(at, at, 0)
            self._in_step = False
            self._due = size
        noise = self._hunt(data, at)
        self._due -= noise - at
        if noise == at and self._in_step:
            # The packet that was waited for begins right here, and it is whole.
            end, count = self.run(data, at)
            return Cut(end, end, count)
        return Cut(at, noise, 0)

    def _decidable(self, data: bytearray, at: int, size: int) -> bool:
        return size == NO_PACKET or 0 < size <= len(data) - at

    def _whole_aside(self, data: bytearray, at: int) -> int:
        size = self.aside(data, at) if at < len(data) else 0
        return size if 0 < size <= len(data) - at else 0

    def _hunt(self, data: bytearray, at: int) -> int:
        """Where the noise that begins at `at` ends, as far as the bytes at hand can tell."""
        place = at
        while True:
            found = self.header.search(data, place)
            if found is None:
                # The last byte may be the first of a header.
                return max(place, len(data) - 1)
            place = found.start()
            size = self.measure(data, place)
            if size == 0 or size > len(data) - place:
                return place
            if size > 0 and self.intact(data, place, size):
                proof = self._proof(data, place, size, due=at + self._due)
                if proof is None:
                    return place
                if proof:
                    self._in_step = True
                    return place
            elif size > 0 and place == at + self._due:
                # Damaged, but in step: the one behind it is due where this one ends.
                self._due += size
            place += 1

    def _proof(self, data: bytearray, place: int, size: int, due: int) -> bool | None:
        """Whether the intact packet at `place` is a real one; None while the bytes to tell are missing."""
        if self.self_evident or place == due:
            return True
        behind = place + size
        if behind >= len(data):
            return None
        follower = self.measure(data, behind)
        if follower == NO_PACKET:
            follower = self.aside(data, behind)
        return None if follower == 0 else follower != NO_PACKET
