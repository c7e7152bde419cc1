"""Rules about streams: what a device sends in each scan mode, and what the session makes of it."""

import math
from collections.abc import Awaitable, Callable, Sequence
from functools import partial, wraps
from itertools import pairwise
from typing import TypeAlias, TypeVar

import numpy as np

from lidario.conformance.bench import Bench
from lidario.conformance.flow import Flow, Watch
from lidario.conformance.rule import Broken, Figure, NotTried, Origin, Rule, known
from lidario.scans.scan import Scan

MODES_S = 90.0  # six modes, each with 5 s for the rotor to start and 9 s for its packets and scans
SAMPLE_TIME_SHARE = 0.04
"""By how much the time of a sample may differ from what is told: 1.6 % by a USB adapter that holds bytes for 16 ms,
and crystals and resonators of cheap boards 1 %."""
BACKWARD_SHARE = 0.05  # share of packets that may begin before the one before: an angle may be noisy
ALIKE_SHARE = 0.1
STEADY_SHARE = 0.05
LATE_SHARE = 0.5
"""Turns by which time stamps may be late. Where a revolution is missing, all behind it are by a whole one. Earlier
they may be by any amount: the computer has read sooner than ever before, which dates what follows anew."""
BESIDE = 3  # revolutions of which one is dated right: a computer that pauses reads two of them together
REPORTED_SHARE = 0.05
WIDEST_GAP_DEG = 15.0
"""Of models that triangulate, the angle depends on the distance, by some 8 degrees for what is near."""
FAR_SHARE = 1.05  # devices report echoes from a little beyond the range of the data sheet

T = TypeVar("T", Watch, Flow)
Found: TypeAlias = tuple[bool, str] | tuple[bool, str, Figure]
"""Whether one mode passes, what was measured, and that as a figure for the table."""

_of_modes = partial(known, limit_s=MODES_S)


def _of_each(
    select: Callable[[Bench], Awaitable[list[T]]], origin: Origin, known_from: str
) -> Callable[[Callable[[T], Found]], Rule]:
    """Decorate a check of one mode to make a `Rule`: each selected mode passes. The rest as for `known`."""

    def made(check: Callable[[T], Found]) -> Rule:
        @wraps(check)
        async def of_all(bench: Bench) -> str:
            seen, bad = list[str](), list[str]()
            selected = await select(bench)
            for each in selected:
                held, text, *figures = check(each)
                for figure in figures:
                    bench.measured(*figure)
                seen.append(f"{each.mode.name} {text}" if len(selected) > 1 else text)
                bad += [] if held else [f"mode {each.mode.name}: {text}"]
            if bad:
                raise Broken("; ".join(bad))
            return "; ".join(seen)

        return _of_modes(origin, known_from)(of_all)

    return made


async def _with_scans(bench: Bench) -> list[Watch]:
    """The modes that brought scans. Raises NotTried where none has."""
    seen = [each for each in await bench.watches() if not each.error]
    if not seen:
        raise NotTried("no mode brought scans")
    return seen


async def _with_packets(bench: Bench, *, whole: bool = False) -> list[Flow]:
    """The packets of modes that brought some, and perhaps no scans. Raises NotTried where none has.

    With `whole` only those of which no packet was damaged or is missing.
    """
    came = [(each, each.flow) for each in await bench.watches() if each.flow and len(each.flow.packets) > 1]
    if not came:
        raise NotTried("no mode brought packets")
    flows = [flow for watch, flow in came if watch.is_whole or not whole]
    if not flows:
        raise NotTried("packets of every mode were damaged or are missing, so samples are missing")
    return flows


@_of_modes(Origin.MANUAL, "scan requests, start of the motor")
async def modes_start(bench: Bench) -> str:
    """Each scan mode that it lists starts, and brings packets and full revolutions in the time its rotor needs."""
    watches = await bench.watches()
    failed = [f"mode {each.mode.name}: {each.error}" for each in watches if each.error and not each.unknown]
    if failed:
        raise Broken("; ".join(failed))
    seen = list[str]()
    for each in watches:
        if each.flow is not None:
            bench.measured(f"first packet of {each.mode.name}", each.flow.first_s, "s")
            seen.append(f"{each.mode.name} {each.flow.first_s:.2f} s")
    if not seen:
        raise NotTried("; ".join(each.error for each in watches))
    return "first packets after " + ", ".join(seen)


@_of_each(
    partial(_with_packets, whole=True),
    Origin.MANUAL,
    "scan modes: time of a sample; where it is not told, the data sheet's rate",
)
def sample_time(flow: Flow) -> Found:
    """A sample takes the time that the device tells."""
    told, measured = flow.mode.sample_us, flow.sample_us()
    figure = Figure(f"sample of {flow.mode.name}", measured, "us")
    if not told:
        return True, "not told", figure
    share = measured / told - 1
    text = f"told {told:.2f} us, measured {measured:.2f} us ({share:+.1%})"
    return abs(share) <= SAMPLE_TIME_SHARE, text, figure


@_of_each(_with_packets, Origin.MANUAL, "packets: start angle; direction of rotation")
def turns_clockwise(flow: Flow) -> Found:
    """Angles increase clockwise from packet to packet, as the model says."""
    # A mirrored device goes backward.
    steps = flow.steps()
    backward = float(np.mean(steps > 0.5)) if len(steps) else math.nan
    return backward <= BACKWARD_SHARE, f"{backward:.0%} of {len(steps)} packets begin before the one before"


