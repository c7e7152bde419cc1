"""Blocks in bytes: found in pieces of any size, refused where one character is wrong, and bounded."""

import numpy as np
import pytest

from lidario.errors import RemoteProtocolError
from lidario.families.hokuyo.commands import ask, check_of, measure, read_lines
from lidario.families.hokuyo.formats import DistanceFormat, StrengthFormat
from lidario.families.hokuyo.geometry import Geometry, geometry_of
from lidario.wire.envelope import Request
from lidario.wire.events import Packets, Response
from lidario.wire.formats import BEGINS, NO_PACKET
from lidario.wire.link import Link
from lidario.wire.states import LinkState
from tests.families.hokuyo.about import CASES, GEOMETRY, LAYOUTS
from tests.reference import golden, hokuyo
from tests.support.contents import any_packets
from tests.support.scripts import played
from tests.support.streams import in_one_run, stream_of

RAW = golden.load("hokuyo_urg04lx_10hz").raw
BLOCKS = hokuyo.split(RAW)
TOLD = {name: text for name, _, text in (each.partition(":") for each in GEOMETRY.text.split(";"))}


def parsed(wire: DistanceFormat, raw: bytes, sizes: list[int]) -> tuple[list[bytes], int, int]:
    """The blocks that a link finds, and how many bytes it skips and takes for records."""
    link = Link()
    link.enter_stream(wire)
    found, at, turn = b"", 0, 0
    while at < len(raw):
        size = sizes[turn % len(sizes)]
        link.receive_data(raw[at : at + size], at)
        found += b"".join(event.data for event in link.events_received() if isinstance(event, Packets))
        at, turn = at + size, turn + 1
    return hokuyo.split(found) if found else [], link.stats.skipped_bytes, link.stats.record_bytes


def test_a_refused_stream_does_not_begin() -> None:
    link = Link()
    link.send_request(measure("ME", 44, 725, StrengthFormat(GEOMETRY)))
    link.receive_data(b"ME0044072501000\n0Ee\n\n", 1)
    assert link.events_received() == [Response(b"0Ee")]
    assert link.state is LinkState.IDLE


@pytest.mark.parametrize("place", [0, 5, 17, 18, 21, 25, 26, 100, 91, 92, 2100, 2134, 2135, 2136])
def test_a_wrong_character_costs_its_block_and_no_other(place: int) -> None:
    block = bytearray(BLOCKS[4])
    block[place] ^= 1
    for wire in (DistanceFormat(GEOMETRY), DistanceFormat()):
        found, skipped, _ = parsed(wire, b"".join([*BLOCKS[:4], bytes(block), *BLOCKS[5:]]), [97])
        assert found == BLOCKS[:4] + BLOCKS[5:]
        assert skipped == len(block)


@pytest.mark.parametrize(
    ("request_", "longest"), [(measure("MD", 44, 725, DistanceFormat(GEOMETRY)), 64), (next(ask("VV")), 4096)]
)
def test_no_more_is_waited_for_than_a_response_has(request_: Request, longest: int) -> None:
    """Up to the empty line that ends it; what is longer belongs to no response."""
    for over, answered in ((0, True), (1, False)):
        echo = request_.data.lstrip(b"\n")
        text = echo + b"x" * (longest + over - len(echo))
        for size in (7, len(text) + 2):
            link = Link()
            link.send_request(request_)
            for at in range(0, len(text) + 2, size):
                link.receive_data((text + b"\n\n")[at : at + size], 1)
            assert bool(link.events_received()) == answered
            assert link.state is (LinkState.IDLE if answered else LinkState.AWAIT_RESPONSE)


@pytest.mark.parametrize(
    ("before", "is_found"), [(b"", True), (b"end of a line\n", True), (b"no end of a line", False)]
)
def test_a_response_begins_with_a_line(before: bytes, is_found: bool) -> None:
    link, request = Link(), next(ask("VV"))
    link.send_request(request)
    link.receive_data(before + request.data.lstrip(b"\n") + b"00P\n\n", 1)
    assert bool(link.events_received()) == is_found
    assert link.stats.stray_bytes == len(before) if is_found else link.state is LinkState.AWAIT_RESPONSE
    # Of what is no response only as much is kept as the beginning of one may have.
    assert link.buffered <= len(request.data)


