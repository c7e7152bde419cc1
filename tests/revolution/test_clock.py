"""Revolutions that are missing: `seq` jumps by them, lost packets are told, the speed is right or unknown."""

import math
from asyncio import timeout
from collections.abc import Iterable, Sequence
from contextlib import suppress
from dataclasses import replace
from functools import cache
from itertools import accumulate, pairwise

import numpy as np
import pytest

from benchmarks.streams import KINDS as STEADY
from benchmarks.streams import capture
from lidario.errors import StreamFailed
from lidario.revolution.assemble import Assembler, AssemblerStats
from lidario.revolution.clock import Beginning, Passed, RevolutionClock
from lidario.scan import Scan
from lidario.sim.faults import parse_faults
from lidario.wire.blocks import packet_offsets
from tests.support.devices import make_rig
from tests.support.loop import driven
from tests.support.streams import in_one_run

MS = 1_000_000
ONE_A_PARSER = ["0x81 nodes", "0x83 HQ", "0x85 dense", "4ROS points"]
every_kind = pytest.mark.exhaustive("name", sample=ONE_A_PARSER, full=list(STEADY))


@cache
def packets_of(name: str) -> list[tuple[bytes, int]]:
    """Two and a half seconds of a rotor that turns steadily: packets, and when each arrives."""
    kind = STEADY[name]
    raw, wire = bytearray(capture(kind, 2.5)[7:]), kind.make_format()
    found: list[bytes] = []
    at = 0
    while (stretch := wire.next_stretch(raw, at)).end > at:
        for begin, end in pairwise(packet_offsets(stretch.packets)):
            found.append(bytes(raw[at + begin : at + end]))
        at = stretch.end
    byte_ns = 2.5e9 / len(raw)
    return [(packet, round(end * byte_ns)) for packet, end in zip(found, accumulate(map(len, found)), strict=True)]


def assembled_from(name: str, packets: Iterable[tuple[bytes, float]]) -> tuple[list[Scan], AssemblerStats]:
    """The scans of packets that arrive one by one, or 20 of the shortest together."""
    kind = STEADY[name]
    assembler, wire = Assembler(kind.stream()), kind.make_format()
    scans: list[Scan] = []
    several, last_ns = b"", 0.0
    for packet, at_ns in packets:
        if several and (len(several) >= 100 or at_ns - last_ns > 5e6):
            scans += assembler.add(in_one_run(wire, several, round(last_ns)))
            several = b""
        several, last_ns = several + packet, at_ns
    return scans + assembler.add(in_one_run(wire, several, round(last_ns))), assembler.stats


@cache
def clean_scans(name: str) -> list[Scan]:
    """The scans of those packets, when nothing happens to them."""
    return assembled_from(name, packets_of(name))[0]


def hertz(name: str) -> float:
    """Revolutions a second."""
    return 7.0 if STEADY[name].family == "ydlidar" else 10.0


@every_kind
@pytest.mark.exhaustive("revolutions", sample=[1.0, 5.5], full=[0.4, 0.97, 1.0, 1.3, 2.0, 2.6, 5.5, 8.1])
@pytest.mark.exhaustive("place", sample=[2.05, 2.9], full=[2.05, 2.5, 2.9])
def test_an_outage_is_told_in_full(name: str, revolutions: float, place: float) -> None:
    """Whatever part of a revolution comes on top: packets by the angle, revolutions by the time."""
    packets, clean = packets_of(name), clean_scans(name)
    each = len(packets) / 2.5 / hertz(name)
    begin = round(place * each)
    gone = round(revolutions * each)
    scans, stats = assembled_from(name, [*packets[:begin], *packets[begin + gone :]])
    # Revolutions do not have a whole number of packets.
    assert stats.lost_packets == pytest.approx(gone, abs=3 + 0.01 * gone)
    numbers = [scan.seq for scan in scans]
    assert numbers[0] == 0
    assert all(after > before for before, after in pairwise(numbers))
    assert numbers[-1] + 1 == len(clean)
    assert stats.missed_scans == len(clean) - len(scans)
    assert stats.missed_scans >= int(revolutions) - 1
    for scan in scans:
        # The same revolution of the undamaged stream has the same number, also where the angles show no gap.
        assert abs(scan.stamp_ns - clean[scan.seq].stamp_ns) < 0.95e9 / hertz(name)
        assert math.isnan(scan.rpm) or scan.rpm == pytest.approx(60 * hertz(name), rel=0.03)
    assert sum(math.isnan(scan.rpm) for scan in scans) <= 2


