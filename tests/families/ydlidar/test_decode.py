"""What the packets of a 4ROS tell of the revolution: what is missing, and what only looks so."""

from itertools import pairwise

import pytest

from lidario.families.base import Samples
from lidario.families.ydlidar.decode import CloudDecoder
from lidario.families.ydlidar.formats import PointCloud
from lidario.families.ydlidar.simulated.packers import pack_points
from lidario.wire.events import Packets
from tests.reference import golden, ydlidar
from tests.support.streams import in_one_run
from tests.support.turns_4ros import damaged, turn_of


def turns_of(name: str) -> list[list[bytes]]:
    """The packets of each whole turn, and of the open one at the end."""
    packets = ydlidar.split(golden.load(name).raw)
    begins = [n for n, packet in enumerate(packets) if ydlidar.is_start(packet)] + [len(packets)]
    return [packets[begin:end] for begin, end in pairwise(begins)]


def run_of(packets: list[bytes]) -> Packets:
    return in_one_run(PointCloud(), b"".join(packets))


def decoded(packets: list[bytes], following: bytes | None = None) -> Samples:
    return CloudDecoder().decode(run_of(packets), following)


def lost_behind(turns: list[list[bytes]], missing: range) -> tuple[int, int]:
    """Lost packets and unbroken ones, of a turn and a bit, with those of the second turn's start `missing`."""
    decoder = CloudDecoder()
    decoder.decode(run_of(turns[0]), turns[1][0])
    stream = turns[1] + turns[2]
    left = [packet for number, packet in enumerate(stream) if number not in missing]
    # As the assembler does: up to the first start packet behind the gap, or well behind it.
    end = next(
        (n for n, packet in enumerate(left) if n > missing.start and ydlidar.is_start(packet)), len(left) - 1
    )
    samples = decoder.decode(run_of(left[:end]), left[end])
    return samples.lost, samples.unbroken


@pytest.mark.parametrize(
    ("name", "count"),
    [
        *((name, 1) for name in golden.names_of("ydlidar_4ros")),
        *(("ydlidar_4ros_room10", count) for count in (2, 3, 5, 20)),
    ],
)
def test_lost_packets_are_counted_wherever_they_were(name: str, count: int) -> None:
    turns = turns_of(name)[:3]
    for gone in range(1, len(turns[1]) + (10 if count == 1 else 4)):
        assert lost_behind(turns, range(gone, gone + count)) == (count, gone), f"packets from {gone}"


def test_the_last_angle_of_a_packet_of_one_sample_tells_nothing() -> None:
    """A real Tmini Plus stated 0.27 and 0.16 degrees, behind the last ordinary packet of a revolution."""
    turn = [pack_points([900] * 40, at, at + 39 * 26) for at in range(11_617, 23_000, 40 * 26)]
    samples = decoded([*turn, pack_points([900], 17, 10)], pack_points([900], 43, 43, control=1))
    assert (samples.lost, samples.angle_deg[-1]) == (0, 17 / 64)
    assert samples.last.samples == pytest.approx(23_040 / 26, rel=0.02)


@pytest.mark.parametrize("last", [5, 16, 39])
@pytest.mark.parametrize("count", range(1, 5))
def test_the_last_packets_of_a_revolution_are_counted_where_the_next_one_is_read_with_it(
    count: int, last: int
) -> None:
    """The very last one is short: what is missing is no whole number of ordinary packets."""
    turn = turn_of([1, *[40] * 11, last])
    left = turn[:-count]
    for packets, behind in ((left, turn[:2]), (left + turn[:1], turn[1:2]), (left + turn[:5], turn[5:6])):
        assert decoded(packets, behind[0]).lost == count


@pytest.mark.parametrize("kept", [[0, -1], [0, 30, -1], [30, -1]], ids=str)
def test_where_mostly_short_packets_came_no_more_are_told_than_are_missing(kept: list[int]) -> None:
    """Damage spares short packets. What an ordinary one holds is known from the revolution before."""
    turns, decoder = turns_of("ydlidar_4ros_room7"), CloudDecoder()
    turn = turns[1]
    assert [packet[3] for packet in turn[-2:]] == [40, 16]
    decoder.decode(run_of(turns[0]), turn[0])
    samples = decoder.decode(run_of([turn[number] for number in kept]), turns[2][0])
    assert samples.lost == len(turn) - kept[0] - len(kept)
    assert samples.last.packets == pytest.approx(len(turn), abs=1)


