"""Which true sample is a point that was delivered? Its distance tells: the number of the sample is coded in it.

So a point is known independently of its angle and its time, which are what is judged. The distance of a sample
holds its place in its packet and a digit of the number of the packet. Where a format has room for few distances
only, the number takes several digits, which neighbours hold in turn: sample 0 the lowest, sample 1 the next, and so
on again and again. A point is known when its neighbours of the same packet hold the other digits.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Ints = NDArray[np.int64]
Floats = NDArray[np.float64]

UNKNOWN = -1
UNTOLD = -2


@dataclass(frozen=True, slots=True)
class Code:
    """How numbers are coded in the distances of one format.

    Attributes:
        base: Millimetres that the word 0 stands for.
        step: Millimetres from one word to the next.
        words: How many words there are.
        samples: Most samples of a packet.
        packets: The numbers of packets are below this.
    """

    base: float
    step: float
    words: int
    samples: int
    packets: int

    @property
    def radix(self) -> int:
        """How many values a digit has."""
        return self.words // self.samples

    @property
    def digits(self) -> int:
        """How many digits the number of a packet takes."""
        digits, reach = 1, self.radix
        while reach < self.packets:
            digits, reach = digits + 1, reach * self.radix
        if digits > 1 and self.samples < digits:
            raise ValueError(f"{self.samples} samples have no room for {digits} digits")
        return digits

    def millimetres(self, packet: Ints, place: Ints) -> Floats:
        """The distances of samples, by the number of their packet and their place in it."""
        digit = packet // self.radix ** (place % self.digits) % self.radix
        return self.base + self.step * (place * self.radix + digit)

    def decode(self, millimetres: NDArray[np.float32]) -> tuple[Ints, Ints]:
        """Numbers of packets and places in them, of the points of a scan in their order.

        The number is `UNKNOWN` where no sample has that distance, and `UNTOLD` where several samples may be meant.
        """
        exact = (millimetres.astype(np.float64) - self.base) / self.step
        word = np.rint(exact).astype(np.int64)
        fits = (np.abs(exact - word) < 1e-3) & (word >= 0) & (word < self.radix * self.samples)
        place = np.where(fits, word // self.radix, UNKNOWN)
        digit = np.where(fits, word % self.radix, 0)
        if self.digits == 1:
            return np.where(fits & (digit < self.packets), digit, UNKNOWN), place
        # A packet's samples stand together, their places in order: such a run is of one packet.
        run = np.cumsum(np.diff(place, prepend=UNKNOWN - 2) != 1) - 1 if len(place) else place
        packet = np.full(int(run[-1]) + 1 if len(run) else 0, UNTOLD)
        held = self._held(run, place, digit, len(packet))
        # A sample whose digit is not that of the others has a distance that is none of its packet's.
        fits[fits] = digit[fits] == held[place[fits] % self.digits, run[fits]]
        whole = (held >= 0).all(axis=0)
        packet[whole] = (held[:, whole] * self.radix ** np.arange(self.digits)[:, None]).sum(axis=0)
        self._complete(packet, held)
        packet[packet >= self.packets] = UNKNOWN
        return np.where(fits, packet[run], UNKNOWN), place

    def _held(self, run: Ints, place: Ints, digit: Ints, runs: int) -> Ints:
        """The digits that most samples of each run hold, shape (digits, runs); `UNTOLD` where it has none."""
        held = np.full((self.digits, runs), UNTOLD)
        for each in range(self.digits):
            here = (place >= 0) & (place % self.digits == each)
            counts = np.bincount(run[here] * self.radix + digit[here], minlength=runs * self.radix)
            counts = counts.reshape(runs, self.radix)
            held[each] = np.where(counts.any(axis=1), counts.argmax(axis=1), UNTOLD)
        return held

    def _complete(self, packet: Ints, held: Ints) -> None:
        """Runs that are too short to hold all digits: they lie between their neighbours, where only one fits."""
        known = np.flatnonzero(packet >= 0)
        for at in np.flatnonzero((packet < 0) & (held >= 0).any(axis=0)).tolist():
            after = int(np.searchsorted(known, at))
            before = [int(packet[each]) for each in known[:after][-1:]]
            behind = [int(packet[each]) for each in known[after:][:1]]
            if not before + behind:
                continue
            first = before[0] + 1 if before else behind[0] - self.radix
            last = behind[0] - 1 if behind else before[0] + self.radix
            tried = np.arange(max(first, 0), min(last, first + 4 * self.radix) + 1)
            for each in range(self.digits):
                if held[each, at] >= 0:
                    tried = tried[tried // self.radix**each % self.radix == held[each, at]]
            if len(tried) == 1:
                packet[at] = tried[0]
