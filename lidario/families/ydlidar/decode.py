"""The packets of one stretch of stream, decoded at once into arrays.

Angles (4ROS development manual, figure 7): a packet states the angles of its first and its last sample, and the
samples between lie at equal steps. If the last angle is below the first, the packet has crossed 0. Full precision
is kept; the vendor's SDK truncates to 1/64 degrees. A single sample has the first angle, without a division.

The distance word counts millimetres (4ROS), or halves or quarters of one. Models that triangulate see with a lens
beside the laser. To the angle of the beam they add atan(21.8 (155.3 - d) / (155.3 d)), d in mm, and nothing if
there was no return. So neighbours may change places, and a sample may leave the span of its packet: revolutions are
divided by the angle of the beam. Intensities of 10 and 16 bits are reduced to eight.

In start packets, the 7 bits above CT's start bit tell the speed (manual: tenths of Hz above 3.0). It is handed on
as reported by the device. The speed of a scan is measured, which is right for every format.

Lost packets: the jump between two packets shows how many samples are missing (`lidario.families.told`). The usual
length of packets shows how many packets these were. But the last packet of a revolution is shorter, and a start
packet holds one sample. A start packet is lost if packets pass the place where the start packet before stood.
"""

import math
from bisect import bisect_left
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from lidario.families.arcs import ArcDecoder, Output, at_equal_steps, in_turn, write_degrees
from lidario.families.spans import LIKENESS, Arcs, Heads
from lidario.families.told import FEWEST, ToldWheel
from lidario.families.ydlidar.formats import (
    FULL_TURN_Q6,
    HEADER_SIZE,
    START_BIT,
    PointCloud,
    PointCloud3,
    PointCloud4,
    packet_heads,
)
from lidario.wire.events import Packets

SPEED_CODE: Final = 0x7F
LEAST_SAMPLES: Final = 0.5
"""Least gap, in samples: a start packet holds one sample, so half a sample is the least that can be real."""
SLACK_SAMPLES: Final = 3.0
"""If fewer samples are missing and no start packet is due, the jump is taken for unsteadiness of the rotor."""


@dataclass(frozen=True, slots=True)
class Kind:
    """How the samples of some models are to be read."""

    # Number of this kind in scan modes and recordings. On the wire it is always 0x81; the other numbers are
    # lidario's.
    response_type: int
    wire: type[PointCloud] = PointCloud  # the format of the packets
    unit: int = 4  # units of the distance word in a millimetre
    flags: bool = False  # whether the low two bits of the distance word do not belong to the distance
    bits: int = 0  # bits of the intensity; 0 if there is none
    triangle: bool = True  # whether the angle depends on the distance
    speed_base: int = 0  # tenths of Hz that the speed 0 stands for

    def decoder(self) -> "CloudDecoder":
        """A fresh decoder."""
        return CloudDecoder(self)


KINDS: Final = {
    "tg": Kind(PointCloud.response_type, unit=1, triangle=False, speed_base=30),
    "x": Kind(0xA1),
    "x-flags": Kind(0xA2, flags=True),
    "octave": Kind(0xA3, unit=2),
    "g2": Kind(0xA4, PointCloud3, flags=True, bits=10),
    "s4b": Kind(0xA5, PointCloud3, flags=True, bits=8),
    "tmini": Kind(PointCloud3.response_type, PointCloud3, flags=True, bits=8, triangle=False),
    "sh": Kind(PointCloud4.response_type, PointCloud4, unit=1, bits=16, triangle=False),
}
"""Every kind; the first is that of the 4ROS."""


class Control(NamedTuple):
    """The fields before the samples of packets, other than angles."""

    packets: Packets
    words: NDArray[np.uint16]  # (packets,): number of samples, mark of a start packet, and in these the speed
    marked: list[int]  # numbers of the start packets
    is_following_marked: bool  # whether the packet behind them is a start packet