@pytest.mark.parametrize(("count", "ordinary"), [(5, 40), (6, 20)])
def test_of_six_packets_the_longest_one_is_an_ordinary_one(count: int, ordinary: int) -> None:
    """Of fewer all may be short: those before tell."""
    longer, shorter = (turn_of([1, *[size] * (480 // size - 1), size - 1]) for size in (40, 20))
    decoder = CloudDecoder()
    decoder.decode(run_of(longer), shorter[0])
    samples = decoder.decode(run_of(shorter[:count]), shorter[count])
    assert samples.last.packets == 1 + 480 // ordinary


def test_revolutions_of_few_packets_have_as_many_together_as_one_by_one() -> None:
    """All of the second one may be short: the one before tells how long they may be."""
    long, short = turn_of([1, 160, 160, 159]), turn_of([1, 120, 120, 120, 119])
    decoder = CloudDecoder()
    alone = [decoder.decode(run_of(turn), other[0]) for turn, other in ((long, short), (short, long))]
    assert [each.last.packets for each in alone] == [4, 4]
    together = CloudDecoder().decode_several(run_of(long + short), long[0], [4, 9], 0, None)
    assert together is None or [each.packets for each in together.revolutions] == [4, 4]


def test_what_the_angles_cannot_tell_is_not_counted() -> None:
    turn = turns_of("ydlidar_4ros_room10")[0]
    assert decoded(turn[:1]).lost == 0
    assert decoded(turn[:1], turn[20]).lost == 0  # a lone sample has no step
    assert decoded(turn[:5]).lost == 0  # what follows is not known
    assert decoded(turn[:5], turn[6]).lost == 1


@pytest.mark.parametrize("is_followed", [False, True])
def test_a_packet_in_which_the_rotor_was_faster_is_not_damaged(is_followed: bool) -> None:
    """Where it ends, the next one begins."""
    steps = [48] * 6 + [75] + [48] * 3
    begins = [40 * sum(steps[:number]) for number in range(len(steps))]
    packets = [
        pack_points([1000] * 40, begin, begin + 39 * step) for begin, step in zip(begins, steps, strict=True)
    ]
    samples = decoded(packets[:-1], packets[-1] if is_followed else None)
    assert (samples.lost, list(samples.gaps)) == (0, [])
    assert samples.angle_deg[6 * 40 + 39] == (begins[6] + 39 * 75) / 64


LONG = [43] * 11
"""Samples of the packets beside the start packet and one of 6; 480 in all."""


@pytest.mark.parametrize("ratio", [1.0, 1.25, 0.8])
@pytest.mark.parametrize("counts", [[1, 6, *LONG], [1, *LONG, 6]], ids=["begin", "end"])
def test_a_short_packet_that_is_damaged_costs_nothing_else(counts: list[int], ratio: float) -> None:
    """Neither the speed nor what comes behind it is told wrongly, whichever of its two angles is damaged."""
    for off_q6 in ((0, 1000), (0, 2000), (0, 5000), (0, 12000), (-2000, 0), (9000, 0)):
        turn = turn_of(counts, ratio)
        assert decoded(turn, turn[0]).lost == 0
        at = counts.index(6)
        turn[at] = damaged(turn[at], off_q6)
        samples = decoded(turn, turn[0])
        assert (samples.lost, list(samples.gaps)) == (0, []), off_q6
        assert samples.last.samples == pytest.approx(480, rel=0.01)
        assert samples.last.packets == 13


@pytest.mark.parametrize("gone", [[], [3], [8, 9]], ids=str)
def test_a_long_packet_that_is_damaged_does_not_look_like_lost_ones(gone: list[int]) -> None:
    """Those that are missing elsewhere are told all the same."""
    for off_q6 in ((0, 700), (0, 1500), (0, 2500), (0, -700), (700, 0), (-700, 0), (-2500, 0), (9000, 0)):
        turn = turn_of([1, *LONG, 6])
        turn[6] = damaged(turn[6], off_q6)
        samples = decoded([packet for at, packet in enumerate(turn) if at not in gone], turn[0])
        skipped = [count for _, count in samples.gaps]
        assert (samples.lost, skipped) == (len(gone), [43 * len(gone)] * bool(gone)), off_q6
        assert samples.last.samples == pytest.approx(480, rel=0.01)


@pytest.mark.parametrize("gone", [[], [20], [30, 31]], ids=str)
def test_packets_that_tremble_by_several_steps_have_lost_nothing(gone: list[int]) -> None:
    """In the midst of a revolution a packet is an ordinary one: a jump that would hold a part of one is none."""
    begins = [40 * 8 * at + at % 2 * 50 for at in range(60) if at not in gone]
    samples = decoded([pack_points([1000] * 40, first, first + 39 * 8) for first in begins])
    assert samples.lost == len(gone)
    assert len(samples.gaps) == bool(gone)


def test_most_packets_may_reach_over_no_angle() -> None:
    """The long ones tell the step, also where there is only one."""
    short = [pack_points([1000] * 2, 15000, 15000)] * 3
    long = [pack_points([1000] * 80, first, first + 3950) for first in (0, 8000)]
    samples = decoded([*long, *short], long[0])
    assert samples.last.samples == pytest.approx(23040 / 50, rel=0.02)
    assert samples.gaps[0] == (80, 80)
    assert decoded([long[1], *short], long[1]).gaps[0] == (80, 3050 // 50 - 1)
