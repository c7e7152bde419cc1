"""Where packets begin, how long they are, and which are believed, format by format."""

import numpy as np
import pytest

from lidario.families.rplidar.formats import FORMATS, FULL_TURN_Q6, FULL_TURN_Q14, CapsuleFormat, HqFormat
from lidario.families.rplidar.simulated import packers
from lidario.wire.formats import RESTARTS
from tests.reference import rplidar
from tests.support.cases import CASES
from tests.support.streams import arrived, in_one_run

CAPSULES = (0x82, 0x84, 0x85, 0x86)
GOLDEN = {case.response_type: case for case in CASES if case.name.startswith("rplidar_32k")}
capsules = pytest.mark.parametrize("kind", CAPSULES)


def test_every_format_is_in_the_table_with_the_references_size() -> None:
    assert set(FORMATS) == set(rplidar.PACKET_BYTES)
    for kind, make in FORMATS.items():
        stream = make()
        assert stream.response_type == kind
        assert stream.shortest == stream.longest == rplidar.PACKET_BYTES[kind]
    assert len({make.name for make in FORMATS.values()}) == len(FORMATS)


@capsules
def test_any_nibbles_may_stand_beside_the_marks(kind: int) -> None:
    stream = FORMATS[kind]()
    found = {
        (first, second)
        for first in range(256)
        for second in range(256)
        if stream.measure(bytearray((first, second)), 0) == stream.shortest
    }
    assert found == {(0xA0 | low, 0x50 | high) for low in range(16) for high in range(16)}


@capsules
def test_headings_are_start_angles_and_say_where_the_stream_began_anew(kind: int) -> None:
    stream, packets = FORMATS[kind](), GOLDEN[kind].packets
    assert isinstance(stream, CapsuleFormat)
    headings = list(stream.headings(arrived(b"".join(packets), len(packets), 0)))
    assert stream.full_turn == FULL_TURN_Q6
    assert headings == [
        rplidar.start_q6(kind, packet) | (RESTARTS if rplidar.is_reset(kind, packet) else 0) for packet in packets
    ]
    assert headings[0] & RESTARTS
    assert not any(heading & RESTARTS for heading in headings[1:])


def test_a_start_angle_beyond_the_turn_is_brought_into_it() -> None:
    raw = packers.pack_dense([0, 23039, 23040, 23041, 0x7FFF], np.zeros((5, 40)))
    assert list(FORMATS[0x85]().headings(arrived(raw, 5, 0))) == [0, 23039, 0, 1, 0x7FFF - 23040]


def test_headings_of_hq_are_the_angles_of_the_first_nodes() -> None:
    case = GOLDEN[0x83]
    stream = HqFormat()
    assert stream.full_turn == FULL_TURN_Q14
    firsts = [case.samples[n].raw_deg for n in range(0, len(case.samples), 96)]
    np.testing.assert_allclose(
        np.array(stream.headings(in_one_run(stream, case.raw))) * 360 / FULL_TURN_Q14, firsts
    )


def test_the_crc_of_hq_covers_the_padding() -> None:
    import zlib

    packet = bytearray(GOLDEN[0x83].packets[0])
    packet[777:] = zlib.crc32(packet[:777]).to_bytes(4, "little")
    assert not HqFormat().intact(packet, 0, 781)
    packet[777:] = zlib.crc32(packet[:777] + b"\0\0\0").to_bytes(4, "little")
    assert HqFormat().intact(packet, 0, 781)
