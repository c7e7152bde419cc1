"""How soon all is right again behind trouble: damage for two seconds, then an undamaged line.

Damage costs what it hits. It must cost nothing that comes later: what is believed of the rotor while little comes,
or while noise passes for packets, may be wrong, and has to be given up once everything comes again.

Nothing here is timed, and the same command prints the same figures. The streams are those of "truth".
"""

from __future__ import annotations

import math
import statistics
from collections.abc import Iterator
from dataclasses import replace
from functools import cache, partial

import numpy as np

from benchmarks.report import Result, Setting, Table
from benchmarks.truth_cases import (
    CASES,
    Damage,
    Line,
    drifting,
    flip_bytes,
    lose_share,
    lose_stretches,
    repeat_packets,
)
from benchmarks.truth_forms import FORMATS
from benchmarks.truth_score import is_right
from benchmarks.truth_streams import Form, TrueStream, true_stream
from benchmarks.truth_ways import receive
from lidario.scans.scan import Scan

LASTS_S = 2.0
_BEGINS_S = (0.8, 1.2)
_SECONDS = 6.5
_SEEDS = 12


def _garbage(stream: TrueStream, random: np.random.Generator) -> Line:
    return Line(random.integers(0, 256, len(stream.data), np.uint8), stream.arrivals_ns, None)


def _again(stream: TrueStream, random: np.random.Generator) -> Line:
    """Six times, a stretch of up to 0.4 s comes once more, right behind itself."""
    pieces, done = [np.arange(0)], 0
    for end in np.sort(random.integers(0, len(stream.data), 6)).tolist():
        back = int(random.uniform(0.01, 0.2) * len(stream.data))
        pieces += [np.arange(done, end), np.arange(max(0, end - back), end)]
        done = end
    places = np.concatenate([*pieces, np.arange(done, len(stream.data))])
    return Line(stream.data[places], np.maximum.accumulate(stream.arrivals_ns[places]), None)


def _held_back(stream: TrueStream, random: np.random.Generator) -> Line:
    """Bytes come up to two seconds late, all at once."""
    late_ns = random.uniform(0.2, LASTS_S) * 1e9
    at_ns = np.maximum(stream.arrivals_ns, stream.arrivals_ns[0] + late_ns)
    return Line(stream.data, at_ns, 0)


_USED = (
    "each second packet gone",
    "40 % of the packets gone",
    "60 % of the packets gone",
    "each second packet spoilt",
    "60 % of the packets spoilt",
    "1 % of the bytes lost",
    "2 % of the bytes lost",
    "1 % of the bytes flipped",
    "2 % of the bytes flipped",
    "bursts of 200 bytes",
    "an outage of 0.3 s",
    "an outage of two turns",
    "10 % of the packets twice",
)
TROUBLES: dict[str, Damage] = {name: CASES[name].damage for name in _USED} | {
    "85 % of the packets gone": partial(lose_share, 85, spoilt=False),
    "90 % of the packets spoilt": partial(lose_share, 90, spoilt=True),
    "10 % of the bytes flipped": partial(flip_bytes, 10),
    "random bytes": _garbage,
    "outages of 0.1 s each 0.23 s": partial(lose_stretches, 0.23, 0.1),
    "each packet twice": partial(repeat_packets, 1.0),
    "stretches that come again": _again,
    "held back by up to 2 s": _held_back,
}
"""What happens to two seconds of each stream."""


def run(setting: Setting) -> Result:
    """Every trouble, in every format, several times each."""
    table = Table(
        "Recovery", ("two seconds of", "runs", "seconds until all is right: half, longest", "never", "longest in")
    )
    seeds = range(1 if setting.quick else _SEEDS)
    for name in TROUBLES:
        if not any(setting.selects(form, name) for form in FORMATS):
            continue
        setting.say(name)
        found = {
            (form, seed): seconds_until_right(FORMATS[form], name, seed)
            for form in FORMATS
            if setting.selects(form, name)
            for seed in seeds
        }
        longest = max(found, key=lambda each: found[each])
        never = sum(math.isinf(each) for each in found.values())
        half, most = statistics.median(found.values()), found[longest]
        table.add(name, str(len(found)), f"{half:.2f}, {most:.2f}", str(never), f"{longest[0]}, seed {longest[1]}")
    return Result("recovery", [table], {}, [])


def seconds_until_right(form: Form, trouble: str, seed: int) -> float:
    """From the end of the trouble to the last scan that was not right; infinite where the stream ends before.

    Right is a scan of which nothing is missing, whose points are all where they should be, whose speed is known,
    and which is the next one behind the scan before it.
    """
    stream, random = _stream(form), np.random.default_rng(seed)
    begin = random.uniform(*_BEGINS_S)
    line, end_ns = _troubled(stream, TROUBLES[trouble], random, begin)
    scans = receive(stream, line, "read", seed).scans
    turn_ns = 1e9 / form.hertz
    last = stream.begins_ns[stream.whole.stop - 1]
    if not scans or scans[-1].stamp_ns < last - turn_ns / 2:
        return math.inf
    return max([0.0, *(wrong_ns - end_ns for wrong_ns in _wrong(stream, scans, turn_ns))]) * 1e-9


@cache
def _stream(form: Form) -> TrueStream:
    return true_stream(form, partial(drifting, form.hertz), _SECONDS)


def _troubled(stream: TrueStream, damage: Damage, random: np.random.Generator, begin: float) -> tuple[Line, float]:
    """The line of a stream with the damage in the midst of it, and when that ends."""
    begins = stream.times_ns[stream.firsts[:-1]] * 1e-9
    first, behind = np.searchsorted(begins, (begin, begin + LASTS_S)).tolist()
    low, high = int(stream.offsets[first]), int(stream.offsets[behind])
    piece = replace(
        stream,
        data=stream.data[low:high],
        offsets=stream.offsets[first : behind + 1] - low,
        firsts=stream.firsts[first : behind + 1],
    )
    hit = damage(piece, random)
    data = np.concatenate([stream.data[:low], hit.data, stream.data[high:]])
    at_ns = np.concatenate([stream.arrivals_ns[:low], hit.at_ns, stream.arrivals_ns[high:]])
    at_ns = np.maximum.accumulate(at_ns)
    return Line(data, at_ns, None), float(at_ns[low + len(hit.data)])


def _wrong(stream: TrueStream, scans: list[Scan], turn_ns: float) -> Iterator[float]:
    """When scans ended that were not right."""
    before = None
    for scan in scans:
        follows = before is None or (
            scan.seq == before.seq + 1 and scan.stamp_ns < before.stamp_ns + before.duration_ns + turn_ns / 2
        )
        if not follows:
            yield scan.stamp_ns
        if scan.lost_packets or not scan.rpm > 0 or not is_right(stream, scan):
            yield scan.stamp_ns + scan.duration_ns
        before = scan
