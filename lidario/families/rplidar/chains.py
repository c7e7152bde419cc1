"""Chains of 0x81 nodes. A node has only two check bits, so it is believed if nodes follow each other: a chain.

A chain is tested one node after the other at the place where it is expected. On a line of noise or heavy damage
there is no such place, and testing at each byte costs many times as much as a clean line, up to 70 % of a core. So
a few places that look like nodes are tested singly, and behind them all places of a window at once, as arrays.

Models that triangulate give for a return the angle at which it lies, up to 8 degrees behind the beam, and for a
sample without a return the angle of the beam (transcripts of an A1M8). So angles leap ahead where returns end, and
fall back where they begin. The distance shows how far a return lies behind the beam, as in 0x84. So the beams
follow each other in small steps where the angles do not. It is not known which of the two a device gives.

Many samples have a quality and no distance: a quarter of all, when an A1M8 stood in an open room (measured by the
authors of cpane/heron). Their angles may be corrected like those of returns, but it is not known by how much. So
such a node only shows between which angles the beam was.
"""

import re
from functools import cache
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from lidario.families.rplidar.cabins import near_range_corrections

SIZE: Final = 5
FULL_TURN_Q6: Final = 360 << 6
BACKWARD_Q6: Final = 3 << 6
"""How far a node may fall back behind the one before: the angles of near returns scatter by this."""
FORWARD_Q6: Final = 8 << 6
"""How far a node may be ahead of the one before while in step: a few lost nodes at the slowest rate."""
NEAR_Q6: Final = 30 << 6  # a chain that begins within this of the last angle continues it
SEAM_Q6: Final = 30 << 6  # new-scan marks within this of each other stand at the same place
_NEAREST_MM: Final = 120  # no device measures nearer distances: an A1M8 has measured 126.8 mm
_CORRECTED_Q6: Final = 12 << 6
"""Corrections differ by less: a return lies from 3.6 degrees before the beam, if it is nearest, to 8 behind it."""
_UNTOLD_Q6: Final = 2 << 6
"""A sample with a quality and no distance is taken to lie this far behind the beam, in the middle of the range."""
CHAIN_IN_PHASE: Final = 4
"""In the old phase this many nodes must follow each other, the first of them near the last angle."""
CHAIN_ALONE: Final = 16
"""In another phase this many nodes must follow each other. One wrong phase in four passes the check bits of a node,
so on random bytes a chain of 16 passes once in 4 billion times."""

_CHECKED_CHAIN: Final = re.compile(
    b"(?:[%b][%b][\\x00-\\xb3][\\x00-\\xff]{2}){%d}"
    % (
        b"".join(b"\\x%02x" % byte for byte in range(256) if (byte ^ byte >> 1) & 1),
        b"".join(b"\\x%02x" % byte for byte in range(1, 256, 2)),
        CHAIN_IN_PHASE,
    ),
    re.DOTALL,
)
"""Nodes in a row whose check bits hold and whose angles are below 360 degrees; a pattern is faster than a loop."""


class Heading(NamedTuple):
    """What a node tells about the rotor, in 1/64 degrees."""

    angle: int
    beam: int  # where the beam was, if the angle is that of a return beside it
    blur: int = 0  # by how much `beam` may be wrong: above 0 for a sample with a quality and no distance


def angle_at(data: bytes | bytearray, at: int) -> int:
    """The angle of the node at `at`, in 1/64 degrees."""
    return data[at + 1] >> 1 | data[at + 2] << 7


