"""Counts the revolutions from one beginning to the next by the time, and keeps the time that one takes.

Angles repeat with each revolution, so only time can tell whether one or five have passed unseen. The *anchor* is
the last beginning up to which all revolutions are counted. From there the speed tells when the next beginning is
due, or the time of the samples since, which is exact while a rotor changes its speed: the nearer of the two counts.
Time stamps may be late, as after a blocked event loop, but never early. So:

- A beginning that is late by less than a part of a revolution was rightly counted, and is the next anchor.
- One that is late by whole revolutions may show that these passed unseen. If packets are known to be missing, they
  are counted at once. Otherwise the anchor stays, and they are counted only when the stamps stay late while reads
  go on: a program that reads late catches up in a moment.
- A revolution passes unseen only while nothing is read for as long as it takes. If reads went on all the time, the
  rotor was slow or stood still.
- While no speed is sure, the anchor stays. With the first sure speed, all revolutions since then are counted, but
  for the time that the samples since then took: while these were measured, none passed unseen.

How many packets are missing follows: those of the revolutions that passed unseen, if the speed is known; otherwise
as many as fit into the time since the anchor, less those that came and those that the angles have shown.
"""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Final, NamedTuple

from lidario.revolution.build import DatedRevolution
from lidario.revolution.sparse_speed import SparseSpeed

NOISE: Final = 0.35
"""Revolutions by which the time between two beginnings may be off, because of late stamps and an uneven rotor."""
ALIKE: Final = 1.5
"""Two speeds are alike if they differ by less than this factor. A revolution of which most did not come is believed
only at a speed like the one before."""
FEWEST_PACKETS: Final = 6
"""Packets of a revolution from which its speed is believed; no mode has fewer. If most packets are lost, the gaps
between the others may be equal by chance, and then show a rotor that is many times too fast."""
MORE_THAN_ONE: Final = 1.005
"""A broken revolution with this many times the packets of a whole one certainly holds parts of two. One of 33 1/3
packets on average rightly has 34 at times."""
STAYED_LATE: Final = 0.5
"""Revolutions for which stamps must stay late while reads go on, before any is counted as missing without a gap."""
NEARLY_ALL: Final = 0.9
"""If this share of its packets came, a revolution lacks no more than its angles show."""


@dataclass(slots=True)
class Beginning:
    """What is known of a revolution when it has ended."""

    start_ns: int  # when its first sample was measured
    over: float  # share of the revolution that was over by then: 0, unless its beginning was lost
    revolution_ns: float  # time of a whole revolution at its speed; 0 if unknown
    packet_ns: float  # average time of a packet; 0 if unknown
    packets: int  # how many packets came
    lost: int  # packets known to be missing in it or right behind it
    broken: bool  # whether parts of several revolutions may have met in it; `lost` is then not all
    number: int  # its number, as counted so far; if it is only a part, that of the revolution before
    packets_before: int  # packets that came, or are counted as lost, before it
    # Whether `packet_ns` is that of an ordinary packet. If False, only short packets came, and it is the time of
    # the longest packet of the format.
    ordinary: bool = True
    own: bool = False  # whether each packet tells the speed by itself, and at least three came
    borrowed: bool = False  # whether its speed is that of a revolution before, since its own is not known
    # Time of its samples, with those that are known to be missing; 0 if unknown.
    spanned_ns: float = 0.0
    came_ns: float = 0.0  # time of the samples that came, however far the rotor turned meanwhile; 0 if unknown
    read_ns: int = 0  # time from the read with its beginning to the read with its end; 0 if unknown
    # For each of its reads the time since the read before, less the time of the packets that it brought; empty if
    # unknown.
    silences_ns: Sequence[float] = ()

    @property
    def revolution_packets(self) -> float:
        """How many packets a whole revolution has; 0 if unknown."""
        return self.revolution_ns / self.packet_ns if self.packet_ns else 0.0

    @property
    def hides(self) -> float:
        """How many whole revolutions may have passed unseen in it: in silences of about one or more."""
        turns = [silence_ns / self.revolution_ns for silence_ns in self.silences_ns]
        # Rounded up: the packets before a silence may have come late.
        return sum([math.ceil(each) for each in turns if each >= 1 - NOISE]) if turns else math.inf

    @property
    def has_gap(self) -> bool:
        """Whether packets are missing in it.

        If it is broken and has more packets than a whole one, an outage of almost one lies in it, behind which the
        angle was only a little back.
        """
        whole = self.revolution_packets
        return bool(self.lost) or (self.broken and self.packets >= max(MORE_THAN_ONE * whole, whole + 1))

    def is_only_part(self, whole: float) -> bool:
        """Whether it lacks more than its angles show, if a revolution has so many packets."""
        return self.packets + self.lost < NEARLY_ALL * whole

    @property
    def tells_time(self) -> bool:
        """Whether its samples tell when the next revolution begins, if no whole one is missing between the two."""
        return bool(self.spanned_ns) and not (self.broken or self.borrowed)


