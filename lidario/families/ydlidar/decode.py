"""The packets of one stretch of stream, decoded at once into arrays.

Angles (4ROS development manual, figure 7): a packet states the angles of its first and its last sample, and
those between lie at equal steps. An end before its beginning has crossed 0. Unlike the vendor's SDK, which
truncates to 1/64 degrees, full precision is kept; a single sample has the first angle, without a division. A
time-of-flight device needs no second, distance-dependent correction, and distances are plain millimetres;
there is no intensity.

The 7 bits above CT's start bit tell the speed in start packets (manual: tenths of Hz above 3.0). It is handed on
as what the device reports; the speed of a scan is measured, which is right for every format.

Lost packets: what the jump between two packets holds beyond one step was lost (`jumps`). How many packets it was
follows from their usual length; but the last packet of a revolution is shorter, and a start packet holds one
sample: it is missed when packets pass the place where the one before stood.
"""

from __future__ import annotations

import copy
import math
from collections.abc import Sequence
from functools import cache
from typing import Final, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from lidario.families.base import Samples, SteadySamples
from lidario.families.ydlidar.formats import (
    FULL_TURN_Q6,
    HEADER_SIZE,
    START_BIT,
    packet_heads,
)
from lidario.families.ydlidar.jumps import ONE_STEP, SLACK_SAMPLES, heading_of, jumps_between, mended
from lidario.families.ydlidar.steps import CHANGING, FEWEST, STEADY, Ints, Steps, changing_steps, mean_step
from lidario.wire.events import Packets

__all__ = ["Heads", "PointCloudDecoder"]

HEADER_WORDS: Final = HEADER_SIZE // 2
SPEED_CODE: Final = 0x7F
SPEED_BASE: Final = 30
"""Tenths of Hz that the code 0 stands for (manual, CT)."""


