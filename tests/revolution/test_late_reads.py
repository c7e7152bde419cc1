"""A read that holds several revolutions: each of them ended as much earlier as was measured behind it."""

import pytest

from benchmarks.streams import KINDS
from lidario.families.rplidar.decode import DECODERS
from lidario.families.rplidar.formats import FORMATS
from lidario.families.rplidar.simulated.packers import pack_dense
from lidario.revolution.late_reads import ends_within
from lidario.revolution.pipeline import Pipeline
from lidario.scans.scan import Scan
from lidario.wire.blocks import packet_offsets
from tests.support.streams import arrived

A_TURN = 48
SAMPLE_NS = 31_250


def packed(numbers: list[int]) -> bytes:
    """The packets with these numbers of an even rotor, from the beginning of a turn on."""
    return pack_dense([480 * number % 23040 for number in numbers], [[4000] * 40] * len(numbers))


@pytest.mark.parametrize(
    "lost", [[70], [10, 11], [47, 100], [48, 95, 96], range(60, 80), [1, 2, 144, 145, *range(5, 44, 4)]]
)
def test_the_ends_of_revolutions_have_the_times_at_which_they_were_measured(lost: list[int]) -> None:
    """Also of those behind which packets are missing."""
    before, numbers = [*range(A_TURN)], sorted({*range(4 * A_TURN)} - {*lost})
    decoder, wire = DECODERS[0x85](), FORMATS[0x85]()
    decoder.decode(arrived(packed(before), A_TURN, 0), packed([0]))
    packets = arrived(packed(numbers), len(numbers), 10**9)
    ends = [sum(number < turn * A_TURN for number in numbers) for turn in (1, 2, 3)]
    found = ends_within(packets, 0, packet_offsets(packets.blocks), ends, [], 0, decoder, wire, SAMPLE_NS)
    # Nothing is missing behind: the packets that came tell it.
    if max(lost) < ends[0]:
        ends = []
    assert found == {end: 10**9 - (numbers[-1] - numbers[end - 1]) * 40 * SAMPLE_NS for end in ends}


@pytest.mark.parametrize("size", [30, 36, 40])
def test_reads_longer_than_a_revolution_tell_that_each_second_packet_is_lost(size: int) -> None:
    """When a revolution ended within a read is computed as if all packets came, so it tells nothing of that."""
    pipeline, scans, numbers = Pipeline(KINDS["0x85 dense"].stream()), list[Scan](), [*range(0, 40 * A_TURN, 2)]
    for begin in range(0, len(numbers), size):
        read = numbers[begin : begin + size]
        scans += pipeline.receive(packed(read), (read[-1] + 1) * 40 * SAMPLE_NS)
    assert len(scans) > 20
    assert {scan.lost_packets for scan in scans[1:]} == {A_TURN // 2}
