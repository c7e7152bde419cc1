"""Packets lost whole, streams joined in the middle or begun anew: nothing is stretched or merged."""

import numpy as np
import pytest

from tests.reference import rplidar
from tests.support.cases import CASES, KINDS, Case, most_or_all
from tests.support.kept import kept_without, settled
from tests.support.samples import one_a_parser
from tests.support.streams import assembled

PACKET_CASES = [case for case in CASES if case.make_format().longest > 5]
RESTARTING = [case for case in CASES if case.lookahead and case.truth.start is not None]


def in_a_turn(case: Case, places: int) -> list[int]:
    """Packets spread over the second turn, those around its beginning and end among them."""
    first, last = case.turns[1][0].packet, case.turns[1][-1].packet
    edge = range(max(first - 3, settled(case, 0)), first + 2)
    return sorted({*edge, *range(first, last, max(1, (last - first) // places)), last - 1})


@pytest.mark.long
@one_a_parser(PACKET_CASES)
@pytest.mark.parametrize("count", [1, 3, 6])
def test_lost_packets_are_counted_and_no_point_moves(case: Case, count: int) -> None:
    begin, end = case.turns[1][0].packet, case.turns[1][-1].packet
    for first in in_a_turn(case, 4):
        result = kept_without(case, range(first, first + count))
        assert (result.missing, result.lost) == (count, count), f"from packet {first}"
        assert (result.broken, result.wrong) == (0, 0)
        assert result.moved.max() <= 2, f"from packet {first}"
        if begin < first and first + count < end:
            assert [scan.lost_packets for scan in result.scans] == [0, count] + [0] * (len(case.turns) - 2)


@most_or_all(CASES)
def test_losing_the_packets_at_zero_merges_no_turns(case: Case) -> None:
    """At every turn: the packet by which it begins and the one before it."""
    for width in (1, 2):
        lost = {turn[0].packet - n for turn in case.turns[1:] for n in range(width)}
        if len(case.packets[0]) == 5:
            lost |= {turn[0].packet + n for turn in case.turns[1:] for n in range(20)}
        result = kept_without(case, sorted(lost))
        assert result.broken == 0
        assert result.missing == len(lost)
        for scan, turn in zip(result.scans, case.turns, strict=True):
            assert len(turn) * 0.6 < len(scan) <= len(turn) + 1


@pytest.mark.long
@one_a_parser(KINDS)
def test_more_than_a_turn_lost_is_no_scan(case: Case) -> None:
    """From the middle of one turn to just behind the middle of the next: the angle alone cannot tell."""
    first = case.turns[1][len(case.turns[1]) // 2].packet
    behind = case.turns[2][len(case.turns[2]) // 2].packet + 1
    left = [n for n in range(len(case.packets)) if not first <= n <= behind]
    raw = b"".join(case.packets[n] for n in left)
    cut, pause = len(b"".join(case.packets[:first])), len(b"".join(case.packets[first : behind + 1]))

    def times(offset: int) -> int:
        return round((offset + (pause if offset > cut else 0)) * case.byte_ns)

    # Whole packets at a time, one or 20 of the shortest, so that none straddles the pause.
    several = 20 if len(case.packets[0]) == 5 else 1
    sizes = [
        sum(len(case.packets[n]) for n in part[at : at + several])
        for part in (left[:first], left[first:])
        for at in range(0, len(part), several)
    ]
    scans, stats, _ = assembled(case, raw, sizes, times)
    assert stats.broken_scans == 1
    assert stats.scans == len(scans) == len(case.turns) - 2
    for scan, turn in zip(scans, (case.turns[0], *case.turns[3:]), strict=True):
        assert len(scan) == len(turn)


@pytest.mark.long
@one_a_parser(CASES)
def test_joining_in_mid_stream_delivers_no_partial_turn(case: Case) -> None:
    first = len(b"".join(case.packets[: case.turns[0][0].packet + 1]))
    second = len(b"".join(case.packets[: case.turns[1][0].packet]))
    for place in range(first, second - 200, (second - first) // 12):
        scans, stats, _ = assembled(case, case.raw[place:])
        assert (len(scans), stats.broken_scans) == (len(case.turns) - 1, 0)
        for scan, turn in zip(scans, case.turns[1:], strict=True):
            np.testing.assert_array_equal(scan.device_distances, [s.distance_mm for s in turn])
            assert scan.lost_packets == 0
        assert scans[0].seq == 0


def with_mark(case: Case, number: int) -> bytes:
    """A golden packet with its S bit set."""
    packet = bytearray(case.packets[number])
    at = 9 if case.response_type == 0x86 else 3
    if not packet[at] & 0x80:  # a stream begins with one
        packet[at] |= 0x80
        packet[1] ^= 0x08  # the XOR of the body changes in its upper nibble
    return bytes(packet)


@most_or_all(RESTARTING)
@pytest.mark.exhaustive("chunks", sample=[64], full=[64, 4096, None])
@pytest.mark.exhaustive("place", sample=[0.0, 0.02, 0.5, 0.97, None])
def test_an_s_bit_in_every_revolution_costs_nothing(case: Case, chunks: int | None, place: float | None) -> None:
    """The manual's reading, at the seam and elsewhere; and even in every packet."""
    each = case.turns[1][0].packet - case.turns[0][0].packet
    first = case.turns[0][0].packet + round((place or 0) * each)
    marked = set(range(first, len(case.packets), each)) if place is not None else set(range(len(case.packets)))
    raw = b"".join(with_mark(case, n) if n in marked else packet for n, packet in enumerate(case.packets))
    scans, stats, link = assembled(case, raw, chunks)
    assert (stats.broken_scans, stats.lost_packets, stats.missed_scans, link.skipped_bytes) == (0, 0, 0, 0)
    # In the first few packets nothing tells whether the stream goes on.
    turns = case.turns if first > 3 or len(scans) == len(case.turns) else case.turns[1:]
    assert len(scans) == len(turns)
    for scan, turn in zip(scans, turns, strict=True):
        np.testing.assert_array_equal(scan.device_distances, [s.distance_mm for s in turn])


@pytest.mark.exhaustive("case", sample=RESTARTING)
@pytest.mark.parametrize("lost", [1, 3])
def test_packets_lost_before_an_s_bit_are_lost_and_no_more(case: Case, lost: int) -> None:
    number = (case.turns[1][0].packet + case.turns[1][-1].packet) // 2
    # A step of more than 90 degrees, from the packet before the gap to the one behind it, could be any restart.
    lost = min(lost, (case.turns[1][-1].packet - case.turns[1][0].packet) // 4 - 1)
    raw = b"".join([*case.packets[: number - lost], with_mark(case, number), *case.packets[number + 1 :]])
    scans, stats, _ = assembled(case, raw)
    assert (len(scans), stats.broken_scans, stats.lost_packets) == (len(case.turns), 0, lost)


@pytest.mark.exhaustive("case", sample=RESTARTING)
@pytest.mark.parametrize("ahead", [0.4, 0.55])
def test_a_stream_that_begins_anew_elsewhere_gives_up_the_turn(case: Case, ahead: float) -> None:
    """The SDK's reading: what was measured before the S bit does not belong to what comes."""
    each = case.turns[2][0].packet - case.turns[1][0].packet
    first = case.turns[1][0].packet + round(0.2 * each)
    again = first + round(ahead * each)
    starts = [rplidar.start_q6(case.response_type, case.packets[n]) for n in (first - 1, first, again)]
    step = (starts[1] - starts[0]) % 23040
    passed = (starts[2] - starts[0]) % 23040 / step
    while passed < min(8.6, 0.26 * 23040 / step):
        again += 1
        passed = (rplidar.start_q6(case.response_type, case.packets[again]) - starts[0]) % 23040 / step
    raw = b"".join([*case.packets[:first], with_mark(case, again), *case.packets[again + 1 :]])
    scans, stats, _ = assembled(case, raw)
    assert stats.broken_scans == 1
    assert [len(scan) for scan in scans] == [len(turn) for turn in (case.turns[0], *case.turns[2:])]