class CloudDecoder(ArcDecoder):
    """Decodes the packets of one stream; without a `kind`, those of a 4ROS."""

    def __init__(self, kind: Kind = KINDS["tg"]) -> None:
        super().__init__(FULL_TURN_Q6, ToldWheel(FULL_TURN_Q6, LEAST_SAMPLES))
        self._kind = kind
        self.has_intensity: bool = bool(self._kind.bits)
        self._seam: int | None = None  # where the last start packet stood
        # Samples of an ordinary packet; or of the longest one, if so few came that all may be short.
        self._ordinary = 0

    def _heads(self, packets: Packets, following: bytes | None) -> Heads:
        heads = packet_heads(packets)
        words = heads[:, 1]
        counts = (words >> 8).astype(np.int32)
        first = (heads[:, 2] >> 1).astype(np.int32) % FULL_TURN_Q6
        way = ((heads[:, 3] >> 1) - first) % FULL_TURN_Q6
        way[counts == 1] = 0
        marked = (words & START_BIT).nonzero()[0].tolist()
        behind = None if following is None else (following[4] >> 1 | following[5] << 7) % FULL_TURN_Q6
        is_marked = following is not None and bool(following[2] & START_BIT)
        return Heads(first, behind, counts, way, Control(packets, words, marked, is_marked))

    def _write(self, heads: Heads, arcs: Arcs, output: Output) -> None:  # noqa: ARG002 - each packet tells its own
        kind, control, way = self._kind, heads.read, np.asarray(heads.way)
        data, each = np.frombuffer(control.packets.data, np.uint8), kind.wire.sample_size
        raw = np.empty((len(output.angle), each), np.uint8)
        # In double precision if there is a correction: the sum is rounded once.
        beams = np.empty(len(raw), np.float64) if kind.triangle else output.angle
        across = (heads.first + way >= FULL_TURN_Q6).nonzero()[0].tolist()[::-1]
        at = place = packet = 0
        for size, count in control.packets.blocks:
            samples = (size - HEADER_SIZE) // each
            until, behind, end = at + count * samples, place + count * size, packet + count
            if count == samples == 1:
                # Nearly always a start packet; one sample is not worth arrays.
                raw[at], beams[at] = data[place + HEADER_SIZE : behind], heads.first[packet] / 64.0
            else:
                raw[at:until].reshape(count, -1)[...] = data[place:behind].reshape(count, size)[:, HEADER_SIZE:]
                grid, steps = output.angle[at:until].reshape(count, samples), max(samples - 1, 1)
                at_equal_steps(heads.first[packet:end], way[packet:end], steps, grid)
                while across and across[-1] < end:
                    in_turn(grid[across.pop() - packet], FULL_TURN_Q6 * steps, back=False)
                np.divide(grid, 64.0 * steps, out=beams[at:until].reshape(count, samples), dtype=beams.dtype)
            at, place, packet = until, behind, end
        word = np.ascontiguousarray(raw[:, -2:]).view("<u2")[:, 0]
        output.distance[...] = word & 0xFFFC if kind.flags else word
        if kind.unit > 1:
            output.distance /= kind.unit
        if kind.triangle:
            d = output.distance.astype(np.float64)
            with np.errstate(divide="ignore"):
                aside = np.where(d > 0, np.degrees(np.arctan(21.8 * (155.3 - d) / (155.3 * d))), 0.0)
            write_degrees(beams + aside, output.angle)
        if kind.bits == 10:
            output.intensity[...] = (raw[:, 0] | (word & 3) << 8) >> 2
        elif kind.bits:
            # The upper eight of 16 bits, or all of eight.
            output.intensity[...] = raw[:, -3]
        # Remember what the next packets need.
        self._ordinary = self._longest(heads, 0, len(heads.first))
        if control.marked:
            self._seam = int(heads.first[control.marked[-1]])
        elif self._seam is None and control.is_following_marked:
            self._seam = heads.following

    def _lost(self, heads: Heads, at: int, skipped: int, step: float) -> int:
        """Packets lost behind packet `at`: a start packet holds one sample, the packet before it may be short."""
        control: Control = heads.read
        count = len(heads.first)
        ordinary = self._longest(heads, 0, count)
        if at + 1 in control.marked or (at + 1 == count and control.is_following_marked):
            return _packets_before_seam(skipped, ordinary)
        if control.marked:
            seam: int | None = int(heads.first[control.marked[0]])
        else:
            # The first start packet may be among those that are missing; the packet behind shows where it stood.
            seam = heads.following if self._seam is None and control.is_following_marked else self._seam
        if seam is not None:
            # By the mean step, not by the packets beside the gap: one of them may be damaged.
            tail = int(heads.first[at]) + (heads.count_of(at) - 1) * step
            to_seam = (seam - tail) % FULL_TURN_Q6 / step
            if 0 < to_seam < skipped + 1:
                before = _packets_before_seam(to_seam - 1, ordinary)
                return before + 1 + _full_packets(skipped - to_seam, ordinary)
        # Within a revolution each packet is an ordinary one, though a slower one covers a smaller angle.
        return _full_packets(skipped, ordinary) if skipped >= LIKENESS * ordinary else 0

    def _longest(self, heads: Heads, begin: int, end: int) -> int:
        """Samples of an ordinary packet. A few packets may all be short: then the number can only grow."""
        longest = int(np.maximum.reduce(np.asarray(heads.counts)[begin:end]))
        return longest if end - begin >= FEWEST else max(self._ordinary, longest)

    def _revolution_packets(self, heads: Heads, samples: float, begin: int, end: int) -> float:
        # The start packet holds one sample, the last packet of a revolution the rest.
        return 1.0 + math.ceil((samples - 1) / self._longest(heads, begin, end))

    def _reported_rpm(self, heads: Heads, begin: int, end: int) -> float:
        """The speed that the first start packet among these tells; NaN if there is none."""
        control: Control = heads.read
        marked = control.marked
        mark = bisect_left(marked, begin)
        if mark == len(marked) or marked[mark] >= end:
            return math.nan
        # A real X4 sends 0 in each start packet, which is no speed.
        return 6.0 * ((int(control.words[marked[mark]]) >> 1 & SPEED_CODE) + self._kind.speed_base) or math.nan


def _full_packets(samples: float, ordinary: int) -> int:
    return 0 if samples < SLACK_SAMPLES else max(1, round(samples / ordinary))


def _packets_before_seam(samples: float, ordinary: int) -> int:
    return 0 if samples < SLACK_SAMPLES else math.ceil((samples - SLACK_SAMPLES) / ordinary) or 1
