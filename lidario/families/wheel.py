"""Finds how far the rotor turned during each packet, and how many packets are missing, by the angles and the clock.

A lidar measures at an even pace: each packet takes the same time. The speed of its rotor changes slowly. A packet
states the angle at which it begins, and the next packet begins where the rotor then stands. So from packet to
packet the angle advances by one *arc*, or by two arcs or more if packets are missing.

The rules of the model, and their reasons:

1. **An arc is like the one before it.** A packet is so short that the arc changes from one to the next by only a
   small part of the longest arc, whatever the rotor does. So a *span* from packet to packet that is hardly longer
   than the last arc is one arc. A shorter span always is one, since a gap only lengthens a span. A rotor may stop,
   and go from standstill to full speed, and nothing seems to be missing.
2. **A longer span is a gap.** It holds a whole number of arcs. The packet before it is not stretched over the gap:
   its arc lies on the line between the arc before the gap and the mean arc in it.
3. **A span that is no whole number of arcs shows another speed**, if the next span is like it, or if spans go on so
   for some time. The speed is then learned from those spans alone. A single such span hides a whole turn, which
   angles cannot show, or the rotor stops or starts there. A span of many arcs shows no speed: it may hold one more
   or less.
4. **The clock has the last word.** Spans that agree are one arc each, or a whole number of arcs each: two, if every
   second packet is lost. The angle alone cannot show which. Time can (`Pace`), and is believed only if it says the
   same twice, in the first and in the second half of the packets. It only chooses among whole numbers. The length
   of an arc is taken from the angles, which are exact. If no spans agree, the rotor changes its speed all the time;
   if time says that nearly all packets came, most spans are then one arc each.

Until a speed is sure by these rules, no arc is certain. A known speed stays until spans or time speak against it.
Nothing is learned anew behind a gap, with one exception: if the device cannot have measured as many packets as the
arc says, the rotor has sped up in the gap. Results from before a speed was sure are then corrected
(`Arcs.revoked`).

Without times, as in a file of bytes, spans that agree are taken for one arc each if no byte was skipped; so are the
spans behind an outage.
"""

from collections.abc import Sequence
from statistics import median_high
from typing import Final, NamedTuple

import numpy as np

from lidario.families.pace import OFF, REMEMBERED, SEVERAL, PacedTurning
from lidario.families.spans import (
    LIKENESS,
    RETREAT_TURNS,
    Arcs,
    Heads,
    Ints,
    are_alike,
    by_revolution,
    largest_group,
    spans_between,
)
from lidario.wire.events import Arrival

AGREEING: Final = 6
"""Without time, this many spans must agree before an arc is certain: no revolution has fewer packets."""
FEW_AGREEING: Final = 3  # the same, if time says how many arcs the spans are
TRUSTED_GAP: Final = 8
"""Up to this many missing packets, the mean arc in the gap is better than the last arc that was seen."""
_TELLING: Final = TRUSTED_GAP + 1.5  # up to this many arcs, a span shows whether it is a whole number of arcs
_FITTING: Final = 0.75
"""Share of the spans that must be a whole number of arcs. If whole turns hide in them, only a chance share is."""
_LEAST: Final = 0.5 / LIKENESS  # a shorter arc is hardly more than its rounding
_STRANGE: Final = 4  # after this many spans in a row that do not fit the last arc, the arc is learned anew


class _Walk(NamedTuple):
    """The result of going from span to span."""

    arcs: list[float]  # the arc of each packet
    missing: list[int]  # how many packets are missing behind it
    fitting: int  # how many spans are a whole number of arcs, each compared with the arc before it
    known: int  # how many spans are short enough to show that

    @property
    def mean(self) -> float:
        """The mean arc, also of the packets that are missing."""
        turned = sum(each * (1 + more) for each, more in zip(self.arcs, self.missing, strict=True))
        return turned / (len(self.arcs) + sum(self.missing))


