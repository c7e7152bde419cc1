"""Records that stand between packets and are no measurement: each is known by its bytes, wherever it stands."""

import pytest

from lidario.families.camsense.formats import PacketFormat as CamsenseFormat
from lidario.families.camsense.simulated import pack_packet as camsense
from lidario.families.irobotix.formats import FrameFormat
from lidario.families.irobotix.simulated import pack_failure, pack_frame
from lidario.families.ldrobot.formats import PacketFormat as LdrobotFormat
from lidario.families.ldrobot.simulated import pack_response as ldrobot
from lidario.families.neato.formats import PacketFormat as NeatoFormat
from lidario.families.neato.simulated import pack_packet as neato
from lidario.families.ydlidar.formats import PointCloud
from lidario.families.ydlidar.simulated.packers import SCAN_HEADER, pack_response, pack_time_stamp
from lidario.wire.formats import NO_PACKET, StreamFormat
from lidario.wire.link import Link
from tests.reference.ldrobot import crc8
from tests.support.links import receive


def sealed(body: bytes) -> bytes:
    """With the CRC of an LDROBOT behind it."""
    return body + bytes((crc8(body),))


CHECKED: dict[str, tuple[StreamFormat, bytes]] = {
    "ldrobot response": (LdrobotFormat(), ldrobot(0xA2, b"\x70\x08\0\0")),
    "ldrobot longest response": (LdrobotFormat(), ldrobot(0xA8, b"\x54\x2c" * 25)),
    "ldrobot information": (LdrobotFormat(), sealed(b"\x54\x0f" + b"\x54\x2c" * 10)),
    "irobotix rotor": (FrameFormat(), pack_failure(5.25)),
    "irobotix other": (FrameFormat(), pack_frame(0xAB, b"\x01\x02")),
    "irobotix without a speed": (FrameFormat(), pack_frame(0xA9, bytes(30))),
    "ydlidar time stamp": (PointCloud(), pack_time_stamp(123_456, 7)),
    "ydlidar time stamp with marks": (PointCloud(), pack_time_stamp(0x55AA_55AA, 0xAA)),
    "camsense idle": (CamsenseFormat(), camsense(0xA000, 0xA000, [0.0] * 8, [0] * 8)),
    "neato slow": (NeatoFormat(), neato(7, [500.0] * 4, [90] * 4, rpm=60.0)),
}
"""Those with a check value, each with the format between whose packets it may stand."""
ALL = CHECKED | {
    "ydlidar scan header": (PointCloud(), SCAN_HEADER),
    "ydlidar information": (PointCloud(), pack_response(0x04, bytes(range(20)))),
}


@pytest.mark.parametrize("before", [b"", b"\x54\xaa\xfa"])
@pytest.mark.parametrize("name", ALL)
def test_one_that_has_begun_is_waited_for(name: str, before: bytes) -> None:
    wire, record = ALL[name]
    at = len(before)
    begun = [wire.other_record(bytearray(before + record[:size]), at) for size in range(1, len(record))]
    assert set(begun) == {0}
    for behind in (b"", b"\0", record):
        assert wire.other_record(bytearray(before + record + behind), at) == len(record)


@pytest.mark.parametrize("name", CHECKED)
def test_one_with_a_flipped_bit_is_none(name: str) -> None:
    wire, record = CHECKED[name]
    for bit in range(8 * len(record)):
        damaged = bytearray(record)
        damaged[bit // 8] ^= 1 << bit % 8
        assert wire.other_record(damaged, 0) != len(record)


def test_a_response_that_claims_to_be_longer_than_any_is_none() -> None:
    """Of an LDROBOT: 50 bytes are believed."""
    longer = ldrobot(0xA8, bytes(51))
    assert {LdrobotFormat().other_record(bytearray(longer[:size]), 0) for size in range(3, len(longer) + 1)} == {
        NO_PACKET
    }


@pytest.mark.parametrize("size", [None, 1])
@pytest.mark.parametrize("name", ["irobotix rotor", "irobotix other"])
def test_one_whose_check_value_is_strong_is_known_behind_noise(name: str, size: int | None) -> None:
    link = Link()
    link.enter_stream(FrameFormat())
    # A packet is longer: the last one waits for more.
    receive(link, b"noise" + 4 * ALL[name][1], 0, size)
    assert (link.stats.records, link.stats.skipped_bytes) == (3, 5)