@every_kind
def test_a_clean_stream_misses_nothing(name: str) -> None:
    scans, stats = assembled_from(name, packets_of(name))
    assert [scan.seq for scan in scans] == list(range(len(scans)))
    assert len(scans) > 14
    assert (stats.missed_scans, stats.lost_packets) == (0, 0)
    assert all(scan.rpm == pytest.approx(60 * hertz(name), rel=0.01) for scan in scans)


@every_kind
@pytest.mark.exhaustive("late", sample=[0.6, 2.5], full=[0.2, 0.6, 1.4, 2.5])
@pytest.mark.parametrize("back", [0.01, 1.0])
def test_late_stamps_are_no_missing_revolutions(name: str, late: float, back: float) -> None:
    """From one moment on all comes late, and whole; the backlog is worked off at once, or in some revolutions."""
    revolution_ns, delayed = 1e9 / hertz(name), list[tuple[bytes, float]]()
    stall_ns, until_ns = 3.5 * revolution_ns, (3.5 + late) * revolution_ns
    for packet, at_ns in packets_of(name):
        delay = max(0.0, until_ns - max(0.0, at_ns - stall_ns) * back - at_ns) if at_ns > stall_ns else 0.0
        delayed.append((packet, at_ns + delay))
    scans, stats = assembled_from(name, delayed)
    assert stats.lost_packets == 0
    assert stats.missed_scans == stats.broken_scans
    assert len(scans) + stats.broken_scans == len(clean_scans(name))


@every_kind
@pytest.mark.exhaustive("share", sample=[0.09, 0.6], full=[0.03, 0.09, 0.3, 0.6, 0.85, 0.92, 0.97])
@pytest.mark.parametrize("together", [False, True])
def test_a_late_first_arrival_bends_no_speed(name: str, share: float, together: bool) -> None:
    """A stream begins inside a revolution, and what comes of that one comes 2 ms late; live, and from a file."""
    seam_ns = clean_scans(name)[3].stamp_ns
    packets = [each for each in packets_of(name) if each[1] > seam_ns - share * 1e9 / hertz(name)]
    # The last late one is that which crosses the seam.
    first = 1 + next(n for n, (_, at_ns) in enumerate(packets) if at_ns > seam_ns + MS)
    first_ns = packets[first - 1][1] + 2 * MS
    if together:
        kind = STEADY[name]
        wire, assembler = kind.make_format(), Assembler(kind.stream())
        early, behind = (b"".join(packet for packet, _ in part) for part in (packets[:first], packets[first:]))
        scans = assembler.add(in_one_run(wire, early, first_ns))
        scans += assembler.add(in_one_run(wire, behind, packets[-1][1]))
    else:
        late = [(packet, at_ns + 2 * MS) for packet, at_ns in packets[:first]]
        late += [(packet, max(at_ns, first_ns)) for packet, at_ns in packets[first:]]
        scans, _ = assembled_from(name, late)
    assert len(scans) > 12
    assert all(scan.rpm == pytest.approx(60 * hertz(name), rel=0.03) for scan in scans)