class Passed(NamedTuple):
    """What lay between two beginnings."""

    unseen: int  # whole revolutions of which nothing came; -1 if this is only a part of the one before
    lost: int  # missing packets beyond those that the angles showed


class RevolutionClock:
    """Follows the beginnings of revolutions through one stream.

    Args:
        slowest_ns: Longest time of a revolution.
        exact: Whether the device's own clock tells the times, so that no stamp is late.

    Attributes:
        usual_ns: Time of a revolution at the latest speed that was sure; 0 before the first.
        needs_speed: True until packets that follow each other gave a sure speed. Until then `learn_speed` helps.
    """

    def __init__(self, slowest_ns: float, *, exact: bool = False) -> None:
        self._least_late = 0.0 if exact else STAYED_LATE
        self._search = SparseSpeed(slowest_ns)
        self._anchor: Beginning | None = None
        # Since the anchor: time of the samples with the missing ones (NaN if unknown), time of the samples that
        # came, and how many revolutions silences may hide. Then how long reads went on while beginnings were late;
        # None if they are not late.
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
        """Whether beginnings are late by whole revolutions, and it is still open where these are missing."""
        return self._late_ns is not None

    @property
    def last(self) -> Beginning | None:
        """The revolution before; None if the next one cannot simply be counted as one more.

        It is None in three cases: nothing is known of that revolution, stamps are late at the moment, or the next
        one is needed to find the speed or how many revolutions passed since the anchor.
        """
        return None if self._late_ns is not None or self.needs_speed else self._last

    def learn_speed(self, packets: Iterable[tuple[float, int]]) -> None:
        """Take packets that came: the angle at which each begins, in revolutions, and its arrival."""
        for angle, at_ns in packets:
            self._search.add(angle, at_ns)
        self.usual_ns = self._search.revolution_ns() or self.usual_ns

    def forget_speed(self) -> None:
        """Forget the speed: it was wrong, since it was taken from gaps that are all alike."""
        self.usual_ns, self.needs_speed, self._late_ns = 0.0, True, None

    def restart(self, seam: float | None = None) -> None:
        """The stream began anew: forget the revolution before.

        Args:
            seam: Angle at which revolutions begin from now on, in revolutions; None if it did not change.
        """
        self._last = self._late_ns = None
        if seam is None or seam == self._seam:
            return
        if self._anchor is not None:
            # Move the anchor to the nearer of two beginnings: it rather counts too few revolutions than too many.
            over = (self._anchor.over + self._seam - seam) % 1
            self._anchor.over = over if over < 0.5 else over - 1
        self._seam = seam

    def is_followed(self, revolutions: Iterable[DatedRevolution]) -> bool:
        """Whether revolutions follow `last`, which must not be None, and each other; it remembers nothing."""
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
        """Remember revolutions for which `is_followed` is true, by the last of them."""
        self._last = last
        self._be_sure(last)
        self._be_anchor(last)

    def follow(self, here: Beginning) -> Passed:
        """Tell what passed since the beginning before, which by the angles is one revolution earlier."""
        last, self._last = self._last, here
        own_ns, is_new = here.revolution_ns, self.needs_speed
        self._correct_packet(here)
        self._correct_speed(here, last)
        anchor = self._anchor
        if anchor is None:
            self._be_anchor(here)
            return Passed(0, 0)
        elapsed = here.start_ns - anchor.start_ns
        share = here.number - anchor.number + here.over - anchor.over
        self._spanned_ns += last.spanned_ns if last is not None and last.tells_time else math.nan
        if last is not None:
            self._came_ns += last.came_ns
        if not self.usual_ns:
            return Passed(0, several(self._missing_by_clock(here, elapsed)))
        if last is None or is_new or self._was_wrong(last):
            return self._all_since_anchor(here, elapsed, share)
        late_ns = elapsed - share * last.revolution_ns
        if not math.isnan(self._spanned_ns):
            # The rotor may change its speed; the time of a sample stays the same.
            late_ns = min(late_ns, elapsed - self._spanned_ns, key=abs)
        # Revolutions that passed unseen had a speed between the one before and the one behind.
        slower = own_ns / last.revolution_ns or 1.0
        late = late_ns / (last.revolution_ns * (1 + slower) / 2)
        if here.read_ns and here.is_only_part(last.revolution_packets) and abs(late + 1) <= NOISE:
            # It begins a revolution too early, but time stamps are never early: a false angle ended the revolution
            # before too soon. If nearly all of it came, it is a revolution: doubled bytes had put a part before it.
            self._last = last
            return Passed(-1, 0)
        passed = max(0, int(late + NOISE))
        self._hides += last.hides
        if passed and self._hides and self._may_be_read_late(here, last):
            return Passed(0, 0)
        # What cannot hide in silences did not pass: the rotor was slow or stood still.
        unseen, lost = int(min(passed, self._hides)), 0
        if unseen < passed or (last.broken and not passed):
            # How late it is proves nothing, unless it is late by whole revolutions.
            due_ns = elapsed if passed else min(elapsed, share * last.revolution_ns)
            lost = several(self._missing_by_clock(here, due_ns))
        elif unseen:
            each = last.revolution_packets
            fewest, most = sorted((round(unseen * each), round(unseen * each * slower)))
            # If little came of a broken revolution, what is missing in it may already be counted.
            is_counted = last.broken and (last.has_gap or last.is_only_part(each))
            lost = min(max(self._missing_by_clock(here, elapsed), 0 if is_counted else fewest), most)
        if here.broken and not passed:
            # It began when it was due. All packets that came of it may lie behind an outage, or be late.
            here.start_ns -= round(max(0.0, late_ns))
        # A silence that hid some may have hidden more: the next beginning may show them.
        left = self._hides - unseen if unseen else 0.0
        self._be_anchor(here, unseen, lost)
        self._hides = left
        return Passed(unseen, lost)

    def _all_since_anchor(self, here: Beginning, elapsed: float, share: float) -> Passed:
        """Count all revolutions since the anchor: only now the speed is known."""
        by_clock = self._missing_by_clock(here, elapsed)
        unseen = math.floor(elapsed / here.revolution_ns - share + NOISE)
        # None passes unseen while samples are measured: the rotor stood still, or was starting.
        measured_ns = self._came_ns if math.isnan(self._spanned_ns) else self._spanned_ns
        unseen = min(unseen, int((elapsed - measured_ns) / here.revolution_ns + NOISE))
        # If too many were counted before, `unseen` is negative, and that many are left out later.
        self._be_anchor(here, unseen, by_clock)
        return Passed(max(0, unseen), several(by_clock))

    def _may_be_read_late(self, here: Beginning, last: Beginning) -> bool:
        """Count how long reads went on meanwhile; tell whether such a beginning may only have been read late."""
        self._late_ns = (self._late_ns or 0) + here.read_ns
        return not last.has_gap and self._late_ns < self._least_late * here.revolution_ns

    def _missing_by_clock(self, here: Beginning, elapsed: float) -> int:
        """Packets missing since the anchor beyond those known, by the time of one; negative if more are known."""
        if not self._packet_ns or self._anchor is None:
            return 0
        return round(elapsed / self._packet_ns) - (here.packets_before - self._anchor.packets_before)

    def _was_wrong(self, last: Beginning) -> bool:
        """Whether the speed borrowed for the last revolution is not like the one that is sure now.

        A broken revolution may have had both speeds, so it is not judged.
        """
        alike = 1 / ALIKE < self.usual_ns / last.revolution_ns < ALIKE
        return last.borrowed and not (last.broken or alike)

    def _be_sure(self, here: Beginning) -> None:
        self.usual_ns, self.needs_speed = here.revolution_ns, False

    def _be_anchor(self, here: Beginning, unseen: int = 0, lost: int = 0) -> None:
        here.number += unseen
        here.packets_before += lost
        self._anchor, self._late_ns = here, None
        self._spanned_ns = self._came_ns = self._hides = 0.0

    def _correct_packet(self, here: Beginning) -> None:
        """If only short packets came, take the time of an ordinary packet from before."""
        if here.ordinary and here.packet_ns:
            self._packet_ns, self._ordinary = here.packet_ns, True
        elif self._ordinary:
            here.packet_ns = self._packet_ns
        else:
            self._packet_ns = max(self._packet_ns, here.packet_ns)

    def _correct_speed(self, here: Beginning, last: Beginning | None) -> None:
        """If the speed is not sure, take the one before: a rotor keeps its speed.

        A speed is sure if time confirms it: the time since the beginning before or, if the revolution came whole,
        the time between its own reads. The speed of the first revolution is taken from its angles. But enough of a
        revolution must have come, or its speed must be like the last sure one: gaps that are equal by chance show a
        wrong speed.
        """
        usual_ns = self.usual_ns
        alike = bool(usual_ns) and 1 / ALIKE < here.revolution_ns / usual_ns < ALIKE
        came = here.lost <= here.packets and (here.own or here.packets >= FEWEST_PACKETS)
        if here.revolution_ns and not here.broken and (alike or came):
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
        elif here.broken or not (alike or came):
            here.revolution_ns = 0.0


def several(missing: int) -> int:
    """How many packets to count of those that only time shows as missing: of a few, none; stamps may be late."""
    return missing if missing > FEWEST_PACKETS else 0
