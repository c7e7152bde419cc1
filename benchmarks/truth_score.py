"""What was delivered of a stream whose truth is known, and how far off it is."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from benchmarks.truth_cases import Line, Mask
from benchmarks.truth_code import UNTOLD, Floats, Ints
from benchmarks.truth_streams import TrueStream
from benchmarks.truth_ways import Received
from lidario.scans.scan import Scan
from lidario.scans.sector import Sector

_OFF_DEG = 1.0
_SEAM_DEG = 2.0
"""So near to where a revolution begins a sample may be on either side."""


@dataclass(frozen=True, slots=True)
class Score:
    """What became of one stream. Where sectors are handed out, `kept` to `twice` and the times tell of them.

    Attributes:
        samples: Samples of whole revolutions.
        kept: Of these, delivered within a degree, each counted once.
        wrong: Points delivered more than a degree off, or with a distance that is not theirs; with sectors, those
            of scans and of sectors.
        strange: Of these, those with such a distance: damaged bytes passed for good ones.
        farthest_deg: The farthest off.
        mixed: Points of another revolution than most of their scan.
        twice: Points delivered that had been delivered before.
        revolutions: Whole revolutions.
        delivered: Scans.
        missing: Packets that did not come, between the first and the last.
        told: Packets counted as lost.
        missing_revolutions: Whole revolutions that were not delivered; of those behind the last one that was, as
            many as are told, for nobody can know of all of them yet.
        told_revolutions: Revolutions counted as missed.
        seq_off: By how many revolutions `Scan.seq` is off, from the first scan on, at most.
        broken: Revolutions discarded.
        rpm_off: By how much the speed is off, percent, of half of the scans and at most; None of no scan.
        no_rpm: Scans without a speed.
        times_off_ms: By how much the time of a point is off, of half of the points and at most; of those whose
            angle is right. In a file, which has no times, from the first point of the scan on.
        overlap_ms: By how much a scan begins before the one before it ends, at most.
    """

    samples: int
    kept: int
    wrong: int
    strange: int
    farthest_deg: float
    mixed: int
    twice: int
    revolutions: int
    delivered: int
    missing: int
    told: int
    missing_revolutions: int
    told_revolutions: int
    seq_off: int
    broken: int
    rpm_off: tuple[float, float] | None
    no_rpm: int
    times_off_ms: tuple[float, float] | None
    overlap_ms: float

    def row(self) -> dict[str, Any]:
        """Its figures, as many digits as they are worth."""
        return {name: _rounded(value) for name, value in asdict(self).items()}


@dataclass(frozen=True, slots=True, eq=False)
class _Points:
    """The points of one scan that are known, and which samples they are."""

    sample: Ints
    off_deg: Floats
    times_ns: Floats
    strange: int


def score(stream: TrueStream, line: Line, received: Received, *, timed: bool) -> Score:
    """How far off is what was received.

    Args:
        stream: The truth.
        line: What came of it.
        received: What was made of that.
        timed: Whether the way it took tells times.
    """
    scans, stats = received.scans, received.stats
    found = [_points(stream, scan) for scan in scans]
    numbers = [_number(stream, each) for each in found]
    parts, again = found, list[_Points]()
    if received.sectors:
        parts, again = [_points(stream, sector) for sector in received.sectors], found
    sample = np.concatenate([np.empty(0, np.int64), *(each.sample for each in parts)])
    off = np.concatenate([np.empty(0), *(each.off_deg for each in parts)])
    every = np.concatenate([off, *(each.off_deg for each in again)])
    strange = sum(each.strange for each in parts + again)
    revolution = np.floor(stream.turns).astype(np.int64)
    wanted = (revolution >= stream.whole.start) & (revolution < stream.whole.stop)
    got = np.zeros(len(stream.turns), np.bool_)
    got[sample[off <= _OFF_DEG]] = True
    known = [at for at, number in enumerate(numbers) if number is not None]
    passed = [numbers[at] - numbers[known[0]] for at in known]  # type: ignore[operator]
    return Score(
        samples=int(wanted.sum()),
        kept=int((got & wanted).sum()),
        wrong=int((every > _OFF_DEG).sum()) + strange,
        strange=strange,
        farthest_deg=float(every.max(initial=0.0)),
        mixed=sum(_mixed(stream, each, _number(stream, each)) for each in parts),
        twice=len(sample) - len(np.unique(sample)),
        revolutions=len(stream.whole),
        delivered=len(scans),
        missing=_missing(stream, line, received),
        told=stats.lost_packets,
        missing_revolutions=_missing_revolutions(stream, numbers, stats.missed_scans),
        told_revolutions=stats.missed_scans,
        seq_off=max(
            (abs(scans[at].seq - scans[known[0]].seq - by) for at, by in zip(known, passed, strict=True)), default=0
        ),
        broken=stats.broken_scans,
        rpm_off=_two(_rpm_off(stream, scans, numbers)),
        no_rpm=sum(bool(np.isnan(scan.rpm)) for scan in scans),
        times_off_ms=_two(_times_off(stream, parts, timed=timed)),
        overlap_ms=_overlap(scans) * 1e-6,
    )


def _points(stream: TrueStream, scan: Scan | Sector) -> _Points:
    there = np.flatnonzero(scan.device_distances)
    packet, place = stream.code.decode(scan.device_distances[there])
    sizes = np.diff(stream.firsts)
    fits = (packet >= 0) & (place >= 0)
    fits[fits] = place[fits] < sizes[packet[fits]]
    sample, at = stream.firsts[packet[fits]] + place[fits], there[fits]
    off = np.abs((scan.device_angles[at] - stream.degrees[sample] + 180.0) % 360.0 - 180.0)
    own = ~_takes_the_place_of_another(sample, at, off)
    strange = int((~fits & (packet != UNTOLD)).sum() + (~own).sum())
    return _Points(sample[own], off[own], scan.times_ns[at[own]].astype(np.float64), strange)


def _takes_the_place_of_another(sample: Ints, at: Ints, off_deg: Floats) -> Mask:
    """Which points stand where another sample belongs: its distance was damaged, and became that of one elsewhere.

    Between two points at their right angles, as many samples apart as places in the scan, nothing else can stand.
    """
    # The same for neighbours, where nothing is missing between them.
    number, right = sample - at, np.flatnonzero(off_deg <= _OFF_DEG)
    found = np.zeros(len(sample), np.bool_)
    apart = np.flatnonzero(np.diff(right) > 1)
    for begin, end in zip(right[apart].tolist(), right[apart + 1].tolist(), strict=True):
        if number[begin] == number[end]:
            found[begin:end] = number[begin:end] != number[begin]
    return found


def is_right(stream: TrueStream, scan: Scan | Sector) -> bool:
    """Whether no point of it is more than a degree off, or of no sample."""
    points = _points(stream, scan)
    return not points.strange and float(points.off_deg.max(initial=0.0)) <= _OFF_DEG


def _number(stream: TrueStream, points: _Points) -> int | None:
    """Of which revolution most points of a scan are."""
    if not len(points.sample):
        return None
    return int(np.median(np.floor(stream.turns[points.sample])))


def _mixed(stream: TrueStream, points: _Points, number: int | None) -> int:
    if number is None:
        return 0
    turns, edge = stream.turns[points.sample] - number, _SEAM_DEG / 360.0
    return int(((turns < -edge) | (turns > 1 + edge)).sum())


def _missing_revolutions(stream: TrueStream, numbers: list[int | None], told: int) -> int:
    last = max([number for number in numbers if number is not None], default=stream.whole.stop - 1)
    behind = stream.whole.stop - 1 - last
    missing = max(0, len(stream.whole) - len(numbers))
    return min(missing, max(missing - behind, told))


def _missing(stream: TrueStream, line: Line, received: Received) -> int:
    return len(stream.offsets) - 1 - received.packets if line.missing is None else line.missing


def _rpm_off(stream: TrueStream, scans: list[Scan], numbers: list[int | None]) -> Floats:
    """Percent from the mean speed of the revolution or of the one before it, whichever is nearer."""
    begins, off = stream.begins_ns, list[float]()
    for scan, number in zip(scans, numbers, strict=True):
        if number is None or np.isnan(scan.rpm):
            continue
        true = [
            60e9 / (begins[each + 1] - begins[each])
            for each in (number - 1, number)
            if {each, each + 1} <= set(begins)
        ]
        if true:
            off.append(min(abs(scan.rpm / each - 1) * 100 for each in true))
    return np.array(off)


def _times_off(stream: TrueStream, found: list[_Points], *, timed: bool) -> Floats:
    off = [np.empty(0)]
    for points in found:
        # What is at a wrong angle may be another sample than its distance tells, by damage.
        right = points.off_deg <= _OFF_DEG
        if right.any():
            late = (points.times_ns - stream.times_ns[points.sample])[right]
            off.append(np.abs(late if timed else late - late[0]))
    return np.concatenate(off) * 1e-6


def _overlap(scans: list[Scan]) -> float:
    ends = [int(scan.times_ns[-1]) for scan in scans if len(scan)]
    begins = [int(scan.times_ns[0]) for scan in scans if len(scan)]
    return float(max([0, *(end - begin for end, begin in zip(ends[:-1], begins[1:], strict=True))]))


def _two(off: Floats) -> tuple[float, float] | None:
    return (float(np.median(off)), float(off.max())) if len(off) else None


def _rounded(value: Any) -> Any:
    if isinstance(value, tuple | list):
        return [_rounded(each) for each in value]
    return round(value, 3) if isinstance(value, float) else value