@every_kind
def test_an_outage_that_is_read_late_leaves_no_scan_of_two_revolutions(name: str) -> None:
    """A blocked program finds what the buffer kept from before it and what came behind it, with one time."""
    packets, kind = packets_of(name), STEADY[name]
    each = len(packets) / 2.5 / hertz(name)
    blocked, lost, back, free = (round(turns * each) for turns in (3.5, 6.4, 11.6, 13.7))
    assembler, wire, scans = Assembler(kind.stream()), kind.make_format(), list[Scan]()
    for packet, at_ns in packets[:blocked]:
        scans += assembler.add(in_one_run(wire, packet, at_ns))
    kept = b"".join(packet for packet, _ in [*packets[blocked:lost], *packets[back:free]])
    scans += assembler.add(in_one_run(wire, kept, packets[free - 1][1]))
    for packet, at_ns in packets[free:]:
        scans += assembler.add(in_one_run(wire, packet, at_ns))
    assert assembler.stats.lost_packets == pytest.approx(back - lost, abs=3 + 0.01 * (back - lost))
    assert all(not scan.lost_packets for scan in scans)
    assert scans[-1].seq + 1 == len(clean_scans(name))


def beginning(start: float, lost: int = 0, over: float = 0.0) -> Beginning:
    """The next revolution begins, `start` revolutions after the stream; in its packets are such figures."""
    return Beginning(round(start * 100 * MS), over, 100.0 * MS, 80.0, 1.25 * MS, 80 - lost, lost, broken=False)


def told(beginnings: Iterable[Beginning]) -> list[Passed]:
    """What a clock tells of them, each with the number that was counted up to it."""
    clock, number, packets, found = RevolutionClock(), 0, 0, list[Passed]()
    for each in beginnings:
        found.append(clock.follow(replace(each, number=number, packets_before=packets)))
        number += 1 + found[-1].unseen
        packets += each.packets + each.lost + found[-1].lost
    return found


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("lost", [0, 3])
def test_noise_never_makes_it_jump(seed: int, lost: int) -> None:
    """Stamps off by up to a third of a revolution, a thousand times, a rotor 5 % slower than the samples say."""
    random = np.random.default_rng(seed)
    beginnings = [beginning(1.05 * number + random.uniform(0, 0.29), lost) for number in range(1000)]
    assert {(passed.unseen, passed.lost) for passed in told(beginnings)} == {(0, 0)}


def test_an_outage_with_a_gap_is_told_at_once_and_one_without_when_it_lasts() -> None:
    def unseen(starts: Sequence[float], lost: int | None = None, read: float = 1.0) -> list[int]:
        reads_ns = behind_a_silence(round(read * 100 * MS))
        found = told(replace(beginning(n, n == lost), reads_ns=reads_ns) for n in starts)
        return [passed.unseen for passed in found]

    assert unseen((0, 1, 2, 6, 7), lost=2) == [0, 0, 0, 3, 0]
    # Where each takes a revolution to read, it is told at once; where it is read in a moment, when that has lasted.
    assert unseen((0, 1, 2, 6, 7)) == [0, 0, 0, 3, 0]
    assert unseen((0, 1, 2, 6, 7, 8, 9), read=0.2) == [0, 0, 0, 0, 0, 3, 0]
    assert unseen((0, 1, 2, 6, 7, 8, 9), read=0.0) == [0] * 7
    # Late, and back: nothing was missing.
    assert unseen((0, 1, 3.9, 4, 4.2, 5), read=0.1) == [0] * 6


def behind_a_silence(read_ns: int) -> tuple[int, ...]:
    """Reads that took so long, behind a silence of ten revolutions; none if they took no time."""
    return (0, 1000 * MS, 1000 * MS + read_ns) if read_ns else ()


@pytest.mark.parametrize("lost", [0, 20])
def test_without_a_silence_no_revolution_passes_unseen(lost: int) -> None:
    """A rotor that was held for half a second: only packets may be missing, as time tells. A silence hides some."""
    reads = tuple(range(0, 600 * MS, 10 * MS))
    starts = [replace(beginning(n, lost), reads_ns=reads) for n in (0, 1, 2, 7, 8)]
    starts[2].broken = lost > 0
    found = told(starts)
    assert [passed.unseen for passed in found] == [0] * 5
    assert [passed.lost for passed in found] == [0, 0, 0, 320, 0]
    for silence_ns, unseen in ((60 * MS, 0), (80 * MS, 1), (240 * MS, 3), (1000 * MS, 4)):
        starts[2].reads_ns = (0, 0, 10 * MS, 10 * MS + silence_ns)
        assert told(starts)[3] == Passed(unseen, 320)