def heading_at(data: bytes | bytearray, at: int) -> Heading:
    """The heading of the node at `at`."""
    angle, distance = angle_at(data, at), data[at + 3] | data[at + 4] << 8
    if not distance and data[at] >> 2:
        return Heading(angle, (angle + _UNTOLD_Q6) % FULL_TURN_Q6, _CORRECTED_Q6 // 2)
    return Heading(angle, (angle + int(_behind_beam()[distance])) % FULL_TURN_Q6)


def beams_of(angle: NDArray[np.int32], distance: NDArray[Any]) -> NDArray[np.int32]:
    """`Heading.beam` for many nodes without a blur, from their angles and distances."""
    beams: NDArray[np.int32] = (angle + _behind_beam().take(distance)) % FULL_TURN_Q6
    return beams


@cache
def _behind_beam() -> NDArray[np.int32]:
    """How far behind the beam a return lies, in 1/64 degrees, by its distance in 1/4 mm; 0 for no return."""
    millimetres = np.maximum(np.arange(1 << 16) >> 2, _NEAREST_MM)
    behind: NDArray[np.int32] = near_range_corrections(64.0).take(millimetres).astype(np.int32)
    behind[0] = 0
    return behind


def apart(one: int, other: int) -> int:
    """1/64 degrees between two angles, the short way."""
    return min((one - other) % FULL_TURN_Q6, (other - one) % FULL_TURN_Q6)


def is_far(angle: int) -> bool:
    """Whether a mark at an angle stands elsewhere than at 0."""
    return apart(angle, 0) > SEAM_Q6


def fits(angle: int, mark: int | None) -> bool:
    """Whether a mark may stand at an angle: where the others do (`mark`), or at 0; the first mark, anywhere."""
    return mark is None or not is_far(angle) or apart(angle, mark) <= SEAM_Q6


def step_between(earlier: int, later: int) -> int:
    """1/64 degrees from one angle to the next; falling back a little counts as 0."""
    step = (later - earlier) % FULL_TURN_Q6
    return 0 if step >= FULL_TURN_Q6 - BACKWARD_Q6 else step


def _beam_step(earlier: Heading, later: Heading) -> int:
    """The smallest step from one beam to the next that the blur allows, 1/64 degrees; negative if it falls back."""
    blur = earlier.blur + later.blur
    step = _signed(earlier.beam, later.beam, BACKWARD_Q6 + blur)
    return max(0, step - blur) if step > 0 else min(0, step + blur)


def ahead_of(last: Heading, data: bytearray, at: int) -> int:
    """1/64 degrees by which the node at `at` is ahead of the last one: by angles or by beams, whichever is less."""
    here = heading_at(data, at)
    return min(step_between(last.angle, here.angle), max(0, _beam_step(last, here)))


def chain_steps(data: bytearray, at: int, length: int, mark: int | None) -> list[int] | None:
    """The steps between `length` nodes from `at`, or None if one of them cannot follow the other."""
    steps: list[int] = []
    last, marks = -1, 0
    for place in range(at, at + length * SIZE, SIZE):
        first, second = data[place], data[place + 1]
        if not ((first ^ first >> 1) & second & 1):
            return None
        angle = angle_at(data, place)
        if angle >= FULL_TURN_Q6:
            return None
        if first & 1:
            marks += 1
            # No chain is as long as a revolution, so it has one mark at most; this holds while `mark` is not known.
            if not fits(angle, mark) or (mark is None and marks > 1):
                return None
        if last >= 0:
            step = _signed(last, angle, BACKWARD_Q6)
            if step > FORWARD_Q6 and apart(last, angle) <= FORWARD_Q6 + _CORRECTED_Q6:
                step = _beam_step(heading_at(data, place - SIZE), heading_at(data, place))
            if step > FORWARD_Q6:
                return None
            steps.append(step)
        last = angle
    return steps


def _signed(earlier: int, later: int, back: int) -> int:
    """1/64 degrees from one angle to the next; negative if it falls back by up to `back`."""
    return (later - earlier + back) % FULL_TURN_Q6 - back


_BY_HAND: Final = 3
"""This many places that look like nodes are tested singly first: with little damage, the next chain is near."""
_WINDOW: Final = 1024
"""Places that are tested at once. Measured: 50 us for all of them."""
_REACH: Final = CHAIN_ALONE * SIZE  # bytes of the longest chain


def next_chain(data: bytearray, at: int, last: Heading | None, mark: int | None) -> int | None:
    """The first place from `at` on where nodes may go on: a chain near `last`, or a longest chain; else None.

    The place is only likely: a few are found where no chain begins. `last` is the heading of the last node that was
    believed, if any; `mark` is where marks stand, if known.
    """
    place = at
    for _ in range(_BY_HAND):
        found = _CHECKED_CHAIN.search(data, place)
        if found is None:
            return None
        place = found.start()
        near = last is not None and ahead_of(last, data, place) <= NEAR_Q6
        length = CHAIN_IN_PHASE if near else CHAIN_ALONE
        if len(data) - place < length * SIZE or chain_steps(data, place, length, mark) is not None:
            return place
        place += 1
    for begin in range(place, len(data), _WINDOW):
        # Each place needs the bytes of the longest chain behind it.
        likely = _likely(np.frombuffer(data, np.uint8)[begin : begin + _WINDOW + _REACH], last, mark)
        places = likely[:_WINDOW].nonzero()[0]
        if len(places):
            return begin + int(places[0])
    return None


def _likely(raw: NDArray[np.uint8], last: Heading | None, mark: int | None) -> NDArray[np.bool_]:
    """At which places of the bytes a chain may begin, as in `next_chain`."""
    if len(raw) < _REACH:
        return np.zeros(0, np.bool_)
    first, second = raw[:-2], raw[1:-1]
    angle = raw[2:].astype(np.int32) << 7
    angle |= second >> 1
    whole = ((first ^ first >> 1) & second & 1).view(np.bool_)
    whole &= angle < FULL_TURN_Q6
    marked = (first & 1).view(np.bool_)
    if mark is not None:
        whole &= ~marked | _within(angle, -SEAM_Q6, SEAM_Q6) | _within(angle - mark, -SEAM_Q6, SEAM_Q6)
    # Angles may leap by as much as corrections allow. Computing the beams instead would take twice the time.
    back = -BACKWARD_Q6 - _CORRECTED_Q6
    follows = _within(angle[SIZE:] - angle[:-SIZE], back, FORWARD_Q6 + _CORRECTED_Q6)
    follows &= whole[SIZE:]
    follows &= whole[:-SIZE]
    if mark is None:
        follows &= ~(marked[SIZE:] & marked[:-SIZE])
    # Whether two, four and eight steps in a row follow each other from a place.
    two = follows[:-SIZE] & follows[SIZE:]
    four = two[: -2 * SIZE] & two[2 * SIZE :]
    eight = four[: -4 * SIZE] & four[4 * SIZE :]
    count = len(eight) - 7 * SIZE
    alone: NDArray[np.bool_] = (
        eight[:count] & four[8 * SIZE :][:count] & two[12 * SIZE :][:count] & follows[14 * SIZE :][:count]
    )
    if last is None:
        return alone
    likely: NDArray[np.bool_] = two[:-SIZE] & follows[2 * SIZE :]
    likely &= _within(angle[: len(likely)] - last.angle, back, NEAR_Q6 + _CORRECTED_Q6)
    likely[:count] |= alone
    return likely


def _within(difference: NDArray[np.int32], least: int, most: int) -> NDArray[Any]:
    """Where the difference of two angles lies from `least`, a negative number, to `most`."""
    inside: NDArray[Any] = (difference - least) % FULL_TURN_Q6 <= most - least
    return inside
