"""0x81, the plain node of five bytes: a packet is one sample, with almost nothing to check it by.

Layout (S-series interface manual, response to SCAN): bit 0 of the first byte marks a new scan and bit 1 is its
inverse; bit 0 of the second byte is always 1; then 15 bits of angle in 1/64 degrees and 16 bits of distance in
1/4 mm. Two fixed bits let one wrong phase in four pass, and since walls are smooth, wrong phases pass many times in
a row. So a node is believed only in its context:

* in step, it must continue the node before by a small step of the angle or of the beam (`chains`), and a new-scan
  mark must stand where marks do;
* out of step, a chain of nodes must pass that test together. In the old phase, if they continue the last angle, a
  short chain is enough, so that a flipped bit costs one node. In another phase (a byte was lost), and at the
  beginning of a stream, the chain must be long;
* if several phases pass, the first one whose angles advance is right: the distances of an even wall, read as
  angles, do not advance.

The manual does not say at which angle a scan begins. Most devices mark it at 0, which the angles show as well. If
the first mark of a stream stands elsewhere, or two marks in a row stand at one other place, revolutions begin
there. A mark of the very first node is ignored: a device may mark its first node wherever it stands.
"""

import re
from typing import Final

import numpy as np

from lidario.families.rplidar.chains import (
    BACKWARD_Q6,
    CHAIN_ALONE,
    CHAIN_IN_PHASE,
    FORWARD_Q6,
    FULL_TURN_Q6,
    NEAR_Q6,
    SIZE,
    ahead_of,
    angle_at,
    apart,
    chain_steps,
    fits,
    heading_at,
    is_far,
    next_chain,
    step_between,
)
from lidario.wire.blocks import Block
from lidario.wire.events import Packets
from lidario.wire.formats import BEGINS, NO_PACKET, Headings, StreamFormat, Stretch, headings_of

PHASES_BACK: Final = 4  # this many nodes in the old phase are tried before other phases
WORTH_AN_ARRAY: Final = 16
"""From this many on, nodes are checked as one array. Measured: 1.2 us a node one by one, 18 us for the array."""

WINDOW: Final = (PHASES_BACK + CHAIN_ALONE) * SIZE
"""Bytes that are needed to decide whether nodes go on from a place."""

NODE: Final = np.dtype([("quality", "u1"), ("angle", "<u2"), ("distance", "<u2")])
_UNMARKED = 2
"""The two lowest bits of a node that begins no scan."""