class PointCloudDecoder:
    """Decodes the packets of one stream.

    Attributes:
        speed_base: Tenths of Hz that the speed 0 in a start packet stands for.
    """

    speed_base: int = SPEED_BASE

    def __init__(self) -> None:
        self._seam: int | None = None
        # Samples of an ordinary packet, or of the longest one while so few came that all may be short.
        self._ordinary = 0

    def decode(self, packets: Packets, following: bytes | None, room: int = 0, seam: int | None = None) -> Samples:
        """As `Decoder.decode`."""
        heads = Heads.of(packets)
        first, way, counts, _, _ = heads
        ends = np.add.accumulate(counts).tolist()
        angle, distance, intensity = self._samples_of(packets, heads, ends, room)
        most, farthest = int(np.maximum.reduce(counts)), int(np.maximum.reduce(way))
        self._learn(most, len(counts))
        step = mean_step(way, counts, most, farthest, ends[-1])
        steps = changing_steps(way, counts) if farthest > CHANGING * step * (most - 1) else None
        if steps is not None:
            # Not of the ways themselves: a short packet may be the one whose way is farthest, by damage.
            step = float(np.add.reduce(steps * (counts - 1))) / (ends[-1] - len(counts))
        missing, skipped, step = self._missing(heads, following, step, steps)
        gaps = missing.nonzero()[0]
        samples_a_turn = FULL_TURN_Q6 / step if step else 0.0
        return Samples(
            angle_deg=angle,
            distance_mm=distance,
            intensity=intensity,
            before_seam=ends[-1] - _behind_seam(int(first[-1]), int(heads.way[-1]), int(counts[-1]), seam),
            ends=ends,
            lost=int(np.add.reduce(missing)) if len(gaps) else 0,
            unbroken=int(gaps[0]) + 1 if len(gaps) else len(counts),
            lost_behind=int(missing[-1]) if len(gaps) else 0,
            revolution_packets=_revolution_packets(samples_a_turn, self._ordinary) if step else 0.0,
            revolution_samples=samples_a_turn,
            certain=step > 0,
            reported_rpm=_reported_rpm(heads, 0, len(counts), self.speed_base),
            gaps=[(ends[at], samples) for at, samples in skipped],
        )

    def tell_time(self, sample_ns: float) -> None:
        """As `Decoder.tell_time`; packets tell how far the rotor turned."""

    def fork(self) -> Self:
        """As `Decoder.fork`."""
        return copy.copy(self)

    def decode_steady(
        self, packets: Packets, following: bytes, ends: Sequence[int], room: int = 0, seam: int | None = None
    ) -> SteadySamples | None:
        """As `Decoder.decode_steady`."""
        heads = Heads.of(packets)
        first, way, counts, starts, _ = heads
        sample_ends = np.add.accumulate(counts).tolist()
        begins = [0, *ends[:-1]]
        packet_ends = [sample_ends[end - 1] for end in ends]
        most = np.maximum.reduceat(counts, begins).tolist()
        turned = np.add.reduceat(way, begins, dtype=np.int64).tolist()
        longest = np.maximum.reduceat(way, begins).tolist()
        farthest = np.maximum.reduceat(jumps_between(first, first + way, following), begins).tolist()
        a_turn: list[float] = []
        for at, (begin, end) in enumerate(zip(begins, ends, strict=True)):
            steps = packet_ends[at] - (packet_ends[at - 1] if at else 0) - (end - begin)
            step = turned[at] / steps if steps else 0.0
            if (
                end - begin < FEWEST
                or not step
                or longest[at] > STEADY * step * (most[at] - 1)
                or farthest[at] > ONE_STEP * step
            ):
                return None
            a_turn.append(FULL_TURN_Q6 / step)
        angle, distance, intensity = self._samples_of(packets, heads, sample_ends, room)
        marked = starts.nonzero()[0]

        def settle() -> None:
            self._ordinary = most[-1]
            if len(marked):
                self._seam = int(first[marked[-1]])

        return SteadySamples(
            angle_deg=angle,
            distance_mm=distance,
            intensity=intensity,
            packet_ends=packet_ends,
            before_seam=packet_ends
            if seam is None
            else [
                packet_ends[at] - _behind_seam(int(first[end - 1]), int(way[end - 1]), int(counts[end - 1]), seam)
                for at, end in enumerate(ends)
            ],
            revolution_packets=[
                _revolution_packets(samples, each) for samples, each in zip(a_turn, most, strict=True)
            ],
            revolution_samples=a_turn,
            settle=settle,
            reported_rpm=[_reported_rpm(heads, *each, self.speed_base) for each in zip(begins, ends, strict=True)],
        )

    def _samples_of(
        self, packets: Packets, heads: Heads, ends: list[int], room: int
    ) -> tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.uint8] | None]:
        """Degrees, millimetres and intensities behind `room` free places; `ends` counts up to each packet."""
        first, way, counts, _, _ = heads
        angle, distance = np.empty(room + ends[-1], np.float32), np.empty(room + ends[-1], np.float32)
        _fill(angle[room:], distance[room:], packets, heads)
        for across in (first + way >= FULL_TURN_Q6).nonzero()[0].tolist():
            samples = int(counts[across])
            beam = _beam_deg(int(first[across]), int(way[across]), samples)
            angle[room + ends[across] - samples : room + ends[across]] = np.where(beam < 360.0, beam, beam - 360.0)
        return angle, distance, None

    def _missing(
        self, heads: Heads, following: bytes | None, step: float, steps: Steps | None
    ) -> tuple[NDArray[np.intp], list[tuple[int, int]], float]:
        """Packets missing behind each packet, shape (packets,), empty where none is; their samples; the step.

        Args:
            heads: What stands before the samples of each.
            following: The packet behind them, if it is known.
            step: The mean angle from one sample to the next.
            steps: The same of each packet, where it changes.
        """
        first, way, counts, starts, _ = heads
        marked = starts.nonzero()[0]
        if len(marked):
            self._seam = int(first[marked[0]])
        elif self._seam is None and following is not None and following[2] & START_BIT:
            # The first start packet may be among those that are missing: the place where it stood is told behind.
            self._seam = heading_of(following)
        each = step if steps is None else steps
        tails = first + way
        jumps = jumps_between(first, tails, following)
        gaps = (jumps > ONE_STEP * each).nonzero()[0].tolist() if step else ()
        missing = np.zeros(len(first) if gaps else 0, np.intp)
        skipped: list[tuple[int, int]] = []
        if gaps:
            if steps is None:
                # The mean contains what is damaged.
                several = counts > 1
                each = float(np.median(way[several] / (counts[several] - 1))) or step
            # Not everywhere: an angle that is damaged, and does not look like a gap, does not matter here.
            better = mended(first, tails, jumps, following, counts, each)
            if better is not None:
                first, tails = better
                jumps = jumps_between(first, tails, following)
                step = int(np.add.reduce(tails - first)) / int(np.add.reduce(counts - 1)) or step
                gaps = (jumps > ONE_STEP * (step if steps is None else steps)).nonzero()[0].tolist()
            marks = [*starts[1:].tolist(), following is not None and bool(following[2] & START_BIT)]
            for at in gaps:
                here = step if steps is None else float(steps[at])
                missing[at] = self._lost_in(int(tails[at]), int(jumps[at]), marks[at], here)
                if missing[at]:
                    skipped.append((at, max(0, round(int(jumps[at]) / here) - 1)))
        if len(marked):
            self._seam = int(first[marked[-1]])
        return missing, skipped, step

    def _learn(self, longest: int, packets: int) -> None:
        """Update the size of an ordinary packet. Of a few packets, all may be short: then it only grows."""
        self._ordinary = longest if packets >= FEWEST else max(self._ordinary, longest)

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
        return 0 if samples < SLACK_SAMPLES else max(1, round(samples / self._ordinary))

    def _packets_before_seam(self, samples: float) -> int:
        return 0 if samples < SLACK_SAMPLES else math.ceil((samples - SLACK_SAMPLES) / self._ordinary) or 1


