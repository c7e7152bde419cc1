"""What is left of a damaged stream, point by point: which clean point each delivered one is, and how far it moved.

Which packets were accepted, and where in the clean stream they stand, is read from the events of the link and
the bytes themselves; a packet that was accepted although it differs from the clean one is `faulty`: its check
value cannot see the damage. All else is expected to be exactly the clean stream's samples.
"""

from bisect import bisect_left
from collections.abc import Callable, Sequence
from functools import cache
from itertools import accumulate
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lidario.scans.scan import Scan
from tests.reference import damage
from tests.support.cases import Case
from tests.support.streams import assembled, feed


class Kept(NamedTuple):
    """How the scans of a damaged stream compare with the clean turns."""

    scans: list[Scan]
    share: float  # points delivered, of those in the clean turns
    moved: NDArray[np.float64]  # how far each point that should be untouched moved, in 1/64 degrees, shape (n,)
    wrong: int  # points among them whose distance is not the clean one
    faulty: int  # packets accepted although they were damaged
    missing: int  # packets of the whole turns that were not accepted
    broken: int  # turns the assembler threw away
    lost: int  # packets the assembler counts as lost


def settled(case: Case, packets: int) -> int:
    """The number of the first packet that may be lost, so many behind the beginning of the first turn.

    Where a turn has but a few packets, only its first seven make its angles certain.
    """
    first, next_turn = case.turns[0][0].packet, case.turns[1][0].packet
    return first + (7 if next_turn - first < 10 else packets)


def spoil_inside(case: Case, probability: float, seed: int) -> bytes:
    """The golden stream with flipped bits, but for the packets at the first turn's begin and the last one's end.

    A stream that is joined or left in the middle of a turn loses that turn by right; so the flips stay inside.
    """
    starts = [0, *accumulate(map(len, case.packets))]
    begin, end = starts[settled(case, 2)], starts[case.turns[-1][-1].packet - 1]
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
    case: Case, raw: bytes, accepted: Sequence[int], faulty: set[int], times: Callable[[int], int] | None = None
) -> Kept:
    """Compare the scans of `raw` with the clean turns, none of which may be missing."""
    scans, stats, _ = assembled(case, raw, times=times)
    there, doubted, last = (np.zeros(len(case.packets) + 1, bool) for _ in range(3))
    there[list(accepted)] = True
    last[:-1] = there[:-1] & ~there[1:]
    for number in faulty:
        doubted[max(0, number - 1) : number + 1] = True
    assert len(scans) == len(case.turns)
    points: list[NDArray[np.void]] = []
    for scan, turn in zip(scans, _turns(case), strict=True):
        points.append(turn[there[turn["packet"]]])
        # In front of a gap, a sample at the seam may be taken for its neighbour's turn.
        assert abs(len(points[-1]) - len(scan)) <= (1 if case.lookahead else 0)
    expected = np.concatenate(points)
    angles, distances = (
        np.concatenate([getattr(scan, name) for scan in scans]).astype(float)
        for name in ("device_angles", "device_distances")
    )
    assert len(expected) == len(angles)
    compared = ~doubted[expected["packet"]]
    if case.response_type == 0x84:  # what is told only together with a packet that did not come
        compared &= (distances > 0) | ~last[expected["packet"]] | (expected["index"] < 94)
    # Where nothing came back, a model that triangulates has the correction of the sample before, lost or not.
    placed = compared if case.response_type != 0x2D else compared & (distances > 0)
    moved = (angles - expected["angle"] + 180) % 360 - 180
    wrong = np.abs(distances - expected["distance"]) > _slack_mm(case)
    first, end = case.turns[0][0].packet, case.turns[-1][-1].packet
    return Kept(
        scans,
        len(angles) / sum(map(len, case.turns)),
        np.abs(moved[placed]) * 64,
        int(wrong[compared].sum()),
        len(faulty),
        int(end + 1 - first - there[first : end + 1].sum()),
        stats.broken_scans,
        stats.lost_packets,
    )


_POINT = np.dtype([("packet", int), ("index", int), ("angle", float), ("distance", float)])


@cache
def _turns(case: Case) -> tuple[NDArray[np.void], ...]:
    """The samples of the clean turns as arrays, shape (n,) each, of `_POINT`."""
    return tuple(
        np.array([(each.packet, each.index, each.angle_deg, each.distance_mm) for each in turn], _POINT)
        for turn in case.turns
    )


def _slack_mm(case: Case) -> float:
    """0x86 smooths with the sample before: behind a gap, a distance may differ by 1 mm."""
    return 1.0 if case.response_type == 0x86 else 0.0
