"""Records that stand between packets and are no measurement: each is known by its bytes, wherever it stands."""

from itertools import product

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
from tests.support.case import Case
from tests.support.cases import CASES
from tests.support.families import ABOUT
from tests.support.links import receive
from tests.support.streams import feed


def sealed(body: bytes) -> bytes:
    """With the CRC of an LDROBOT behind it."""
    return body + bytes((crc8(body),))


CHECKED: dict[str, tuple[StreamFormat, bytes]] = {
    "ldrobot response": (LdrobotFormat(), ldrobot(0xA2, b"\x70\x08\0\0")),
    "ldrobot response without data": (LdrobotFormat(), ldrobot(0xA0)),
    "ldrobot longest response": (LdrobotFormat(), ldrobot(0xA8, b"\x54\x2c" * 25)),
    "ldrobot information": (LdrobotFormat(), sealed(b"\x54\x0f" + b"\x54\x2c" * 10)),
    "ldrobot blocked window": (LdrobotFormat(), sealed(b"\x54\xe0\x01")),
    "irobotix rotor": (FrameFormat(), pack_failure(5.25)),
    # 5.25 revolutions a second, as the protocol document has it; its version is 00.
    "irobotix rotor of the document": (FrameFormat(), bytes.fromhex("AA00090061AE000169022C")),
    "irobotix other": (FrameFormat(), pack_frame(0xAB, b"\x01\x02")),
    "irobotix without a speed": (FrameFormat(), pack_frame(0xA9, bytes(30))),
    "ydlidar time stamp": (PointCloud(), pack_time_stamp(123_456, 7)),
    "ydlidar time stamp with marks": (PointCloud(), pack_time_stamp(0x55AA_55AA, 0xAA)),
    **{
        f"camsense idle at {at:#x}": (CamsenseFormat(), camsense(at, at, [0.0] * 8, [0] * 8))
        for at in (0, 0xA000, 0xB000)
    },
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


def case_of(name: str) -> Case:
    """A stream of the format between whose packets it may stand."""
    kind, cases = type(ALL[name][0]), tuple[Case, ...](ABOUT[name.split()[0]].CASES)
    return next(case for case in cases if isinstance(case.make_format(), kind))


@pytest.mark.parametrize("name", ALL)
def test_between_packets_it_is_no_noise(name: str) -> None:
    case, (_, record) = case_of(name), ALL[name]
    packets = case.packets[:16]
    raw = b"".join([record, *packets[:5], record, record, *packets[5:9], record, *packets[9:]])
    whole = feed(case, raw)
    assert (whole.data, len(whole.events)) == (b"".join(packets), 1)
    assert (whole.stats.records, whole.stats.skipped_bytes) == (4, 0)
    for size in (1, 2, 3, 8, 64, 997):
        assert feed(case, raw, size) == whole, size


@pytest.mark.parametrize("name", CHECKED)
def test_a_damaged_one_between_packets_is_noise(name: str) -> None:
    case, (_, record) = case_of(name), ALL[name]
    packets = case.packets[:16]
    for at in (2, -1):
        damaged = bytearray(record)
        damaged[at] ^= 1
        found = feed(case, b"".join([*packets[:5], damaged, *packets[5:]]))
        assert found.data == b"".join(packets), at
        assert (found.stats.records, found.stats.skipped_bytes) == (0, len(record)), at


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


@pytest.mark.exhaustive("case", sample=CASES)
def test_of_the_beginning_all_is_said_that_is_said_of_the_whole_or_nothing_yet(case: Case) -> None:
    """Of packets and records, whichever byte is damaged."""
    wire, packets = case.make_format(), b"".join(case.packets[:8])
    not_ready = b"MD0044072501000\n0M^\n\n"  # of a Hokuyo
    for record in (b"", ALL["ldrobot response"][1], ALL["irobotix rotor"][1], not_ready):
        for at, changed in product(range(20), (0, 1, 0x80)):
            data = bytearray(record + packets)
            data[at] ^= changed
            for ask in (wire.measure, wire.other_record):
                whole = ask(data, 0)
                said = [ask(data[:length], 0) for length in range(1, 40)]
                assert set(said) <= {0, whole}