def numbered(start: float, number: int, **changes: object) -> Beginning:
    """As `beginning`, with the number that was counted up to it."""
    return replace(beginning(start), number=number, packets_before=number * 80, **changes)  # type: ignore[arg-type]


def test_what_passes_while_nothing_is_known_is_told_afterwards() -> None:
    """Behind a restart, and before a speed was ever sure."""
    clock = RevolutionClock()
    assert [clock.follow(numbered(n, n)).unseen for n in (0, 1, 2)] == [0, 0, 0]
    clock.restart()
    # The fifth one begins, and only three have a number.
    passed = clock.follow(numbered(5, 3))
    assert passed.unseen == 2
    assert passed.lost == pytest.approx(160, abs=3)
    assert clock.follow(numbered(6, 6)).unseen == 0
    # Counted too many meanwhile: not told again until as many have passed.
    clock.restart()
    assert clock.follow(numbered(8, 9)).unseen == 0
    clock.restart()
    assert clock.follow(numbered(12, 11)).unseen == 1


@pytest.mark.parametrize(("early", "is_none"), [(0.6, False), (0.7, True), (1.0, True), (1.3, True), (1.4, False)])
@pytest.mark.parametrize("read_ns", [0, 100 * MS])
@pytest.mark.parametrize("packets", [60, 79])
def test_one_that_begins_a_whole_revolution_early_is_none(
    early: float, is_none: bool, read_ns: int, packets: int
) -> None:
    """Where it is known when bytes were read, and not all of it came. The next one is one revolution on."""
    clock = RevolutionClock()
    reads_ns = behind_a_silence(read_ns)
    for n in range(4):
        assert clock.follow(numbered(n, n, reads_ns=reads_ns)).unseen == 0
    is_none = is_none and read_ns > 0 and packets == 60
    here = numbered(4 - early, 4, reads_ns=reads_ns, packets=packets)
    assert clock.follow(here).unseen == (-1 if is_none else 0)
    if is_none:
        assert clock.follow(numbered(4, 4, reads_ns=reads_ns)) == Passed(0, 0)
        assert clock.follow(numbered(7, 5, reads_ns=reads_ns)).unseen == 2


@every_kind
@pytest.mark.parametrize("times", [1.5, 3, 13, 1000])
def test_what_comes_faster_than_any_rotor_turns_is_delivered(name: str, times: float) -> None:
    """As where a file is written to a port. Its times tell nothing, and so nothing is early."""
    packets = packets_of(name)
    scans, _ = assembled_from(name, packets)
    found, stats = assembled_from(name, [(packet, at_ns / times) for packet, at_ns in packets])
    assert [len(scan) for scan in found] == [len(scan) for scan in scans]
    assert stats.missed_scans == stats.broken_scans == 0


def test_revolutions_that_begin_elsewhere_from_now_on_are_not_told_as_missing() -> None:
    """Seen with 0x81: a stream that begins at 281 degrees, and marks at 270."""
    clock = RevolutionClock()
    clock.follow(numbered(0, -1, over=281.25 / 360))
    clock.restart(270 / 360)
    assert clock.follow(numbered(0.96875, 0)).unseen == 0
    # A false mark at 90, and back: what was counted begins where it did.
    for number, seam in ((1.96875, 90 / 360), (3.96875, 270 / 360)):
        clock.follow(numbered(number, round(number - 1)))
        clock.restart(seam)
    assert clock.follow(numbered(4.96875, 4)).unseen == 0