class Wheel(PacedTurning):
    """Follows the rotor through one stream of packets that only state where they begin."""

    def __init__(self, full_turn: int, samples: int = 1) -> None:
        super().__init__(full_turn, RETREAT_TURNS, samples)
        self._arc = self._fastest = 0.0  # the last arc, and the longest one followed together with it
        self._fits = True  # whether all of the latest spans were a whole number of arcs, as far as they show it
        self._spans: list[int] = []  # spans since the speed was last confirmed

    def follow(self, heads: Heads, arrivals: Sequence[Arrival] = ()) -> Arcs:
        before, was_certain = self._arc, self._certain
        arcs = self._follow(heads, arrivals)
        if self._certain and arcs.arc[0] > 0 and not (was_certain or any(arcs.revoked)):
            # A rotor slows down from packet to packet. If the arc leaps, the arcs before were gaps.
            arcs = arcs._replace(revoked=self._revoked(before / float(arcs.arc[0])))
        if arcs.skipped is None and self._fits:
            self._note_close(int(np.count_nonzero(arcs.arc)) - (heads.following is None))
        return arcs

    def _follow(self, heads: Heads, arrivals: Sequence[Arrival]) -> Arcs:
        followed = heads.following is not None
        spans, shortest, longest, total = spans_between(heads, self._full_turn, self._retreat)
        known = spans if followed else spans[:-1]
        is_alike = self._certain and are_alike(self._arc, shortest, longest)
        if is_alike or (self._is_steady(known, longest) and not self._lacks_packets(arrivals)):
            if not followed:
                spans[-1] = spans[-2]
                total += int(spans[-1])
            if not self._confirmed:
                self._remember(known.tolist(), arrivals)
                # The spans are alike, but time may show that they are several arcs each.
                if not self._is_confirmed():
                    return self._among_gaps(spans, arrivals, followed=followed)
            # A rotor that stands, or trembles, shows no arc: keep the last one.
            self._arc, self._certain, self._strange = float(max(spans[-1], 0)) or self._arc, True, 0
            self._fits, self._fastest = True, float(longest)
            if self._confirmed:
                self._forget()
            return Arcs(spans, None, (total / len(spans) or self._arc) / self._samples, certain=True)
        self._remember(known.tolist(), arrivals)
        return self._among_gaps(spans, arrivals, followed=followed)

    def follow_several(self, heads: Heads, ends: Sequence[int], arrivals: Sequence[Arrival] = ()) -> Arcs | None:
        if not (self._certain and (self._confirmed or len(arrivals) == 1)):
            return None
        spans, _, longest, _ = spans_between(heads, self._full_turn, self._retreat)
        before, begin, steps = self._arc, 0, list[float]()
        for end, (shortest, longest, total) in zip(ends, by_revolution(spans, ends), strict=True):
            if not are_alike(before, shortest, longest):
                return None
            before = float(spans[end - 1])
            steps.append(total / (end - begin) / self._samples)
            begin = end
        self._arc, self._fastest, self._strange, self._fits = before, float(longest), 0, True
        if not self._confirmed:
            self._remember(spans.tolist(), arrivals)
            self._is_confirmed()
            self._note_close(len(spans))
        else:
            self._forget()
        return Arcs(spans, None, steps[-1], certain=True, steps=steps)

    def _is_steady(self, spans: Ints, longest: int) -> bool:
        """Whether each span is one arc, hardly longer than the last. If no arc is known, the rotor must turn."""
        if len(spans) < (1 if self._certain else AGREEING) or not (self._certain or spans[-1] > 0):
            return False
        arcs = np.append(round(self._arc), spans) if self._certain else spans
        # A share of the longest arc: a change weighs more for a slow rotor. Plus 1, for spans are rounded.
        slack = LIKENESS * max(longest, self._arc) + 1
        slower = arcs[:-1] - arcs[1:]
        # A much shorter span may be a gap of almost a turn; the next span is then longer again.
        may_slow_down = (slower[-1] if self._certain else slower.max()) <= slack
        return bool(may_slow_down and (spans >= -1).all() and (slower >= -slack).all())

    def _among_gaps(self, spans: Ints, arrivals: Sequence[Arrival], *, followed: bool) -> Arcs:
        """As `follow`, if spans may hold more than one packet, or less."""
        plain: list[int] = spans.tolist()
        told = plain if followed else plain[:-1]
        begin, fastest, revoked = self._arc, self._fastest, (0, 0)
        # Without times, packets that came in one piece have no skipped bytes between them.
        alone = not self._time_passes and len(arrivals) == 1
        was_certain = self._certain
        walk = self._walk(plain, arrivals, followed=followed, faster=False) if was_certain else None
        is_strange = walk is None or self._is_strange(walk, told, alone=alone)
        if walk is None or is_strange or not self._confirmed:
            self._arc, self._fastest = begin, fastest
            revoked = self._learn(told, anew=is_strange)
            if self._arc <= 0:
                return Arcs(np.maximum(spans, 0.0), None, 0.0, certain=False)
            begin = self._arc
            walk = self._walk(plain, arrivals, followed=followed, faster=False)
        may_tell = self._confirmed and self._time_passes and any(walk.missing)
        # Compared with the arcs that were followed: since the first one the rotor may have sped up.
        if may_tell and self._pace.is_too_short(self._packet_ns, walk.mean):
            # Learn the new speed from these spans alone: those before had another one.
            self._arc, self._fastest, self._confirmed, self._spans = begin, fastest, False, told
            self._pace.clear()
            self._pace.add(told, arrivals)
            # The arc of the packet before was too short, so its samples are not used.
            self._learn(told, anew=True)
            # A rotor that slows down first was as fast as before.
            self._arc, revoked = max(self._arc, begin), (1, 0)
            walk = self._walk(plain, arrivals, followed=followed, faster=not self._are_even(told, self._arc))
        missing, self._fits = walk.missing, walk.fitting == walk.known
        behind = np.array(missing) * self._samples if any(missing) else None
        if behind is not None and 0 in told and not (was_certain and self._certain):
            # The rotor stood and has begun to turn: a span before a longer one is a higher speed, and not a gap.
            behind *= np.append(spans[:-1] > spans[1:], False)
        step = (walk.mean or self._arc) / self._samples
        return Arcs(np.array(walk.arcs), behind, step, self._certain, revoked, self._fits)

    def _walk(self, spans: Sequence[int], arrivals: Sequence[Arrival], *, followed: bool, faster: bool) -> _Walk:
        """Follow spans from the last arc on, and take over the arc of the last one.

        If it became `faster`, a span before a longer one is a higher speed, and not a gap.
        """
        arcs, missing = list[float](), list[int]()
        last, fastest = self._arc, self._fastest
        end, fitting, known = len(spans) - 1, 0, 0
        for at, span in enumerate(spans):
            if at == end and not followed:
                arcs.append(last)
                missing.append(0)
                break
            likely = spans[at + 1] if at < end else 0
            goes_on, fastest = abs(likely - span) <= LIKENESS * span / 2, max(fastest, last)
            slack = LIKENESS * fastest
            # A rotor that all but stood may be at speed at once.
            times = span / (usual := fastest if goes_on and last <= slack < span - last else last)
            # A rotor does not turn back, so a turn may hide in a negative span.
            tells = span < -1 or 0 < times <= _TELLING
            # With a slow rotor, a span within the slack may be a gap: then the next span is like the arc before.
            alone = at < end and times > SEVERAL and abs(likely - last) < abs(likely - span)
            # The slack is a share of the longest arc, as in `_is_steady`.
            speeds_up = faster and span < likely and not alone
            whole = max(1, round(times)) if span - last > slack and last >= _LEAST and not speeds_up else 1
            off = abs(span - whole * usual) / fastest
            known += tells
            fitting += tells and off <= LIKENESS
            anew = speeds_up or (off > OFF and tells and (goes_on or 0 < likely < span < last))
            if anew or whole == 1:
                if anew or (off <= OFF and not alone):
                    last = float(max(span, 0)) or last
                # A single span that is no arc hides a whole turn. Beside a span of 0, the rotor stops or starts.
                stands = 0 in (span, likely if at < end else last, arcs[-1] if at else last)
                arcs.append(float(span) if stands else last)
                missing.append(0)
                continue
            if (is_long := whole > TRUSTED_GAP + 1) and last <= slack:
                # A rotor that all but stood may have been faster in so long a gap. Time tells how long it was.
                whole = max(1, round(min(whole, self._most_packets(at, arrivals) or span / fastest)))
            mean = span / whole
            missing.append(whole - 1)
            if is_long or off > OFF:
                # A whole turn may hide in the gap: keep the last arc.
                arcs.append(last)
                # Take the arc of the spans behind it if they agree. Those of a rotor that stands (0) agree, too.
                if alone and _agree(behind := spans[at + 1 : at + 1 + AGREEING]) and behind[0]:
                    last = float(behind[0])
                continue
            # The arc before a gap lies on the line from the arc before it to the middle of the gap.
            arcs.append(last + (mean - last) / (1 + (whole - 1) / 2))
            last = mean
        self._arc = self._fastest = last
        return _Walk(arcs, missing, fitting, known)

    def _is_strange(self, walk: _Walk, spans: Sequence[int], *, alone: bool) -> bool:
        """Whether spans have not been whole numbers of arcs for some time: the speed may be another one.

        If spans are `alone`, only the angles tell about them: spans that agree are taken for one arc each.
        """
        fitting, known = walk.fitting, walk.known
        if _agree(spans) and (alone or not known):
            # Gaps of so many arcs are never equal: the rotor had all but stood, and is now at speed.
            self._strange, self._spans = _STRANGE, [*spans][-REMEMBERED:]
            return True
        self._strange = 0 if 2 * fitting > known or not known else self._strange + known
        if self._strange < _STRANGE:
            return False
        # Learn the new speed from the strange spans alone.
        self._spans = self._spans[-self._strange :]
        return True

    def _fitting(self, spans: Sequence[int], arc: float) -> tuple[int, int]:
        """How many spans are a whole number of arcs, and how many are short enough to show that."""
        known = [span / arc for span in spans if 0 < span <= _TELLING * arc]
        return sum(abs(each - max(1, round(each))) <= LIKENESS for each in known), len(known)

    def _remember(self, spans: Sequence[int], arrivals: Sequence[Arrival]) -> None:
        """Keep spans, and where the rotor was when packets came, while the speed is not sure."""
        is_sure = self._certain and self._confirmed and not self._strange
        if is_sure and (not self._time_passes or self._pace.measured(self._packet_ns) is not None):
            # Time has confirmed the speed. Forgetting earlier would leave a wrong speed unchecked for ever.
            self._forget()
        self._pace.add(spans, arrivals)
        self._spans = [*self._spans, *spans][-REMEMBERED:]

    def _forget(self) -> None:
        self._spans = []
        self._pace.clear()

    def _is_confirmed(self) -> bool:
        """Whether spans may be one packet each: False only if time says that they are several."""
        by_time = self._pace.measured(self._packet_ns)
        if by_time is None:
            return True
        self._confirmed = max(by_time) < SEVERAL
        return min(by_time) < SEVERAL

    def _learn(self, latest: Sequence[int], *, anew: bool) -> tuple[int, int]:
        """Find the arc by the largest group of remembered spans that agree, and by what time says about it.

        Of these the `latest` came just now. With `anew`, no arc is known or the known one is wrong; without, only
        time can change it. Returns what is revoked, as `Arcs.revoked`.
        """
        nothing = 0, 0
        spans = sorted([span for span in self._spans if span > 0])
        if not spans:
            return nothing
        arc, agreeing = largest_group(spans)
        nearly_all_came = self._pace.shows_nearly_all(self._packet_ns)
        by_time = self._pace.measured(self._packet_ns, arc)
        if by_time is not None:
            # One arc each, if they are not all gaps.
            one_each = nearly_all_came or self._are_several(spans, arc)
            whole = 1 if one_each else max(1, round(min(by_time)))
            agrees = whole == 1 or max(abs(each / whole - 1) for each in by_time) <= OFF
            before, arc = self._arc, arc / whole
            is_found = agrees and agreeing >= FEW_AGREEING and self._are_even(spans, arc)
            if not is_found and nearly_all_came:
                # The speed changes all the time. The short ones of a few spans in a row are one arc each.
                few = sorted([span for span in self._spans[-max(AGREEING, len(latest)) :] if span > 0][:AGREEING])
                is_found, arc = bool(few), float(few[len(few) // 4]) if few else 0.0
            if is_found:
                if anew or abs(arc - before) > LIKENESS * max(arc, before):
                    self._take(arc, sure=True)
                self._confirmed = nearly_all_came or max(by_time) < SEVERAL or whole > 1
                return self._revoked(before / self._arc) if whole > 1 else nothing
            if not self._confirmed:
                self._certain = False
            return nothing
        if not anew:
            return nothing
        # Time says nothing. Gaps only lengthen spans, so the short ones are right.
        short = spans[len(spans) // 4]
        ordinary = [span for span in spans if abs(span - short) <= short / 2]
        middle = median_high(ordinary)
        agreeing = sum(abs(span - middle) <= LIKENESS * middle for span in ordinary)
        self._take(float(middle), sure=agreeing >= AGREEING)
        return nothing

    def _are_even(self, spans: Sequence[int], arc: float) -> bool:
        """Whether the spans are whole numbers of arcs, so that the rotor keeps its speed."""
        fitting, known = self._fitting(spans, arc)
        return fitting >= _FITTING * known and 2 * known > len(spans)

    def _are_several(self, spans: Sequence[int], arc: float) -> bool:
        """Whether spans are one, two and more such arcs. Half as long arcs would also give spans between these."""
        fitting, known = self._fitting(spans, arc)
        longer = sum(span > SEVERAL * arc for span in spans)
        return fitting >= _FITTING * known and longer >= _STRANGE and 4 * longer > len(spans)

    def _take(self, arc: float, *, sure: bool) -> None:
        self._arc = self._fastest = arc
        self._certain, self._strange = sure, 0


def _agree(spans: Sequence[int]) -> bool:
    """Whether enough spans agree for an arc to be certain without the help of time."""
    return len(spans) >= AGREEING and max(spans) <= (1 + LIKENESS) * min(spans)
