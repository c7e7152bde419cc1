"""What stands between and in self-delimiting packets, seen from the scans: only what is hit is lost."""

import pytest

from tests.reference import ydlidar
from tests.support.cases import CASES, Case
from tests.support.contents import resealed
from tests.support.kept import Kept, kept
from tests.support.streams import assembled

POINT_CLOUDS = [case for case in CASES if case.layout is not None]
every_cloud = pytest.mark.exhaustive("case", sample=POINT_CLOUDS)


def replaced(case: Case, changed: dict[int, bytes]) -> bytes:
    """The golden stream with some of its packets changed."""
    return b"".join(changed.get(number, packet) for number, packet in enumerate(case.packets))


def all_but(case: Case, raw: bytes, *lost: int) -> Kept:
    return kept(case, raw, [number for number in range(len(case.packets)) if number not in lost], set())


@every_cloud
@pytest.mark.parametrize("samples", [0, 81, 255])
def test_an_absurd_number_of_samples_costs_the_packet(case: Case, samples: int) -> None:
    assert isinstance(case.layout, ydlidar.Kind)
    number = case.turns[1][0].packet + 5
    packet = case.packets[number]
    bad = resealed(case.layout, packet[:3] + bytes((samples,)) + packet[4:])
    result = all_but(case, replaced(case, {number: bad}), number)
    assert (result.wrong, result.missing, result.lost) == (0, 1, 1)


@every_cloud
def test_samples_that_look_like_packets_are_samples(case: Case) -> None:
    """Distances, and intensities, of which every two bytes are the packet's own mark."""
    assert isinstance(case.layout, ydlidar.Kind)
    changed = {}
    for number in range(0, len(case.packets), 2):
        packet = case.packets[number]
        marks = (b"\xaa\x55" * len(packet))[: len(packet) - 10]
        changed[number] = resealed(case.layout, packet[:10] + marks)
    turns = case.revolutions(case.decode([changed.get(*each) for each in enumerate(case.packets)]))
    scans, stats, link = assembled(case, replaced(case, changed))
    assert (len(scans), stats.lost_packets, link.skipped_bytes) == (len(case.turns), 0, 0)
    for scan, turn in zip(scans, turns, strict=True):
        assert scan.device_distances.tolist() == [sample.distance_mm for sample in turn]
        found = None if scan.intensities is None else scan.intensities.tolist()
        assert found == case.intensities(turn)