@_of_each(_with_scans, Origin.MANUAL, "packets: check values; and what you can rely on: losses counted")
def packets_are_whole(watch: Watch) -> Found:
    """On a line without faults every byte of a stream belongs to an intact packet, and none is missing."""
    names = ("skipped_bytes", "lost_packets", "doubled_packets", "broken_scans", "discarded_bytes")
    counts = {name: getattr(watch.after, name) - getattr(watch.before, name) for name in names}
    bad = ", ".join(f"{count} {name}" for name, count in counts.items() if count)
    return not bad, bad or f"{watch.after.packets - watch.before.packets} packets"


@_of_each(_with_scans, Origin.PROMISE, "what you can rely on: losses counted")
def revolutions_follow(watch: Watch) -> Found:
    """Revolutions follow each other: none is missing, and their time stamps meet."""
    # One stamp may be late; behind a missing revolution all are.
    late = [0.0]
    for one, two in pairwise(watch.scans):
        if two.seq != one.seq + 1:
            return False, f"revolution {two.seq} comes behind {one.seq}"
        late.append(late[-1] + (two.stamp_ns - one.stamp_ns) / one.duration_ns * _seen_of(one) - 1)
    for at in range(BESIDE, len(late) - BESIDE + 1):
        step = min(late[at : at + BESIDE]) - min(late[at - BESIDE : at])
        if step > LATE_SHARE:
            return False, f"revolution {watch.scans[at].seq} begins {1 + step:.2f} turns behind the one before"
    return True, f"{len(watch.scans)} in a row"


@_of_each(_with_scans, Origin.PROMISE, "full revolutions")
def revolutions_are_full(watch: Watch) -> Found:
    """Revolutions have about as many samples each, and as many as speed and time of a sample say."""
    counts = [len(scan) for scan in watch.scans]
    usual = float(np.median(counts))
    worst = max(abs(count - usual) for count in counts) / usual
    text = f"{min(counts)} to {max(counts)} samples"
    flow = watch.flow
    assert flow is not None
    due = 60e6 / (rpm_by_time(watch.scans) * flow.sample_us())
    due *= _seen_of(watch.scans[0])
    if abs(usual / due - 1) > ALIKE_SHARE:
        return False, f"{text}, and {due:.0f} were taken in the time of a revolution"
    return worst <= ALIKE_SHARE, text


@_of_each(_with_scans, Origin.PROMISE, "full revolutions")
def circle_is_whole(watch: Watch) -> Found:
    """The samples of a revolution go round the whole circle, or what of it the device sees."""
    widest = blind = 0.0
    for scan in watch.scans:
        blind = 360.0 * (1.0 - _seen_of(scan))
        angles = np.sort(scan.device_angles.astype(np.float64))
        widest = max(widest, float(np.diff(angles, append=angles[0] + 360.0).max()))
    return widest <= blind + WIDEST_GAP_DEG, f"widest gap {widest:.1f} degrees"


@_of_each(_with_scans, Origin.MANUAL, "scan modes: farthest distance; the data sheet's range")
def ranges_are_possible(watch: Watch) -> Found:
    """Distances lie within the range of the scan mode, and something is seen at all."""
    far = max((float(np.nanmax(scan.ranges, initial=0.0)) for scan in watch.scans), default=0.0)
    if not far:
        return False, "no return at all"
    limit = watch.mode.max_distance
    text = f"farthest {far:.2f} m"
    return not limit or far <= limit * FAR_SHARE, text + (f" of {limit:g} m" if limit else "")


@_of_each(
    _with_scans,
    Origin.MANUAL,
    "data sheet: scan frequency; a revolution lasts as long as its neighbours, within 5 %",
)
def rotor_is_steady(watch: Watch) -> Found:
    """The rotor turns steadily."""
    speeds = [scan.rpm for scan in watch.scans if scan.rpm == scan.rpm]
    if not speeds:
        return False, "no speed could be measured"
    flow = watch.flow
    assert flow is not None
    # What neighbours took by their samples: when they are read, depends on the computer. But where a packet is a
    # whole scan, it has as many samples at any speed.
    by_clock, ticks = flow.turns_ns().tolist(), flow.stream.format.ticks
    off = 2 * ticks.tick_ns if by_clock and ticks is not None else 0
    took = by_clock or [float(scan.duration_ns) for scan in watch.scans]
    worst = max((max(0.0, abs(two - one) - off) / max(one, 1.0) for one, two in pairwise(took)), default=0.0)
    hertz = float(np.median(speeds)) / 60
    text = f"{hertz:.2f} Hz, neighbours within {worst:.1%}"
    return worst <= STEADY_SHARE, text, Figure(f"scan frequency of {watch.mode.name}", hertz, "Hz")


@_of_each(_with_scans, Origin.MANUAL, "packets: scan frequency, or speed")
def reported_speed(watch: Watch) -> Found:
    """The speed that stands in the packets is the one measured."""
    reported = [scan.reported_rpm for scan in watch.scans if scan.reported_rpm == scan.reported_rpm]
    if not reported:
        raise NotTried("its packets tell no speed")
    told, measured = float(np.median(reported)), rpm_by_time(watch.scans)
    share = told / measured - 1
    return abs(share) <= REPORTED_SHARE, f"told {told:.0f} rpm, measured {measured:.0f} rpm ({share:+.1%})"


def rpm_by_time(scans: Sequence[Scan]) -> float:
    """The speed by the time between neighbouring scans: in some formats `Scan.rpm` rests on what is told."""
    took = [two.stamp_ns - one.stamp_ns for one, two in pairwise(scans) if two.seq == one.seq + 1]
    return 60e9 / float(np.median(took)) if took else math.nan


def _seen_of(scan: Scan) -> float:
    """Share of a revolution that the device sees, 0 to 1."""
    return abs(scan.field_of_view) / 360.0