class NodeFormat(StreamFormat):
    """0x81: one sample in five bytes."""

    name = "node"
    response_type = 0x81
    shortest = longest = SIZE
    samples = 1
    header: re.Pattern[bytes] = re.compile(rb"[\x00-\xff][\x00-\xff]", re.DOTALL)
    full_turn = FULL_TURN_Q6

    def __init__(self) -> None:
        super().__init__()
        self._in_step = False
        self._last: bytearray | None = None  # the last node that was believed
        # The angle of the marks, once one was seen; `_other_mark` is that of the last mark that was not believed.
        self._mark: int | None = None
        # Whether a mark far from 0 was among the nodes that passed; None before the first node.
        self._marked_far: bool | None = None
        self._other_mark = -FULL_TURN_Q6

    def measure(self, data: bytearray, at: int) -> int:
        if at + 1 >= len(data):
            return 0
        first = data[at]
        return SIZE if (first ^ first >> 1) & 1 and data[at + 1] & 1 else NO_PACKET

    def intact(self, data: bytearray, at: int, size: int) -> bool:  # noqa: ARG002
        """Whether the node at `at` may stand by itself: an angle below 360 degrees."""
        return angle_at(data, at) < FULL_TURN_Q6

    def headings(self, packets: Packets) -> Headings:
        """As `StreamFormat.headings`, in 1/64 degrees. Only marks far from 0 are flagged: at 0, angles suffice."""
        nodes = np.frombuffer(packets.data, NODE)
        angles = nodes["angle"].astype(np.int32)
        angles >>= 1
        if self._marked_far is not False:
            for place in (nodes["quality"] & 1).nonzero()[0].tolist():
                if is_far(int(angles[place])):
                    angles[place] |= BEGINS
        return headings_of(angles)

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
        if not self._goes_on(data, at) or (data[at] & 1 and not fits(angle_at(data, at), self._mark)):
            return False
        begins, self._last = self._last is None, data[at : at + SIZE]
        # `_last` is also None behind damage: there, too, the mark of the first node is ignored.
        if data[at] & 1 and not begins:
            angle = angle_at(data, at)
            self._mark = angle if self._mark is None else self._mark
            self._marked_far = self._marked_far or is_far(angle)
        return True

    def _take_many(self, data: bytearray, at: int, count: int) -> int:
        """Take nodes that follow each other from `at`, at most `count`; returns how many."""
        done = 0
        for other in self._not_ordinary(data, at, count):
            if other > done:
                self._last = data[at + (other - 1) * SIZE : at + other * SIZE]
            # This node may be right all the same: the mark of a new scan, or the first node behind 360 degrees.
            if not self._takes(data, at + other * SIZE):
                return other
            done = other + 1
        if count > done:
            self._last = data[at + (count - 1) * SIZE : at + count * SIZE]
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
        place = self.find_step(data, at)
        if place is None:
            return Stretch((), at, at)
        if place == NO_PACKET:
            # No phase passes here, nor up to the next place where a chain may begin.
            return Stretch((), at, min(self._next_place(data, at + 1), len(data) - WINDOW + 1))
        self._in_step = True
        self._last = None
        if place > at:
            return Stretch((), at, place)
        return self.run(data, at)

    def find_step(self, data: bytearray, at: int) -> int | None:
        """Where nodes go on after `at`; `NO_PACKET` if nowhere near, None while bytes to decide it are missing."""
        if len(data) - at < WINDOW:
            return None
        if self._last is not None:
            last = heading_at(self._last, 0)
            for place in range(at, at + PHASES_BACK * SIZE, SIZE):
                is_chain = chain_steps(data, place, CHAIN_IN_PHASE, self._mark) is not None
                if is_chain and ahead_of(last, data, place) <= NEAR_Q6:
                    return place
        standing = NO_PACKET
        for place in range(at, at + SIZE):
            steps = chain_steps(data, place, CHAIN_ALONE, self._mark)
            if steps is not None and sum(steps) > 0:
                return place
            standing = place if steps is not None and standing == NO_PACKET else standing
        return standing

    def _next_place(self, data: bytearray, at: int) -> int:
        """The first place from `at` on from which `find_step` may find a chain, without testing each place."""
        last = None if self._last is None else heading_at(self._last, 0)
        place = next_chain(data, at, last, self._mark)
        return len(data) if place is None else max(at, place - (PHASES_BACK - 1) * SIZE)

    def _goes_on(self, data: bytearray, at: int) -> bool:
        """Whether the node at `at` is a small step ahead of the one before; its mark is ignored."""
        if self.measure(data, at) != SIZE or not self.intact(data, at, SIZE):
            return False
        last = self._last
        # The angle first: mostly it is enough, and this test is made for each node if few come at once.
        return (
            last is None
            or step_between(angle_at(last, 0), angle_at(data, at)) <= FORWARD_Q6
            or ahead_of(heading_at(last, 0), data, at) <= FORWARD_Q6
        )

    def _repeats(self, data: bytearray, at: int) -> bool:
        """Whether the node that ended the run has a mark at the same place as the last mark that was not believed.

        A node that follows the one before can only have ended the run by its mark.
        """
        if not self._goes_on(data, at):
            return False
        angle = angle_at(data, at)
        again = apart(angle, self._other_mark) <= BACKWARD_Q6
        self._other_mark = angle
        if again:
            self._mark = angle
        return again

    def _not_ordinary(self, data: bytearray, at: int, count: int) -> list[int]:
        """Numbers of the nodes from `at` that are not ordinary, that is unmarked and a small step ahead."""
        nodes = np.frombuffer(data, NODE, count, at)
        words = np.empty(count + 1, np.uint16)
        words[0] = angle_at(data, at - SIZE) << 1 | 1
        words[1:] = nodes["angle"]
        # The words include the check bit, always 1, so steps count twice. Unsigned, negative steps are large.
        steps = words[1:] - words[:-1]
        steps += np.uint16(2 * BACKWARD_Q6)
        other = steps > 2 * (FORWARD_Q6 + BACKWARD_Q6)
        marks = nodes["quality"] & 3
        other |= marks != _UNMARKED
        other |= words[1:] & 1 == 0
        other |= words[1:] >= 2 * FULL_TURN_Q6
        found: list[int] = other.nonzero()[0].tolist()
        return found
