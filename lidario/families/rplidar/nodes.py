"""0x81, the plain node of five bytes: one sample a packet, and almost nothing to check it by.

Layout (S-series interface manual, response to SCAN): bit 0 of the first byte marks a new scan and bit 1 is its
inverse; bit 0 of the second byte is always 1; then 15 bits of angle in 1/64 degrees and 16 bits of distance in
1/4 mm. Two fixed bits let one wrong phase in four pass, and since walls are smooth, wrong phases pass many
times in a row. So a node is believed only in its context:

* in step, its angle must continue the one before by a small step, and a new-scan mark must stand where marks do;
* out of step, a chain of nodes must pass that test together. Nodes in the old phase that also continue the
  last angle need the shortest chain: a flipped bit costs one node. Another phase (a byte was lost) needs a
  longer chain that continues the last angle. A chain with nothing to continue, as at the beginning of a
  stream, must be the longest;
* where several phases pass, the one that advances evenly is the rotor: distances read as angles jump, or stand.

The manual does not say at which angle a scan begins. Most devices mark it at 0, where the angles tell as much.
Where the first mark of a stream stands elsewhere, or two in a row do at one place, revolutions follow those.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from typing import Final

import numpy as np

from lidario.wire.blocks import Block
from lidario.wire.events import Packets
from lidario.wire.formats import (
    BEGINS,
    HEADINGS_WORTH_AN_ARRAY,
    NO_PACKET,
    Headings,
    StreamFormat,
    Stretch,
)

__all__ = ["NODE", "NodeFormat"]

SIZE: Final = 5
FULL_TURN_Q6: Final = 360 << 6
BACKWARD_Q6: Final = 3 << 6
"""How far one node may fall back behind the other: triangulating models correct angles by about that much."""
FORWARD_Q6: Final = 8 << 6
"""How far one node may run ahead of the other while in step: a few lost nodes at the slowest rate."""
NEAR_Q6: Final = 30 << 6
"""A chain that begins within this of the last angle continues it."""
SEAM_Q6: Final = 30 << 6
"""New-scan marks within this of each other stand at the same place."""
CHAIN_IN_PHASE: Final = 4
"""Nodes in the old phase that must follow each other, the first of them near the last angle."""
CHAIN_NEARBY: Final = 8
"""Nodes in another phase that must follow each other, the first of them near the last angle."""
CHAIN_ALONE: Final = 16
"""Nodes that must follow each other where there is no last angle to continue. One wrong phase in four passes the
check bits of a node, so on random bytes a chain of 16 passes once in 4 billion times."""
PHASES_BACK: Final = 4
"""Nodes in the old phase that are tried before another phase is looked for."""
WORTH_AN_ARRAY: Final = 16
"""Nodes from which they are checked as one array. Measured: 1.2 us a node one by one, 18 us for the array."""

WINDOW: Final = (PHASES_BACK + CHAIN_ALONE) * SIZE
"""Bytes that must be there to tell whether nodes go on from a place."""

_CHECKED_CHAIN: Final = re.compile(
    b"(?:[%b][%b][\\x00-\\xb3][\\x00-\\xff]{2}){%d}"
    % (
        b"".join(b"\\x%02x" % byte for byte in range(256) if (byte ^ byte >> 1) & 1),
        b"".join(b"\\x%02x" % byte for byte in range(1, 256, 2)),
        CHAIN_IN_PHASE,
    ),
    re.DOTALL,
)
"""Nodes in a row whose check bits hold and whose angles are below 360 degrees: searched for faster than by hand."""

NODE: Final = np.dtype([("quality", "u1"), ("angle", "<u2"), ("distance", "<u2")])
_UNMARKED = 2
"""The two lowest bits of a node that begins no scan."""


class NodeFormat(StreamFormat):
    """0x81: one sample in five bytes."""

    name = "node"
    response_type = 0x81
    shortest = SIZE
    longest = SIZE
    samples = 1
    header: re.Pattern[bytes] = re.compile(rb"[\x00-\xff][\x00-\xff]", re.DOTALL)
    full_turn = FULL_TURN_Q6

    def __init__(self) -> None:
        super().__init__()
        self._in_step = False
        self._last: int | None = None
        # Where marks stand, once one was seen, and where the last one did that was not believed.
        self._mark: int | None = None
        # Whether a mark far from 0 was among the nodes that passed; None before any has.
        self._marked_far: bool | None = None
        self._other_mark = -FULL_TURN_Q6

    def measure(self, data: bytearray, at: int) -> int:
        """As `StreamFormat.measure`: by the two check bits alone."""
        if at + 1 >= len(data):
            return 0
        first = data[at]
        return SIZE if (first ^ first >> 1) & 1 and data[at + 1] & 1 else NO_PACKET

    def intact(self, data: bytearray, at: int, size: int) -> bool:  # noqa: ARG002
        """Whether the node at `at` may stand by itself: an angle below 360 degrees."""
        return _angle(data, at) < FULL_TURN_Q6

    def headings(self, packets: Packets) -> Headings:
        """As `StreamFormat.headings`, in 1/64 degrees. Only marks far from 0 are told: at 0 the angles do."""
        data = packets.data
        if len(data) < HEADINGS_WORTH_AN_ARRAY * SIZE:
            few = [_angle(data, place) for place in range(0, len(data), SIZE)]
            if self._marked_far is False:
                return few
            for place, first in enumerate(data[::SIZE]):
                if first & 1 and _apart(few[place], 0) > SEAM_Q6:
                    few[place] |= BEGINS
            return few
        nodes = np.frombuffer(data, NODE)
        many = nodes["angle"].astype(np.int32)
        many >>= 1
        if self._marked_far is False:
            return many
        for place in (nodes["quality"] & 1).nonzero()[0].tolist():
            if _apart(int(many[place]), 0) > SEAM_Q6:
                many[place] |= BEGINS
        return many

    def run(self, data: bytearray, at: int) -> Stretch:
        """Nodes from `at` that continue the last accepted angle, and each other."""
        count = (len(data) - at) // SIZE
        self._marked_far = bool(self._marked_far)
        done = 0
        while done < count and self._takes(data, at + done * SIZE):
            done += 1
            if done == 1 and count >= WORTH_AN_ARRAY:
                done += self._take_many(data, at + SIZE, count - 1)
                break
        end = at + done * SIZE
        return Stretch((Block(SIZE, done),) if done else (), end, end)

    def _takes(self, data: bytearray, at: int) -> bool:
        """Take the node at `at` if it continues the one before."""
        if not self._continues(data, at, self._last):
            return False
        self._last = _angle(data, at)
        if data[at] & 1:
            self._mark = self._last if self._mark is None else self._mark
            self._marked_far = self._marked_far or _apart(self._last, 0) > SEAM_Q6
        return True

    def _take_many(self, data: bytearray, at: int, count: int) -> int:
        """Take nodes that follow each other from `at`; how many of the `count` that are there."""
        done = 0
        for other in self._not_ordinary(data, at, count):
            if other > done:
                self._last = _angle(data, at + (other - 1) * SIZE)
            # It may be right all the same: a new scan's mark, or the first node behind 360 degrees.
            if not self._takes(data, at + other * SIZE):
                return other
            done = other + 1
        if count > done:
            self._last = _angle(data, at + (count - 1) * SIZE)
        return count

    def next_stretch(self, data: bytearray, at: int) -> Stretch:
        """As `StreamFormat.next_stretch`, with chains of nodes in place of a check value."""
        if self._in_step:
            nodes = self.run(data, at)
            if nodes.packets or len(data) - at < SIZE:
                return nodes
            if self._repeats(data, at):
                return self.run(data, at)
            self._in_step = False
        place = self._find_step(data, at)
        if place is None:
            return Stretch((), at, at)
        if place < 0:
            # No phase passes here, and none does where no short chain begins within reach.
            return Stretch((), at, min(self._next_chain(data, at + 1), len(data) - WINDOW + 1))
        self._in_step = True
        self._last = None
        if place > at:
            return Stretch((), at, place)
        return self.run(data, at)

    def _find_step(self, data: bytearray, at: int) -> int | None:
        """Where nodes go on after `at`: -1 if not within a node's length, None while it cannot be told."""
        if len(data) - at < WINDOW:
            return None
        if self._last is not None:
            for place in range(at, at + PHASES_BACK * SIZE, SIZE):
                if self._near(data, place) and _chain(data, place, CHAIN_IN_PHASE, self._mark) is not None:
                    return place
            nearby = [p for p in range(at, at + 2 * SIZE) if self._near(data, p)]
            best = _evenest(data, nearby, CHAIN_NEARBY, self._mark)
            if best is not None:
                return best
        best = _evenest(data, range(at, at + SIZE), CHAIN_ALONE, self._mark)
        return -1 if best is None else best

    def _next_chain(self, data: bytearray, at: int) -> int:
        """The first place from `at` on from which `_find_step` can see a chain, found without looking at each."""
        place = at
        while (found := _CHECKED_CHAIN.search(data, place)) is not None:
            place = found.start()
            if _chain(data, place, CHAIN_IN_PHASE, self._mark) is not None:
                return max(at, place - (PHASES_BACK - 1) * SIZE)
            place += 1
        return len(data)

    def _near(self, data: bytearray, place: int) -> bool:
        return self._last is not None and _step(self._last, _angle(data, place)) <= NEAR_Q6

    def _continues(self, data: bytearray, at: int, last: int | None) -> bool:
        if self.measure(data, at) != SIZE or not self.intact(data, at, SIZE):
            return False
        angle = _angle(data, at)
        if last is not None and _step(last, angle) > FORWARD_Q6:
            return False
        return not data[at] & 1 or _fits(angle, self._mark)

    def _repeats(self, data: bytearray, at: int) -> bool:
        """Whether the node that ended the run is marked where the last one was that was not believed."""
        angle = _angle(data, at)
        if not data[at] & 1 or self.measure(data, at) != SIZE or not self.intact(data, at, SIZE):
            return False
        if _fits(angle, self._mark) or self._last is None or _step(self._last, angle) > FORWARD_Q6:
            return False
        again = _apart(angle, self._other_mark) <= BACKWARD_Q6
        self._other_mark = angle
        if again:
            self._mark = angle
        return again

    def _not_ordinary(self, data: bytearray, at: int, count: int) -> Iterator[int]:
        """Which nodes from `at` are not ordinary: unmarked, and a small step ahead of the one before."""
        nodes = np.frombuffer(data, NODE, count, at)
        words = np.empty(count + 1, np.uint16)
        words[0] = _angle(data, at - SIZE) << 1 | 1
        words[1:] = nodes["angle"]
        # With the check bits, which are all 1, a step is twice as large; without a sign, what is below 0 is large.
        steps = words[1:] - words[:-1]
        steps += np.uint16(2 * BACKWARD_Q6)
        other = steps > 2 * (FORWARD_Q6 + BACKWARD_Q6)
        marks = nodes["quality"] & 3
        other |= marks != _UNMARKED
        if not np.bitwise_and.reduce(words) & 1:
            other |= words[1:] & 1 == 0
        if np.maximum.reduce(words) >= 2 * FULL_TURN_Q6:
            other |= words[1:] >= 2 * FULL_TURN_Q6
        return map(int, other.nonzero()[0]) if np.count_nonzero(other) else iter(())