def test_a_block_without_data_is_a_record() -> None:
    unstable = b"MD0044072501000\n0M" + bytes((check_of(b"0M"),)) + b"\n\n"
    for size in (1, 50, 9999):
        found, skipped, records = parsed(DistanceFormat(GEOMETRY), BLOCKS[0] + unstable + BLOCKS[1], [size])
        assert (found, skipped, records) == (BLOCKS[:2], 0, len(unstable))
    promised = b"MD0044072501000\n99" + bytes((check_of(b"99"),)) + b"\n\n"
    assert DistanceFormat(GEOMETRY).other_record(bytearray(promised), 0) == NO_PACKET


def test_blocks_of_another_range_are_not_of_this_stream() -> None:
    other = any_packets(CASES[0], 1, 2, wild=False)[0].replace(b"MD0044", b"MD0045")
    assert DistanceFormat(GEOMETRY).measure(bytearray(other), 0) == NO_PACKET
    assert StrengthFormat(GEOMETRY).measure(bytearray(BLOCKS[0]), 0) == NO_PACKET


@pytest.mark.parametrize("case", [*CASES, *LAYOUTS], ids=lambda case: case.name)
def test_sizes_samples_headings_and_stamps(case: object) -> None:
    assert isinstance(case, type(CASES[0]))
    packets = any_packets(case, 7, 3, wild=False)
    for wire in (case.make_format(), type(case.make_format())()):
        assert wire.measure(bytearray(packets[0]), 0) == len(packets[0])
        run = in_one_run(wire, b"".join(packets))
        assert wire.samples_in(run.blocks) == 3 * GEOMETRY.steps
        assert wire.headings(run) == [BEGINS] * 3
        np.testing.assert_array_equal(wire.stamps(run), [hokuyo.milliseconds(each) for each in packets])


@pytest.mark.parametrize("kind", [DistanceFormat, StrengthFormat])
@pytest.mark.parametrize("geometry", [None, GEOMETRY])
def test_what_has_begun_is_waited_for(kind: type[DistanceFormat], geometry: Geometry | None) -> None:
    """With its echo and status a block tells its size, and what is none of them is known by two characters."""
    wire, echo = kind(geometry), kind.word + b"0044072501000\n"
    block, record = echo + b"99b\n" + b"0" * 30, echo + b"0M" + bytes((check_of(b"0M"),)) + b"\n\n"
    whole = wire.measure(bytearray(block), 0)
    assert whole > 2000
    for length in range(1, 40):
        begun = bytearray(b"??" + block[:length])
        assert wire.measure(begun, 2) == (0 if length < 20 else whole)
        assert wire.other_record(begun, 2) == (0 if length < 21 else NO_PACKET)
        assert wire.other_record(bytearray(b"??" + record[:length]), 2) == (0 if length < 21 else 21)
        other = bytearray(b"??" + b"MX" + block[2 : max(2, length)])
        assert wire.measure(other, 2) == wire.other_record(other, 2) == NO_PACKET


def test_no_claimed_size_is_beyond_the_longest() -> None:
    for kind in (DistanceFormat, StrengthFormat):
        wire = kind()
        begin = kind.word + b"0000999901000\n99b\n"
        assert wire.measure(bytearray(begin), 0) == wire.longest
        assert wire.measure(bytearray(begin.replace(b"00009999", b"12341234")), 0) == wire.shortest
        assert wire.measure(bytearray(begin.replace(b"00009999", b"99990000")), 0) == NO_PACKET


def test_a_line_that_could_not_carry_the_scans_tells_no_time() -> None:
    """2137 bytes in a tenth of a second, of ten bits each."""
    stream = stream_of(CASES[0])
    assert [stream.speed_on(baudrate) for baudrate in (115_200, 213_699, 213_700)] == [0, 0, 213_700]


def status(two: bytes) -> bytes:
    return two + bytes((check_of(two),))


WELL, DAMAGED, IN_TIME_MODE, IN_SCIP_1 = (
    status(b"00") + b"\nA:7" + bytes((check_of(b"A:7"),)),
    b"00x",
    status(b"0E"),
    b"E",
)


# The check character of the last line is wrong, and a line without a name stands before it.
WRONG = WELL + b"\nI\nSERI:H0614967;x"
UNREADABLE = "no response to VV could be read"


