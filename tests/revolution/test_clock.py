"""Revolutions that are missing: `seq` jumps by them, lost packets are told, the speed is right or unknown."""

import math
from collections.abc import Iterable, Iterator
from functools import cache
from itertools import accumulate, pairwise

import pytest

from benchmarks.streams import KINDS as STEADY
from benchmarks.streams import capture
from lidario.revolution.assemble import Assembler, AssemblerStats
from lidario.scans.scan import Scan
from lidario.wire.blocks import packet_offsets
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
    scans = [scan for data, at_ns in reads_of(packets) for scan in assembler.add(in_one_run(wire, data, at_ns))]
    return scans, assembler.stats


def reads_of(packets: Iterable[tuple[bytes, float]]) -> Iterator[tuple[bytes, int]]:
    """What is read at a time, and when: one packet, or 20 of the shortest."""
    several, last_ns = b"", 0.0
    for packet, at_ns in packets:
        if several and (len(several) >= 100 or at_ns - last_ns > 5e6):
            yield several, round(last_ns)
            several = b""
        several, last_ns = several + packet, at_ns
    yield several, round(last_ns)


@cache
def clean_scans(name: str) -> list[Scan]:
    """The scans of those packets, when nothing happens to them."""
    return assembled_from(name, packets_of(name))[0]


def hertz(name: str) -> float:
    """Revolutions a second."""
    return 7.0 if STEADY[name].family == "ydlidar" else 10.0


@pytest.mark.long
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
@pytest.mark.exhaustive("times", sample=[1.5], full=[1.5, 3, 13, 1000])
def test_what_comes_faster_than_any_rotor_turns_is_delivered(name: str, times: float) -> None:
    """As where a file is written to a port. Its times tell nothing, and so nothing is early."""
    packets = packets_of(name)
    scans, _ = assembled_from(name, packets)
    found, stats = assembled_from(name, [(packet, at_ns / times) for packet, at_ns in packets])
    assert [len(scan) for scan in found] == [len(scan) for scan in scans]
    assert stats.missed_scans == stats.broken_scans == 0


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
    # Nodes are told by the mean of 32 steps, which is off by as much as their ends are rounded.
    assert little.lost_packets == pytest.approx(end - first - few, rel=0.002, abs=2)
    assert all(math.isnan(scan.rpm) or scan.rpm == pytest.approx(60 * hertz(name), rel=0.03) for scan in scans)