def _angle(data: bytes | bytearray, at: int) -> int:
    return data[at + 1] >> 1 | data[at + 2] << 7


def _apart(one: int, other: int) -> int:
    """Degrees/64 between two angles, the short way."""
    return min((one - other) % FULL_TURN_Q6, (other - one) % FULL_TURN_Q6)


def _fits(angle: int, mark: int | None) -> bool:
    """Whether a mark may stand at an angle: where the others do, or at 0; anywhere when it is the first."""
    return mark is None or min(_apart(angle, 0), _apart(angle, mark)) <= SEAM_Q6


def _step(earlier: int, later: int) -> int:
    """Degrees/64 from one angle to the next; falling back a little counts as no step."""
    step = (later - earlier) % FULL_TURN_Q6
    return 0 if step >= FULL_TURN_Q6 - BACKWARD_Q6 else step


def _chain(data: bytearray, at: int, length: int, mark: int | None) -> list[int] | None:
    """The steps between `length` nodes from `at`, or None if one of them cannot follow the other."""
    steps: list[int] = []
    last, marks = -1, 0
    for place in range(at, at + length * SIZE, SIZE):
        first, second = data[place], data[place + 1]
        if not ((first ^ first >> 1) & second & 1):
            return None
        angle = _angle(data, place)
        if angle >= FULL_TURN_Q6:
            return None
        if first & 1:
            marks += 1
            # No chain is as long as a revolution: where nothing is known of marks, there is one at most.
            if not _fits(angle, mark) or (mark is None and marks > 1):
                return None
        if last >= 0:
            step = (angle - last + BACKWARD_Q6) % FULL_TURN_Q6 - BACKWARD_Q6
            if step > FORWARD_Q6:
                return None
            steps.append(step)
        last = angle
    return steps


def _evenest(data: bytearray, places: Sequence[int], length: int, mark: int | None) -> int | None:
    """Of the places where a chain begins, the one whose angle advances most evenly."""
    best: tuple[bool, float, int] | None = None
    for place in places:
        steps = _chain(data, place, length, mark)
        if steps is None:
            continue
        total = sum(steps)
        mean = total / len(steps)
        unevenness = sum(abs(step - mean) for step in steps) / max(abs(mean), 1.0)
        rank = (total <= 0, unevenness, place)
        if best is None or rank < best:
            best = rank
    return None if best is None else best[2]