@pytest.mark.parametrize(("seam", "unseen"), [(0.3, 4), (0.7, 5)])
def test_behind_a_seam_that_moved_rather_too_few_are_told(seam: float, unseen: int) -> None:
    """Revolutions begin three or seven tenths later from now on; the nearer of both beginnings is meant."""
    clock = RevolutionClock()
    for number in range(3):
        clock.follow(numbered(number, number))
    clock.restart(seam)
    clock.restart(seam)
    assert clock.follow(numbered(7 + seam, 3)).unseen == unseen
    # It moves again, by half a revolution.
    clock.restart(seam + 0.5)
    assert clock.follow(numbered(10 + seam + 0.5, 4 + unseen)).unseen == 2


def test_backward_too() -> None:
    clock = RevolutionClock()
    first = numbered(0.4, -1, over=0.4, revolution_ns=0.0, broken=True, packets=1)
    unknown = numbered(4, 0, revolution_ns=0.0, broken=True, packets=1)
    assert [clock.follow(each).unseen for each in (first, unknown)] == [0, 0]
    # Only the next one confirms a speed. Behind the first, which was not whole, 12 passed; three were counted.
    assert [clock.follow(numbered(n, n - 10)).unseen for n in (11, 12)] == [0, 9]


@pytest.mark.parametrize(("lost", "revolution_ns"), [(39, 100.0 * MS), (40, 100.0 * MS), (41, 0.0)])
def test_the_first_speed_is_known_where_half_of_the_packets_came(lost: int, revolution_ns: float) -> None:
    first = beginning(0, lost)
    RevolutionClock().follow(first)
    assert first.revolution_ns == revolution_ns


def test_what_is_over_of_a_revolution_counts() -> None:
    """Its beginning was lost: it begins later, but is the next one all the same."""
    found = told([beginning(0), beginning(1.8, over=0.8), beginning(2.02), beginning(3.02)])
    assert found == [(0, 0)] * 4


@pytest.mark.parametrize("share", ["1%", "2%", "5%"])
@driven
async def test_a_speed_is_never_nonsense(share: str) -> None:
    """Of most revolutions one packet comes, or none."""
    rig = make_rig("rplidar")
    async with rig.open() as lidar, timeout(30.0):
        faults, transmit, scans = parse_faults(f"drop:{share}", seed=4), rig.device.transmit, list[Scan]()
        async with lidar.scans(depth=1000) as stream:
            await anext(stream)
            rig.device.transmit = lambda now: faults.apply(transmit(now), now)
            with suppress(StreamFailed):
                async for scan in stream:
                    scans.append(scan)
                    if len(scans) == 30:
                        break
        stats = lidar.stats
    speeds = [scan.rpm for scan in scans if not math.isnan(scan.rpm)]
    # A single packet dates a revolution by when it happened to be read.
    assert all(560 < rpm < 640 for rpm in speeds), speeds
    assert stats.missed_scans >= stats.broken_scans
    if share == "5%":
        # 84 bytes arrive whole once in 74 times: 79 packets in 80 are missing, and told.
        assert stats.lost_packets / (stats.lost_packets + stats.packets) > 0.8


@every_kind
def test_a_revolution_of_which_little_came(name: str) -> None:
    """It is delivered, what is missing is told, and its speed is right or unknown."""
    packets, clean = packets_of(name), clean_scans(name)
    seam = next(n for n, (_, at_ns) in enumerate(packets) if at_ns > clean[4].stamp_ns)
    each = len(packets) / 2.5 / hertz(name)
    first, middle, end = (seam + round(place * each) for place in (0.04, 0.5, 0.96))
    few = 20 if each > 1000 else 1
    scans, stats = assembled_from(name, [*packets[:first], *packets[middle : middle + few], *packets[end:]])
    assert [scan.seq for scan in scans] == list(range(len(clean)))
    assert (stats.missed_scans, stats.broken_scans) == (0, 0)
    little = min(scans, key=len)
    assert len(little) < 0.2 * len(clean[little.seq])
    assert little.lost_packets == pytest.approx(end - first - few, abs=2)
    assert all(math.isnan(scan.rpm) or scan.rpm == pytest.approx(60 * hertz(name), rel=0.03) for scan in scans)