@pytest.mark.parametrize(
    ("responses", "asked", "told"),
    [
        ([WELL], "VV", {"A": "7"}),
        # It is asked again where that helps.
        ([DAMAGED, DAMAGED, WELL], "VV VV VV", {"A": "7"}),
        ([IN_TIME_MODE, status(b"00"), WELL], "VV TM2 VV", {"A": "7"}),
        ([IN_SCIP_1, b"0", WELL], "VV SCIP2.0 VV", {"A": "7"}),
        ([DAMAGED, IN_TIME_MODE, status(b"00"), WELL], "VV VV TM2 VV", {"A": "7"}),
        # What comes twice alike is not damaged: some URG-04LX have a wrong check character behind their serial
        # number (ros-drivers/urg_c #4).
        ([WRONG, WRONG], "VV VV", {"A": "7", "SERI": "H0614967"}),
        ([WRONG, WRONG[:-4] + b"8;x", WELL], "VV VV VV", {"A": "7"}),
        ([WRONG, DAMAGED, WRONG], "VV VV VV", UNREADABLE),
        # What is no refusal, but cannot be read, is asked for three times.
        ([DAMAGED] * 3, "VV VV VV", UNREADABLE),
        ([IN_TIME_MODE] * 6, "VV TM2 VV TM2 VV TM2", UNREADABLE),
        ([IN_SCIP_1] * 6, "VV SCIP2.0 VV SCIP2.0 VV SCIP2.0", UNREADABLE),
        ([status(b"0M")], "VV", "refuses VV with status '0M': its speed is not stable"),
        ([status(b"7Z")], "VV", "refuses VV with status '7Z': the manual"),
    ],
)
def test_what_a_response_tells_and_how_often_it_is_asked_for(
    responses: list[bytes], asked: str, told: dict[str, str] | str
) -> None:
    heard: list[str] = []

    def respond(request: Request) -> bytes:
        heard.append(request.name)
        return responses[len(heard) - 1]

    if isinstance(told, str):
        with pytest.raises(RemoteProtocolError, match=told):
            played(ask("VV"), respond)
    else:
        assert played(ask("VV"), respond) == told
    assert heard == asked.split()
    assert len(heard) == len(responses)


def test_what_text_holds_is_bounded_and_printable() -> None:
    line = b"SERI:\x1b[31m" + b"x" * 500
    told = read_lines(b"00P\n" + line + bytes((check_of(line),)))
    assert told is not None
    assert len(told.lines["SERI"]) <= 80
    assert told.lines["SERI"].isprintable()


@pytest.mark.parametrize(
    "change",
    [
        {"ARES": "0"}, {"ARES": "99999999"}, {"ARES": "-4"}, {"ARES": ""}, {"ARES": "\u0661\u0660"}, {"AMAX": "43"},
        {"AMIN": "0", "AMAX": "1024"}, {"DMAX": "20"}, {"SCAN": "0"}, {"SCAN": "999999"}, {"SCAN": "0000600"},
    ],
)  # fmt: skip
def test_a_field_that_cannot_be_is_refused(change: dict[str, str]) -> None:
    assert geometry_of(TOLD) == GEOMETRY
    assert geometry_of(TOLD | change) is None
    assert geometry_of({name: text for name, text in TOLD.items() if name not in change}) is None


@pytest.mark.parametrize(
    ("name", "least", "most", "others"),
    [
        ("AMIN", 0, 9999, {"AMAX": "9999", "ARES": "16384"}),
        ("AMAX", 0, 9999, {"AMIN": "0", "ARES": "16384"}),
        ("AFRT", 0, 9999, {}),
        ("ARES", 4, 16_384, {"AMIN": "44", "AMAX": "44"}),
        ("DMIN", 0, 262_142, {"DMAX": "262143"}),
        ("DMAX", 1, 262_143, {"DMIN": "0"}),
        ("SCAN", 60, 60_000, {}),
    ],
)
def test_what_a_device_tells_of_its_field_is_bounded(
    name: str, least: int, most: int, others: dict[str, str]
) -> None:
    """By the digits of a request, by the 18 bits of a distance, and by what a rotor can do."""
    for value, right in ((least - 1, False), (least, True), (most, True), (most + 1, False)):
        assert (geometry_of(TOLD | others | {name: str(value)}) is not None) == right, value
