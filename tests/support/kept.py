"""What is left of a damaged stream, point by point: which clean point each delivered one is, and how far it moved.

Which packets were accepted, and where in the clean stream they stand, is read from the events of the link and
the bytes themselves; a packet that was accepted although it differs from the clean one is `faulty`: its check
value cannot see the damage. All else is expected to be exactly the clean stream's samples.
"""

from bisect import bisect_left
from collections.abc import Callable, Sequence
from itertools import accumulate
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lidario.model import Scan
from tests.reference import damage
from tests.support.streams import Case, Sample, assembled, feed

__all__ = ["Kept", "accepted_by_place", "arrivals", "kept", "kept_without", "spoil_inside"]


class Kept(NamedTuple):
    """How the scans of a damaged stream compare with the clean turns.

    Attributes:
        scans: The scans.
        share: Points delivered, of those in the clean turns.
        moved: How far each point that should be untouched moved, in 1/64 degrees, shape (n,).
        wrong: Points among them whose distance is not the clean one.
        faulty: Packets accepted although they were damaged.
        missing: Packets of the whole turns that were not accepted.
        broken: Turns the assembler threw away.
        lost: Packets the assembler counts as lost.
    """

    scans: list[Scan]
    share: float
    moved: NDArray[np.float64]
    wrong: int
    faulty: int
    missing: int
    broken: int
    lost: int


def spoil_inside(case: Case, probability: float, seed: int) -> bytes:
    """The golden stream with flipped bits, but for the packets at the first turn's begin and the last one's end.

    A stream that is joined or left in the middle of a turn loses that turn by right; so the flips stay inside.
    """
    starts = [0, *accumulate(map(len, case.packets))]
    begin, end = starts[case.turns[0][0].packet + 2], starts[case.turns[-1][-1].packet - 1]
    spoiled = damage.flip(case.raw[begin:end], probability, seed)
    assert spoiled.touched
    return case.raw[:begin] + spoiled.raw + case.raw[end:]


def accepted_by_place(case: Case, raw: bytes) -> tuple[list[int], set[int]]:
    """Numbers of the clean packets that were accepted, and of those that were though damaged; for flipped bits.

    A packet that begins where none begins in the clean stream is a mistake that nothing excuses.
    """
    assert len(raw) == len(case.raw)
    number_at = dict(zip(accumulate(map(len, case.packets), initial=0), range(len(case.packets)), strict=False))
    found = feed(case, raw).places(case, raw)
    accepted = [number_at[place] for place in found]
    faulty = {number_at[place] for place, packet in found.items() if case.packets[number_at[place]] != packet}
    return accepted, faulty


def kept_without(case: Case, lost: Sequence[int]) -> Kept:
    """What is kept when these packets are lost whole, and the others arrive when they would have anyway."""
    gone = set(lost)
    left = [number for number in range(len(case.packets)) if number not in gone]
    raw = b"".join(case.packets[number] for number in left)
    return kept(case, raw, left, set(), arrivals(case, left))


def arrivals(case: Case, left: Sequence[int]) -> Callable[[int], int]:
    """When the n-th byte of the packets that are left arrives, at the device's own pace."""
    starts = [0, *accumulate(map(len, case.packets))]
    ends = list(accumulate(len(case.packets[number]) for number in left))

    def times(offset: int) -> int:
        place = min(bisect_left(ends, offset), len(ends) - 1)
        return round((starts[left[place] + 1] - (ends[place] - offset)) * case.byte_ns)

    return times


def kept(
    case: Case,
    raw: bytes,
    accepted: Sequence[int],
    faulty: set[int],
    times: Callable[[int], int] | None = None,
) -> Kept:
    """Compare the scans of `raw` with the clean turns, none of which may be missing."""
    scans, stats, _ = assembled(case, raw, times=times)
    there = set(accepted)
    assert len(scans) == len(case.turns)
    points: list[Sample] = []
    measured: list[tuple[float, float]] = []
    for scan, turn in zip(scans, case.turns, strict=True):
        expected = [sample for sample in turn if sample.packet in there]
        # In front of a gap, a sample at the seam may be taken for its neighbour's turn.
        assert abs(len(expected) - len(scan)) <= (1 if case.lookahead else 0)
        points += expected
        measured += zip(scan.device_angles.tolist(), scan.device_distances.tolist(), strict=True)
    assert len(points) == len(measured)
    last = {number for number in there if number + 1 not in there}
    doubted = faulty | {number - 1 for number in faulty}
    moved, wrong = [], 0
    for point, (angle, distance) in zip(points, measured, strict=True):
        if point.packet in doubted:
            continue
        if distance == 0 and _leans_on_next(case, point, last):
            continue
        moved.append((angle - point.angle_deg + 180) % 360 - 180)
        wrong += abs(distance - point.distance_mm) > _slack_mm(case)
    first, end = case.turns[0][0].packet, case.turns[-1][-1].packet
    return Kept(
        scans,
        len(measured) / sum(map(len, case.turns)),
        np.abs(np.array(moved)) * 64,
        wrong,
        len(faulty),
        end + 1 - first - sum(first <= number <= end for number in there),
        stats.broken_scans,
        stats.lost_packets,
    )


def _leans_on_next(case: Case, point: Sample, last: set[int]) -> bool:
    """Whether the distance of a point is only told together with a packet that did not come (0x84)."""
    return case.response_type == 0x84 and point.packet in last and point.index >= 94


def _slack_mm(case: Case) -> float:
    """0x86 smooths with the sample before: behind a gap, a distance may differ by 1 mm."""
    return 1.0 if case.response_type == 0x86 else 0.0
