"""The packets of one stretch of stream, decoded at once into arrays.

Angles (4ROS development manual, figure 7): a packet states the angles of its first and its last sample, and
those between lie at equal steps. An end before its beginning has crossed 0. Unlike the vendor's SDK, which
truncates to 1/64 degrees, full precision is kept; a single sample has the first angle, without a division. A
time-of-flight device needs no second, distance-dependent correction, and distances are plain millimetres;
there is no intensity.

Speed (manual): the 7 bits above CT's start bit are tenths of Hz above 3.0. They mean that in start packets
alone; the SDK reads any packet's, and takes 3.0 Hz for "no speed".

Lost packets: within one packet the angle advances by one step a sample, and so it does from one packet to the
next. What the jump between two packets holds beyond that was lost. How many packets it was follows from their
usual length; but the last packet of a turn is shorter, and a start packet holds one sample: it is missed when
packets pass the place where the one before stood.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from lidario.families.base import Samples
from lidario.families.ydlidar.formats import FULL_TURN_Q6, HEADER_SIZE, START_BIT, packet_offsets

__all__ = ["PointCloudDecoder", "speed_hz"]

Ints = NDArray[np.int64]

LOWEST_SPEED: Final = 30
"""Tenths of Hz that the speed code 0 stands for."""
HEADER_WORDS: Final = HEADER_SIZE // 2
SLACK_SAMPLES: Final = 3.0
"""Missing samples below which a jump is taken for unsteadiness of the rotor, where no start packet is due."""
BACKWARD_Q6: Final = 2 << 6
"""How far a packet may begin before the end of the one before, without a turn being missing."""


def speed_hz(packet: bytes) -> float | None:
    """Scan frequency in Hz that a start packet tells; None for any other packet."""
    return (LOWEST_SPEED + (packet[2] >> 1)) / 10 if packet[2] & START_BIT else None


class PointCloudDecoder:
    """Decodes the packets of one stream.

    Attributes:
        speed_hz: Scan frequency in the last start packet; None before there was one.
        unmarked: Packets so far whose C bit was 0. Documents say it is always 1; nothing else depends on it.
    """

    def __init__(self) -> None:
        self.speed_hz: float | None = None
        self.unmarked = 0
        self._seam: int | None = None
        self._usual = 0.0

    def decode(self, packets: bytes, following: bytes | None) -> Samples:
        """As `Decoder.decode`."""
        words = np.frombuffer(packets, "<u2")
        places = np.array(packet_offsets(packets)) >> 1
        control = words[places + 1].astype(np.int64)
        counts = control >> 8
        fsa = words[places + 2].astype(np.int64)
        first = (fsa >> 1) % FULL_TURN_Q6
        way = ((words[places + 3].astype(np.int64) >> 1) - first) % FULL_TURN_Q6
        way[counts == 1] = 0
        starts = control & START_BIT == START_BIT

        ends = np.cumsum(counts)
        order = np.arange(ends[-1])
        index = order - np.repeat(ends - counts, counts)
        beam = np.repeat(way, counts) * index / np.repeat(np.maximum(counts - 1, 1), counts)
        beam += np.repeat(first, counts)
        beam /= 64.0
        angle = beam.copy()
        angle[angle >= 360.0] -= 360.0
        sources = order + np.repeat(HEADER_WORDS * np.arange(1, len(counts) + 1), counts)

        self.unmarked += int(np.count_nonzero(fsa & 1 == 0))
        missing = self._missing(first, way, counts, starts, following)
        if starts.any():
            last = 2 * int(places[starts][-1])
            self.speed_hz = speed_hz(packets[last : last + HEADER_SIZE])
        gaps = np.flatnonzero(missing)
        return Samples(
            beam_deg=beam,
            angle_deg=angle,
            distance_mm=words[sources].astype(np.float32),
            intensity=None,
            ends=ends.astype(np.intp),
            lost=int(missing.sum()),
            unbroken=int(gaps[0]) + 1 if len(gaps) else len(counts),
        )

    def _missing(
        self, first: Ints, way: Ints, counts: Ints, starts: NDArray[np.bool_], following: bytes | None
    ) -> Ints:
        """Packets missing behind each packet, shape (packets,)."""
        missing = np.zeros(len(first), np.int64)
        if starts.any():
            self._seam = int(first[starts][0])
        heads, marks = np.empty_like(first), np.zeros_like(starts)
        heads[:-1], marks[:-1] = first[1:], starts[1:]
        heads[-1] = first[-1] + way[-1]
        if following is not None:
            heads[-1], marks[-1] = _heading(following), following[2] & START_BIT
        steps = int((counts - 1).sum())
        step = int(way.sum()) / steps if steps else 0.0
        if step:
            self._usual = float(np.median(counts[counts > 1]))
            tails = first + way
            jumps = (heads - tails) % FULL_TURN_Q6
            jumps[jumps > FULL_TURN_Q6 - BACKWARD_Q6] = 0
            # Nothing is missing in a jump of one step; half a step more is the least that can mean something.
            for at in np.flatnonzero(jumps > 1.5 * step).tolist():
                missing[at] = self._lost_in(int(tails[at]), int(jumps[at]), bool(marks[at]), step)
        if starts.any():
            self._seam = int(first[starts][-1])
        return missing

    def _lost_in(self, tail: int, jump: int, marked: bool, step: float) -> int:
        """Packets lost between two: `jump` beyond the angle `tail`, the second one a start packet or not."""
        if marked:
            return self._packets_before_seam(jump / step - 1)
        if self._seam is not None:
            to_seam = (self._seam - tail) % FULL_TURN_Q6
            if 0 < to_seam < jump:
                before = self._packets_before_seam(to_seam / step - 1)
                return before + 1 + self._full_packets((jump - to_seam) / step - 1)
        return self._full_packets(jump / step - 1)

    def _full_packets(self, samples: float) -> int:
        return 0 if samples < SLACK_SAMPLES else max(1, round(samples / self._usual))

    def _packets_before_seam(self, samples: float) -> int:
        return 0 if samples < SLACK_SAMPLES else math.ceil((samples - SLACK_SAMPLES) / self._usual) or 1


def _heading(packet: bytes) -> int:
    return (packet[4] >> 1 | packet[5] << 7) % FULL_TURN_Q6
