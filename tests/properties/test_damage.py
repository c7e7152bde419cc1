"""What damage costs: the packets it hits, and nothing else; and what only looks like damage costs nothing.

All figures are of the golden streams, between the beginning of their first whole turn and the end of the last.
The share kept is the number of points in the delivered scans, divided by that in the clean turns.
"""

from random import Random

import numpy as np
import pytest

from tests.reference import ydlidar
from tests.support.cases import CASES, Case
from tests.support.contents import resealed
from tests.support.kept import Kept, accepted_by_place, arrivals, kept, settled, spoil_inside
from tests.support.samples import one_a_parser
from tests.support.streams import assembled

PACKET_CASES = [case for case in CASES if case.make_format().longest > 5]
"""All but the plain node, which has no check value: see test_nodes."""
every_cloud = pytest.mark.exhaustive("case", sample=[case for case in CASES if case.layout is not None])
SEEDS = range(12)
"""No seed of these damages a start angle so that the check value does not see it."""


def damaged(case: Case, probability: float, seed: int) -> Kept:
    raw = spoil_inside(case, probability, seed)
    accepted, faulty = accepted_by_place(case, raw)
    return kept(case, raw, accepted, faulty)


@pytest.mark.long
@one_a_parser(PACKET_CASES)
def test_one_byte_in_a_thousand(case: Case) -> None:
    # Of 781-byte packets so few survive that whole turns go: they get a tenth.
    probability = 0.0001 if case.response_type == 0x83 else 0.001
    results = [damaged(case, probability, seed) for seed in SEEDS]
    share = float(np.mean([result.share for result in results]))
    sizes = np.array([len(case.packets[sample.packet]) for sample in case.samples])
    survival = float(np.mean((1 - probability) ** sizes))
    assert share >= survival - 0.01
    if len(case.packets[0]) == 84:
        assert share >= 0.91  # the vendor's SDK: 0.83 to 0.85
    for seed, result in zip(SEEDS, results, strict=True):
        # Every point is the clean one; every packet that did not make it is counted, and no turn given up.
        assert result.moved.max() <= 3, f"seed {seed}"  # 0.05 degrees, before a gap
        assert result.wrong == 0, f"seed {seed}"
        assert result.broken == 0
        if case.truth.family != "ydlidar":
            assert result.lost == result.missing, f"seed {seed}"
        else:
            # A start packet of one sample leaves no gap, and a lost one is only told by its place.
            assert abs(result.lost - result.missing) <= 1
    assert sum(result.faulty for result in results) <= len(SEEDS)


def assert_costs_itself(case: Case, number: int, instead: bytes) -> None:
    """Where this stands instead of that packet of the second turn, that one is missing, and nothing else is."""
    raw = b"".join([*case.packets[:number], instead, *case.packets[number + 1 :]])
    result = kept(case, raw, [n for n in range(len(case.packets)) if n != number], set())
    assert (result.wrong, result.missing, result.lost, result.broken) == (0, 1, 1, 0)
    assert result.moved.max() <= 2
    assert [scan.lost_packets for scan in result.scans] == [0, 1] + [0] * (len(case.turns) - 2)


@one_a_parser([case for case in PACKET_CASES if case.response_type != 0x83])  # it is repaired
@pytest.mark.exhaustive("bit", sample=[3, 61, 333, -70, -1])
def test_a_flipped_bit_costs_its_packet_and_nothing_else(case: Case, bit: int) -> None:
    for number in (case.turns[1][0].packet + 3, case.turns[1][-1].packet - 2):
        packet = bytearray(case.packets[number])
        packet[bit // 8 % len(packet)] ^= 1 << bit % 8
        assert_costs_itself(case, number, bytes(packet))


@one_a_parser(PACKET_CASES)
def test_noise_in_place_of_each_second_packet_costs_no_more_than_their_loss(case: Case) -> None:
    random, packets = Random(case.name), list(case.packets)
    # Seven whole packets make the angles certain. From then on half of the packets come, and half of the points.
    gone = range(settled(case, 7) + 1, case.turns[-1][-1].packet - 1, 2)
    for number in gone:
        packets[number] = random.randbytes(len(packets[number]))
    left = [number for number in range(len(packets)) if number not in gone]
    noisy = assembled(case, b"".join(packets))
    silent = assembled(case, b"".join(packets[number] for number in left), times=arrivals(case, left))
    assert [*map(len, noisy.scans)] == [*map(len, silent.scans)]
    assert sum(map(len, noisy.scans)) >= 0.45 * sum(map(len, case.turns))


@one_a_parser([case for case in PACKET_CASES if case.response_type != 0x83])  # it is repaired
def test_a_lone_packet_behind_a_row_of_damaged_ones_is_believed(case: Case) -> None:
    """Each of them shows where the next one is due; the header of the one behind it is lost."""
    first, lone = settled(case, 2), settled(case, 17)
    hit = [*range(first, lone), lone + 1]
    packets = list(case.packets)
    for number in hit:
        damaged_packet = bytearray(packets[number])
        damaged_packet[0 if number > lone else -1] ^= 0xFF
        packets[number] = bytes(damaged_packet)
    accepted, _ = accepted_by_place(case, b"".join(packets))
    assert accepted == [number for number in range(len(packets)) if number not in hit]


@pytest.mark.long
@one_a_parser(PACKET_CASES)
def test_a_truncated_packet_costs_itself(case: Case) -> None:
    number = case.turns[1][0].packet + 4
    packet = case.packets[number]
    for length in sorted({1, 2, 3, 9, 11, len(packet) // 2, len(packet) - 2, len(packet) - 1}):
        assert_costs_itself(case, number, packet[:length])


@every_cloud
@pytest.mark.parametrize("samples", [0, 81, 255])
def test_an_absurd_number_of_samples_costs_the_packet(case: Case, samples: int) -> None:
    assert isinstance(case.layout, ydlidar.Kind)
    number = case.turns[1][0].packet + 5
    packet = case.packets[number]
    assert_costs_itself(case, number, resealed(case.layout, packet[:3] + bytes((samples,)) + packet[4:]))


@every_cloud
def test_samples_that_look_like_packets_are_samples(case: Case) -> None:
    """Distances, and intensities, of which every two bytes are the packet's own mark."""
    assert isinstance(case.layout, ydlidar.Kind)
    packets = list(case.packets)
    for number, packet in enumerate(packets[::2]):
        marks = (b"\xaa\x55" * len(packet))[: len(packet) - 10]
        packets[2 * number] = resealed(case.layout, packet[:10] + marks)
    turns = case.revolutions(case.decode(packets))
    scans, stats, link = assembled(case, b"".join(packets))
    assert (len(scans), stats.lost_packets, link.skipped_bytes) == (len(case.turns), 0, 0)
    for scan, turn in zip(scans, turns, strict=True):
        assert scan.device_distances.tolist() == [sample.distance_mm for sample in turn]
        found = None if scan.intensities is None else scan.intensities.tolist()
        assert found == case.intensities(turn)


@one_a_parser(PACKET_CASES)
def test_bytes_put_between_two_packets_cost_nothing(case: Case) -> None:
    number = case.turns[1][0].packet + 4
    for extra in (b"\0", b"\xaa", b"\xa5", b"\xa5\x5a", b"\xaa\x55", b"\xaf\x5f\0", bytes(range(200))):
        raw = b"".join([*case.packets[:number], extra, *case.packets[number:]])
        result = kept(case, raw, range(len(case.packets)), set())
        assert (result.share, result.wrong, result.missing) == (1.0, 0, 0)
        assert (result.lost, result.broken) == (0, 0)
