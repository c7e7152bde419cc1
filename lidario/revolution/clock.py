"""How many revolutions passed from one beginning to the next, and how long one takes, by the time.

Angles repeat with each revolution: whether one or five have passed unseen, only the time can tell. So one beginning
is the *anchor*: the last one up to which everything is counted. From it the clock says when the next one is due, in
two ways: by the speed, and by what the samples since took, which is exact while a rotor changes its speed.

Time stamps may be late, never early, as after a blocked event loop. A beginning that is late by less than a part
of a revolution is the next anchor. One that is late by whole ones has missed so many, at once where packets are
known to be missing. Where the angles show no gap, the anchor stays, and they are counted only when the stamps stay
late while reads go on: what a program reads late, it reads in a moment. And a whole revolution hides only in a
silence that is as long: where reads went on all the time, the rotor was slow, or stood.

Where so little comes that no speed is sure, the anchor stays too, and what has passed is counted when a speed is
known. Where not even that is, the time that a packet takes tells how many are missing.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Final, NamedTuple

from lidario.revolution.build import DatedRevolution
from lidario.revolution.sparse_speed import SparseSpeed

NOISE: Final = 0.35
"""Revolutions by which the time between two beginnings may be off, by late stamps and an uneven rotor."""
ALIKE: Final = 1.5
"""Times that a revolution may take longer or shorter than the one before, where most of it did not come."""
FEWEST_PACKETS: Final = 6
"""Packets of a revolution from which its speed is believed; no mode has fewer. Of a few packets, all others being
lost, the gaps may be alike by chance, and then tell of a rotor that is many times too fast."""
MORE_THAN_ONE: Final = 1.005
"""Times the packets of a revolution from which a broken one holds parts of two for certain; where it has 33 and a
third, it has 34 by right at times."""
STAYED_LATE: Final = 0.5
"""Revolutions during which reads must go on and stamps stay late, where no packet is known to be missing."""
NEARLY_ALL: Final = 0.9
"""Share of the packets of a revolution from which no more than what its angles tell is missing in it."""


@dataclass(slots=True)
class Beginning:
    """What is known of a revolution when it has ended."""

    start_ns: int  # when its first sample was measured
    over: float  # share of the revolution that was over by then: 0, unless its beginning was lost
    revolution_ns: float  # what a whole revolution takes at its speed; 0 when that is not known
    packet_ns: float  # what a packet takes on average; 0 when that is not known
    packets: int  # how many came
    lost: int  # how many are known to be missing in it or right behind it
    broken: bool  # whether parts of several revolutions may have met in it, so that `lost` is not all
    number: int  # its number, by what was counted until then; where it is only a part, that of the one before
    packets_before: int  # packets that came, or are counted as lost, before it
    # Whether `packet_ns` is that of an ordinary packet. If not, only short ones came, and it is that of the longest
    # packet of the format.
    ordinary: bool = True
    own: bool = False  # whether each of its packets tells the speed, and three came at least
    borrowed: bool = False  # whether its speed is that of a revolution before, since its own is not known
    # What its samples took, and those that are known to be missing; 0 when that is not known.
    spanned_ns: float = 0.0
    came_ns: float = 0.0  # what its samples took, however far the rotor turned meanwhile; 0 when that is not known
    # When the last packet before it came, then each read from that of its beginning to that of its end; none when
    # that is not known.
    reads_ns: Sequence[int] = ()

    @property
    def revolution_packets(self) -> float:
        """How many packets a whole revolution has; 0 when that is not known."""
        return self.revolution_ns / self.packet_ns if self.packet_ns else 0.0

    @property
    def read_ns(self) -> int:
        """From the read that brought its beginning to the one that brought its end; 0 when that is not known."""
        return self.reads_ns[-1] - self.reads_ns[1] if self.reads_ns else 0

    @property
    def hides(self) -> float:
        """How many whole revolutions may have passed in it unseen, in silences of at least one."""
        turns = [(after - before) / self.revolution_ns for before, after in pairwise(self.reads_ns)]
        # Rounded up: what came before a silence may have come late.
        return sum([math.ceil(each) for each in turns if each >= 1 - NOISE]) if turns else math.inf

    @property
    def tells_time(self) -> bool:
        """Whether its samples tell when the next one begins, if no whole revolution is missing between them."""
        return bool(self.spanned_ns) and not (self.broken or self.borrowed)


class Passed(NamedTuple):
    """What lay between two beginnings."""

    unseen: int  # whole revolutions of which nothing came; -1 where this is none, but a part of the one before
    lost: int  # packets that are missing beyond those that the angles told


class RevolutionClock:
    """Follows the beginnings of revolutions through one stream.

    Args:
        slowest_ns: What a revolution takes at most.
        exact: Whether the device's own clock tells the times, so that no stamp is late.

    Attributes:
        usual_ns: What a revolution takes at the latest speed that was sure; 0 while none was.
        needs_speed: Whether no speed was ever sure by packets that follow each other, so that `learn_speed` helps.
    """

    def __init__(self, slowest_ns: float, *, exact: bool = False) -> None:
        self._least_late = 0.0 if exact else STAYED_LATE
        self._search = SparseSpeed(slowest_ns)
        self._anchor: Beginning | None = None
        # Whether all since the anchor is to be counted: nothing else tells what passed.
        self._is_open = False
        # Since the anchor: what the samples took, if they tell when the next one begins, and in any case; how many
        # revolutions silences may hide; and how long reads went on since a beginning was late.
        self._spanned_ns = self._came_ns = self._hides = 0.0
        self._late_ns: int | None = None
        self._last: Beginning | None = None
        self.usual_ns: float = 0.0
        self.needs_speed: bool = True
        self._seam = 0.0
        self._packet_ns = 0.0
        self._ordinary = False

    @property
    def is_late(self) -> bool:
        """Whether beginnings are late by whole revolutions, and it is not yet known where these are missing."""
        return self._late_ns is not None

    @property
    def last(self) -> Beginning | None:
        """The revolution before; None while the next one is not simply one more.

        So it is where nothing is known of it, where the stamps are late at the moment, and where the next one
        has to tell the speed, or how many passed since the anchor.
        """
        return None if self._late_ns is not None or self._is_open or self.needs_speed else self._last

    def learn_speed(self, packets: Iterable[tuple[float, int]]) -> None:
        """Packets came: where each begins, in revolutions, and when it came."""
        for angle, at_ns in packets:
            self._search.add(angle, at_ns)
        self.usual_ns = self._search.revolution_ns() or self.usual_ns

    def restart(self, seam: float | None = None) -> None:
        """The stream began anew: nothing is known of the revolution before.

        Args:
            seam: Where revolutions begin from now on, in revolutions from the first of these places; None when they
                begin where they did.
        """
        self._last = self._late_ns = None
        if seam is None or seam == self._seam:
            return
        if self._anchor is not None:
            # To the nearer of two beginnings: then rather too few revolutions are told than too many.
            over = (self._anchor.over + self._seam - seam) % 1
            self._anchor.over = over if over < 0.5 else over - 1
        self._seam = seam

    def is_followed(self, revolutions: Iterable[DatedRevolution]) -> bool:
        """Whether the next revolutions follow the last one, which must be known; it remembers nothing."""
        last = self._last
        assert last is not None
        before_ns, ordinary_ns, share = last.start_ns, last.revolution_ns, 1 - last.over
        for each in revolutions:
            elapsed = each.start_ns - before_ns
            alike = 1 / ALIKE < each.revolution_ns / ordinary_ns < ALIKE
            if not alike or abs(elapsed / ordinary_ns - share) >= NOISE:
                return False
            before_ns, ordinary_ns, share = each.start_ns, each.revolution_ns, 1
        return True

    def settle(self, last: Beginning) -> None:
        """Remember revolutions of which `is_followed` is true, by the last of them."""
        self._last = last
        self._be_sure(last)
        self._be_anchor(last)

    def follow(self, here: Beginning) -> Passed:
        """Tell what passed since the beginning before; it is one revolution on by the angles."""
        last, self._last = self._last, here
        own_ns = here.revolution_ns
        needed = self.needs_speed
        self._correct_packet(here)
        self._correct_speed(here, last)
        anchor = self._anchor
        if anchor is None:
            self._be_anchor(here)
            return Passed(0, 0)
        elapsed = here.start_ns - anchor.start_ns
        self._spanned_ns += last.spanned_ns if last is not None and last.tells_time else math.nan
        self._came_ns += 0.0 if last is None else last.came_ns
        if not self.usual_ns:
            # What passed is counted when one is.
            self._is_open = True
            return Passed(0, several(self._missing_by_clock(here, elapsed)))
        if last is None or not last.revolution_ns or needed or self._is_open or self._was_wrong(last):
            return Passed(*self._count_all(here, anchor, elapsed))
        slower = own_ns / last.revolution_ns or 1.0
        return Passed(*self._count_late(here, last, anchor, slower))

    def _count_all(self, here: Beginning, anchor: Beginning, elapsed: float) -> tuple[int, int]:
        """Revolutions and packets that are missing since the anchor, by all that is known since."""
        missing = self._missing_by_clock(here, elapsed)
        if math.isnan(self._spanned_ns):
            turns = elapsed / here.revolution_ns + anchor.over - here.over
            unseen = int(turns + NOISE) - (here.number - anchor.number)
            # While samples came, no turn passed unseen: the rotor stood, or started.
            unseen = min(unseen, int((elapsed - self._came_ns) / here.revolution_ns + NOISE))
        else:
            unseen = int((elapsed - self._spanned_ns) / here.revolution_ns + NOISE)
        # Where too many were counted, that many are left out later.
        self._be_anchor(here, unseen, missing)
        return max(0, unseen), several(missing)

    def _count_late(self, here: Beginning, last: Beginning, anchor: Beginning, slower: float) -> tuple[int, int]:
        """Revolutions and packets that are missing, by how much later this beginning is than it was due."""
        elapsed = here.start_ns - anchor.start_ns
        self._hides += last.hides
        share = here.number - anchor.number + here.over - anchor.over
        late_ns = elapsed - share * last.revolution_ns
        if not math.isnan(self._spanned_ns):
            # A rotor changes its speed; the time that a sample takes stays.
            late_ns = min(late_ns, elapsed - self._spanned_ns, key=abs)
        # What passed unseen had a speed between that before and that behind.
        late = late_ns / (last.revolution_ns * (1 + slower) / 2)
        each = last.revolution_packets
        if here.packets < NEARLY_ALL * each and here.read_ns and abs(late + 1) <= NOISE:
            # Time stamps are never early. An angle that noise told ended the one before too soon. One that came
            # whole is a revolution: bytes that came twice had put a part before it.
            self._last = last
            return -1, 0
        # More than one revolution has: an outage of almost one lies in it, and its angles fell back by little.
        gap = last.lost or (last.broken and last.packets >= max(MORE_THAN_ONE * each, each + 1))
        unseen, passed = 0, int(late + NOISE) if late >= 1 - NOISE else 0
        if passed and self._hides:
            self._late_ns = (self._late_ns or 0) + here.read_ns
            if not gap and self._late_ns < self._least_late * here.revolution_ns:
                return 0, 0
            unseen = int(min(passed, self._hides))
        due_ns = elapsed if passed else min(elapsed, share * last.revolution_ns)
        by_clock = max(0, self._missing_by_clock(here, due_ns))
        fewest, most = sorted((round(unseen * each), round(unseen * each * slower)))
        lost = min(max(by_clock, fewest), most)
        if unseen < passed or (last.broken and not unseen):
            # Where no more revolutions can hide, the rotor was slow, or stood.
            lost = several(by_clock)
        elif last.broken and (gap or last.packets < NEARLY_ALL * each):
            # Its angles do not tell all that is missing. Of two witnesses the lesser is told.
            lost = min(lost, by_clock)
        if here.broken and not passed:
            # It began when it was due; all that came of it may come from behind an outage, or late.
            here.start_ns -= round(max(0.0, late_ns))
        left = self._hides - unseen
        self._be_anchor(here, unseen, lost)
        # Of a silence that hid some, the next one may tell the rest.
        self._hides = left if unseen else 0.0
        return unseen, lost

    def _was_wrong(self, last: Beginning) -> bool:
        """Whether another speed is sure now than was taken for the last one; a broken one may have had both."""
        alike = 1 / ALIKE < self.usual_ns / last.revolution_ns < ALIKE
        return last.borrowed and not (last.broken or alike)

    def _be_sure(self, here: Beginning) -> None:
        self.usual_ns, self.needs_speed = here.revolution_ns, False

    def _be_anchor(self, here: Beginning, unseen: int = 0, lost: int = 0) -> None:
        here.number += unseen
        here.packets_before += lost
        self._anchor, self._is_open, self._late_ns = here, False, None
        self._spanned_ns = self._came_ns = self._hides = 0.0

    def _missing_by_clock(self, here: Beginning, elapsed: float) -> int:
        """Packets missing since the anchor beyond those known, by what one takes; below 0 where more are known."""
        if not self._packet_ns or self._anchor is None:
            return 0
        return round(elapsed / self._packet_ns) - (here.packets_before - self._anchor.packets_before)

    def _correct_packet(self, here: Beginning) -> None:
        """Where only short packets came, take what an ordinary one took before."""
        if here.ordinary and here.packet_ns:
            self._packet_ns, self._ordinary = here.packet_ns, True
        elif self._ordinary:
            here.packet_ns = self._packet_ns
        else:
            self._packet_ns = max(self._packet_ns, here.packet_ns)

    def _correct_speed(self, here: Beginning, last: Beginning | None) -> None:
        """Where the speed is not sure, take the one before: a rotor keeps its speed.

        Sure is what the time confirms: since the one before, or that of its own reads, if it came whole. Of the
        first revolution it is what its angles tell. But enough must have come of it, or it must be like what was
        sure: gaps that are alike by chance tell of another speed.
        """
        usual_ns = self.usual_ns
        alike = bool(usual_ns) and 1 / ALIKE < here.revolution_ns / usual_ns < ALIKE
        came = here.lost <= here.packets and (here.own or here.packets >= FEWEST_PACKETS)
        # Less than half a revolution may be that of a rotor that has just begun to turn.
        enough = alike or (came and here.over < 0.5)
        if here.revolution_ns and not here.broken and enough:
            if last is None:
                confirmed = not usual_ns or alike
            else:
                elapsed = (here.start_ns - last.start_ns) / here.revolution_ns
                confirmed = abs(elapsed - (1 + here.over - last.over)) < NOISE
                if last.tells_time and not confirmed:
                    late_ns = here.start_ns - last.start_ns - last.spanned_ns
                    confirmed = abs(late_ns) < NOISE * last.revolution_ns
                if here.read_ns and not (here.lost or confirmed):
                    confirmed = abs(here.read_ns / here.revolution_ns - (1 - here.over)) < NOISE
            if confirmed:
                self._be_sure(here)
                return
        if usual_ns:
            here.revolution_ns, here.borrowed = usual_ns, True
        elif here.broken or not enough:
            here.revolution_ns = 0.0


def several(missing: int) -> int:
    """How many packets are told of those that time tells: of a few, none, for stamps are late."""
    return missing if missing > FEWEST_PACKETS else 0
