"""Rules about streams: what a device sends in each scan mode, and what the session makes of it."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from functools import partial
from itertools import pairwise

import numpy as np

from lidario.conformance.bench import Bench
from lidario.conformance.flow import Flow, Watch
from lidario.conformance.rule import Broken, NotTried, Origin, known
from lidario.scan import Scan

MODES_S = 90.0
"""Six modes, each with 5 s for the rotor to start and 9 s for its packets and scans."""
SAMPLE_TIME_SHARE = 0.04
"""By how much the time of a sample may differ from what is told: 1.6 % by a USB adapter that holds bytes for 16 ms,
and crystals and resonators of cheap boards 1 %."""
BACKWARD_SHARE = 0.05
"""Share of packets that may begin before the one before: an angle may be noisy."""
ALIKE_SHARE = 0.1
STEADY_SHARE = 0.05
LATE_SHARE = 0.5
"""Turns by which time stamps may be off. Where a revolution is missing, all behind it are off by a whole one."""
BESIDE = 3
"""Revolutions of which one is dated right: a computer that pauses reads two of them together."""
REPORTED_SHARE = 0.05
WIDEST_GAP_DEG = 15.0
"""Of models that triangulate, the angle depends on the distance, by some 8 degrees for what is near."""
FAR_SHARE = 1.05
"""Devices report echoes from a little beyond the range of the data sheet."""

_of_modes = partial(known, limit_s=MODES_S)


@_of_modes(
    "Each scan mode that it lists starts, and brings packets and full revolutions in the time its rotor needs.",
    Origin.MANUAL,
    "scan requests, start of the motor",
)
async def modes_start(bench: Bench) -> str:
    """Start every mode; what is seen is kept for the rules that follow."""
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


@_of_modes(
    "A sample takes the time that the device tells.",
    Origin.MANUAL,
    "scan modes: time of a sample; where it is not told, the data sheet's rate",
)
async def sample_time(bench: Bench) -> str:
    """Compare with the times at which packets came."""

    def off(flow: Flow) -> tuple[bool, str]:
        told, measured = flow.mode.sample_us, flow.sample_us()
        bench.measured(f"sample of {flow.mode.name}", measured, "us")
        if not told:
            return True, "not told"
        share = measured / told - 1
        return abs(share) <= SAMPLE_TIME_SHARE, f"told {told:.2f} us, measured {measured:.2f} us ({share:+.1%})"

    return await _each_flow(bench, off, whole=True)


@_of_modes(
    "Angles increase clockwise from packet to packet, as the model says.",
    Origin.MANUAL,
    "packets: start angle; direction of rotation",
)
async def turns_clockwise(bench: Bench) -> str:
    """Compare the beginnings of neighbouring packets: a mirrored device goes backward."""

    def forward(flow: Flow) -> tuple[bool, str]:
        steps = flow.steps()
        backward = float(np.mean(steps > 0.5)) if len(steps) else math.nan
        return backward <= BACKWARD_SHARE, f"{backward:.0%} of {len(steps)} packets begin before the one before"

    return await _each_flow(bench, forward)


@_of_modes(
    "On a line without faults every byte of a stream belongs to an intact packet, and none is missing.",
    Origin.MANUAL,
    "packets: check values; and what you can rely on: losses counted",
)
async def packets_are_whole(bench: Bench) -> str:
    """Compare the counters before and behind some scans."""

    def whole(watch: Watch) -> tuple[bool, str]:
        names = ("skipped_bytes", "lost_packets", "doubled_packets", "broken_scans", "discarded_bytes")
        counts = {name: getattr(watch.after, name) - getattr(watch.before, name) for name in names}
        bad = ", ".join(f"{count} {name}" for name, count in counts.items() if count)
        return not bad, bad or f"{watch.after.packets - watch.before.packets} packets"

    return await _each_watch(bench, whole)


@_of_modes(
    "Revolutions follow each other: none is missing, and their time stamps meet.",
    Origin.PROMISE,
    "what you can rely on: losses counted",
)
async def revolutions_follow(bench: Bench) -> str:
    """Compare numbers and times of scans. One stamp may be late; behind a missing revolution all are."""

    def follow(watch: Watch) -> tuple[bool, str]:
        late = [0.0]
        for one, two in pairwise(watch.scans):
            if two.seq != one.seq + 1:
                return False, f"revolution {two.seq} comes behind {one.seq}"
            late.append(late[-1] + (two.stamp_ns - one.stamp_ns) / one.duration_ns * _seen_of(one) - 1)
        for at in range(BESIDE, len(late) - BESIDE + 1):
            step = min(late[at : at + BESIDE]) - min(late[at - BESIDE : at])
            if abs(step) > LATE_SHARE:
                return False, f"revolution {watch.scans[at].seq} begins {1 + step:.2f} turns behind the one before"
        return True, f"{len(watch.scans)} in a row"

    return await _each_watch(bench, follow)


@_of_modes(
    "Revolutions have about as many samples each, and as many as speed and time of a sample say.",
    Origin.PROMISE,
    "full revolutions",
)
async def revolutions_are_full(bench: Bench) -> str:
    """Count the samples."""

    def alike(watch: Watch) -> tuple[bool, str]:
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

    return await _each_watch(bench, alike)


@_of_modes(
    "The samples of a revolution go round the whole circle, or what of it the device sees.",
    Origin.PROMISE,
    "full revolutions",
)
async def circle_is_whole(bench: Bench) -> str:
    """Look for the widest gap between neighbouring angles."""

    def covered(watch: Watch) -> tuple[bool, str]:
        widest = blind = 0.0
        for scan in watch.scans:
            blind = 360.0 * (1.0 - _seen_of(scan))
            angles = np.sort(scan.device_angles.astype(np.float64))
            widest = max(widest, float(np.diff(angles, append=angles[0] + 360.0).max()))
        return widest <= blind + WIDEST_GAP_DEG, f"widest gap {widest:.1f} degrees"

    return await _each_watch(bench, covered)


@_of_modes(
    "Distances lie within the range of the scan mode, and something is seen at all.",
    Origin.MANUAL,
    "scan modes: farthest distance; the data sheet's range",
)
async def ranges_are_possible(bench: Bench) -> str:
    """Look at the farthest return."""

    def possible(watch: Watch) -> tuple[bool, str]:
        far = max((float(np.nanmax(scan.ranges, initial=0.0)) for scan in watch.scans), default=0.0)
        if not far:
            return False, "no return at all"
        limit = watch.mode.max_distance
        text = f"farthest {far:.2f} m"
        return not limit or far <= limit * FAR_SHARE, text + (f" of {limit:g} m" if limit else "")

    return await _each_watch(bench, possible)


@_of_modes(
    "The rotor turns steadily.",
    Origin.MANUAL,
    "data sheet: scan frequency; a revolution lasts as long as its neighbours, within 5 %",
)
async def rotor_is_steady(bench: Bench) -> str:
    """Compare what neighbouring revolutions took by their samples: when they are read, depends on the computer."""

    def steady(watch: Watch) -> tuple[bool, str]:
        speeds = [scan.rpm for scan in watch.scans if scan.rpm == scan.rpm]
        if not speeds:
            return False, "no speed could be measured"
        flow = watch.flow
        assert flow is not None
        assert flow.stream is not None
        # Where a packet is a whole scan, it has as many samples at any speed.
        by_clock, ticks = flow.turns_ns().tolist(), flow.stream.format.ticks
        off = 2 * ticks.tick_ns if by_clock and ticks is not None else 0
        took = by_clock or [float(scan.duration_ns) for scan in watch.scans]
        worst = max((max(0.0, abs(two - one) - off) / max(one, 1.0) for one, two in pairwise(took)), default=0.0)
        bench.measured(f"scan frequency of {watch.mode.name}", float(np.median(speeds)) / 60, "Hz")
        return worst <= STEADY_SHARE, f"{np.median(speeds) / 60:.2f} Hz, neighbours within {worst:.1%}"

    return await _each_watch(bench, steady)


@_of_modes(
    "The speed that stands in the packets is the one measured.",
    Origin.MANUAL,
    "packets: scan frequency, or speed",
)
async def reported_speed(bench: Bench) -> str:
    """Compare the speed in the packets with the measured one."""

    def agrees(watch: Watch) -> tuple[bool, str]:
        reported = [scan.reported_rpm for scan in watch.scans if scan.reported_rpm == scan.reported_rpm]
        if not reported:
            raise NotTried("its packets tell no speed")
        told, measured = float(np.median(reported)), rpm_by_time(watch.scans)
        share = told / measured - 1
        return abs(share) <= REPORTED_SHARE, f"told {told:.0f} rpm, measured {measured:.0f} rpm ({share:+.1%})"

    return await _each_watch(bench, agrees)


def rpm_by_time(scans: Sequence[Scan]) -> float:
    """The speed by the time between neighbouring scans: in some formats `Scan.rpm` rests on what is told."""
    took = [two.stamp_ns - one.stamp_ns for one, two in pairwise(scans) if two.seq == one.seq + 1]
    return 60e9 / float(np.median(took)) if took else math.nan


def _seen_of(scan: Scan) -> float:
    """Share of a revolution that the device sees, 0 to 1."""
    return abs(scan.field_of_view) / 360.0


async def _seen(bench: Bench) -> list[Watch]:
    """The modes that brought scans.

    Raises:
        NotTried: None has.
    """
    seen = [each for each in await bench.watches() if not each.error]
    if not seen:
        raise NotTried("no mode brought scans")
    return seen


async def _each_watch(bench: Bench, check: Callable[[Watch], tuple[bool, str]]) -> str:
    """Check every mode that brought scans; what was measured, of each mode.

    Raises:
        Broken: Some do not pass.
    """
    return _judged([(each.mode.name, *check(each)) for each in await _seen(bench)])


async def _each_flow(bench: Bench, check: Callable[[Flow], tuple[bool, str]], *, whole: bool = False) -> str:
    """As `_each_watch`, over the packets; also of modes that brought packets, but no scans.

    Args:
        bench: The bench.
        check: Looks at the packets of a mode.
        whole: Whether only those are looked at of which no packet was damaged or is missing.
    """
    watches = [each for each in await bench.watches() if each.flow is not None and len(each.flow.packets) > 1]
    if not watches:
        raise NotTried("no mode brought packets")
    flows = [each.flow for each in watches if each.flow is not None and (each.is_whole or not whole)]
    if not flows:
        raise NotTried("packets of every mode were damaged or are missing, so samples are missing")
    return _judged([(flow.mode.name, *check(flow)) for flow in flows])


def _judged(found: list[tuple[str, bool, str]]) -> str:
    """What was measured, by the name of each mode, whether it passes, and that."""
    bad = [f"mode {name}: {text}" for name, held, text in found if not held]
    if bad:
        raise Broken("; ".join(bad))
    return "; ".join(f"{name} {text}" if len(found) > 1 else text for name, _, text in found)