class Heads(NamedTuple):
    """What stands before the samples of each packet, shape (packets,) each.

    Attributes:
        first: Angle of the first sample, 1/64 degrees.
        way: From there to the last sample.
        counts: Samples.
        starts: Whether it is a start packet.
        control: The word that holds the number of samples, the mark of a start packet, and there the speed.
    """

    first: Ints
    way: Ints
    counts: Ints
    starts: NDArray[np.bool_]
    control: NDArray[np.uint16]

    @classmethod
    def of(cls, packets: Packets) -> Heads:
        """Those of so many packets."""
        heads = packet_heads(packets)
        control = heads[:, 1]
        counts = (control >> 8).astype(np.int32)
        first = (heads[:, 2] >> 1).astype(np.int32) % FULL_TURN_Q6
        way = ((heads[:, 3] >> 1) - first) % FULL_TURN_Q6
        way[counts == 1] = 0
        return cls(first, way, counts, (control & START_BIT).astype(np.bool_), control)


def _reported_rpm(heads: Heads, begin: int, end: int, speed_base: int) -> float:
    """What the first start packet among these says of the rotor's speed; NaN where none is there."""
    mark = begin + int(heads.starts[begin:end].argmax())
    if not heads.starts[mark]:
        return math.nan
    return 6.0 * ((int(heads.control[mark]) >> 1 & SPEED_CODE) + speed_base)


def _revolution_packets(samples: float, most: int) -> float:
    """Packets of a revolution of so many samples, at most `most` in each."""
    # The start packet holds one sample, the last packet of a revolution what is left.
    return 1.0 + math.ceil((samples - 1) / most)


def _fill(angle: NDArray[np.float32], distance: NDArray[np.float32], packets: Packets, heads: Heads) -> None:
    """Write degrees, counted on past 360, and millimetres of all samples."""
    first, way, counts, _, _ = heads
    words = np.frombuffer(packets.data, "<u2")
    # Whole numbers until the last division, so that it alone rounds; single precision holds them exactly.
    each = np.empty((len(first), 2), np.float32)
    np.multiply(first, np.maximum(counts - 1, 1), out=each[:, 0], casting="unsafe")
    each[:, 1] = way
    at = place = packet = 0
    for size, count in packets.blocks:
        samples = (size - HEADER_SIZE) // 2
        until, behind, end = at + count * samples, place + (count * size >> 1), packet + count
        if count == samples == 1:
            # Nearly always a start packet; two numbers are not worth an array.
            angle[at], distance[at] = first[packet] / 64.0, words[place + HEADER_WORDS]
            at, place, packet = until, behind, end
            continue
        distance[at:until].reshape(count, samples)[...] = words[place:behind].reshape(count, -1)[:, HEADER_WORDS:]
        grid = angle[at:until].reshape(count, samples)
        np.matmul(each[packet:end], _weights(samples), out=grid)
        grid /= 64.0 * max(samples - 1, 1)
        at, place, packet = until, behind, end


@cache
def _weights(samples: int) -> NDArray[np.float32]:
    """What the first angle of a packet, times its steps, and its way contribute to each of its samples."""
    return np.stack((np.ones(samples, np.float32), np.arange(samples, dtype=np.float32)))


def _beam_deg(first: int, way: int, samples: int) -> NDArray[np.float64]:
    """Where the rotor stood at each sample of one packet, counted on past 360."""
    steps = max(samples - 1, 1)
    beam: NDArray[np.float64] = (first * steps + way * np.arange(samples)) / (64.0 * steps)
    return beam


def _behind_seam(first: int, way: int, samples: int, seam: int | None) -> int:
    """How many samples of one packet were measured when the rotor had passed `seam`."""
    if seam is None or not way:
        return 0
    left = FULL_TURN_Q6 - (first - seam) % FULL_TURN_Q6
    return max(0, samples + (-left * (samples - 1) // way))
