"""Requests and descriptors as bytes: the examples of the protocol sheets, and what is not accepted."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from lidario.families.rplidar import commands as rplidar
from lidario.families.rplidar.formats import FORMATS
from lidario.families.ydlidar import commands as ydlidar
from lidario.families.ydlidar.formats import PointCloud
from lidario.wire.envelope import Expected, Lines, Request, encode_request, find_lines, parse_descriptor, xor_bytes
from lidario.wire.events import Descriptor

DENSE = FORMATS[0x85]
SENT = {
    "A5 25": rplidar.STOP,
    "A5 40": rplidar.RESET,
    "A5 50": rplidar.GET_INFO,
    "A5 52": rplidar.GET_HEALTH,
    "A5 59": rplidar.GET_SAMPLERATE,
    "A5 20": rplidar.scan(FORMATS[0x81]()),
    "A5 21": rplidar.scan(FORMATS[0x81](), force=True),
    "A5 82 05 00 00 00 00 00 22": rplidar.express_scan(0, DENSE()),
    "A5 82 05 01 00 00 00 00 23": rplidar.express_scan(1, DENSE()),
    "A5 82 05 07 00 00 00 00 25": rplidar.express_scan(7, DENSE()),
    "A5 A8 02 58 02 55": rplidar.motor_speed(600),
    "A5 A8 02 00 00 0F": rplidar.motor_speed(0),
    "A5 84 04 70 00 00 00 55": rplidar.get_lidar_conf(rplidar.Conf.MODE_COUNT),
    "A5 84 06 7F 00 00 00 02 00 5A": rplidar.get_lidar_conf(rplidar.Conf.MODE_NAME, 2),
    "A5 60": ydlidar.scan(PointCloud()),
    "A5 65": ydlidar.STOP,
    "A5 00": ydlidar.FORCED_STOP,
    "A5 80": ydlidar.RESET,
    "A5 90": ydlidar.GET_INFO,
    "A5 91": ydlidar.GET_HEALTH,
    "A5 92": ydlidar.GET_HEALTH_92,
    "A5 93": ydlidar.GET_ZERO_OFFSET,
    "A5 09": ydlidar.STEPS[False, True],
    "A5 0A": ydlidar.STEPS[False, False],
    "A5 0B": ydlidar.STEPS[True, True],
    "A5 0C": ydlidar.STEPS[True, False],
    "A5 0D": ydlidar.GET_SPEED,
    "A5 D9": ydlidar.TOGGLE_PROTECTION,
}


def test_requests_are_the_sheets_bytes() -> None:
    assert {text: request.data.hex() for text, request in SENT.items()} == {
        text: bytes.fromhex(text).hex() for text in SENT
    }


def test_devices_are_left_alone_behind_requests_that_have_no_response() -> None:
    """10 ms, and an RPLIDAR that restarts half a second (rplidar.md 7)."""
    without = {text: request.settle for text, request in SENT.items() if request.expects is None}
    paused = ("A5 25", "A5 A8 02 58 02 55", "A5 A8 02 00 00 0F", "A5 65", "A5 00", "A5 80")
    assert without == dict.fromkeys(paused, 0.01) | {"A5 40": 0.5}


def test_responses_have_the_sheets_types_and_sizes() -> None:
    settings = ("A5 93", "A5 09", "A5 0A", "A5 0B", "A5 0C", "A5 0D")
    sizes = dict.fromkeys(settings, (4, 4)) | dict.fromkeys(("A5 52", "A5 91", "A5 92"), (6, 3))
    sizes |= {"A5 50": (4, 20), "A5 90": (4, 20), "A5 59": (0x15, 4), "A5 D9": (4, 1)}
    assert {text: SENT[text].expects for text in sizes} == {text: Expected(*each) for text, each in sizes.items()}


@given(st.integers(0, 255), st.binary(max_size=255))
def test_a_request_with_its_checksum_sums_to_nothing(command: int, payload: bytes) -> None:
    data = encode_request(command, payload)
    assert xor_bytes(data) == 0
    assert data[3:-1] == payload
    assert (data[0], data[1], data[2]) == (0xA5, command, len(payload))


ANNOUNCED = {
    "A5 5A 14 00 00 00 04": Descriptor(0x04, 20, continuous=False),
    "A5 5A 03 00 00 00 06": Descriptor(0x06, 3, continuous=False),
    "A5 5A 04 00 00 00 15": Descriptor(0x15, 4, continuous=False),
    "A5 5A 05 00 00 40 81": Descriptor(0x81, 5, continuous=True),
    "A5 5A 54 00 00 40 85": Descriptor(0x85, 84, continuous=True),
    "A5 5A 0D 03 00 40 83": Descriptor(0x83, 781, continuous=True),
    "A5 5A FF FF FF 3F 20": Descriptor(0x20, 0x3FFFFFFF, continuous=False),
    "A5 5A FF FF FF 7F 20": Descriptor(0x20, 0x3FFFFFFF, continuous=True),
}


@pytest.mark.parametrize("text", ANNOUNCED)
def test_descriptors_are_the_sheets_bytes(text: str) -> None:
    data = bytes.fromhex(text)
    assert parse_descriptor(data) == ANNOUNCED[text]
    assert parse_descriptor(bytearray(data + b"more")) == ANNOUNCED[text]
    for size in range(len(data)):
        assert parse_descriptor(data[:size]) is None


@pytest.mark.parametrize(
    "text",
    ["A5 5B 14 00 00 00 04", "5A A5 14 00 00 00 04", "A5 5A 05 00 00 80 81", "A5 5A 05 00 00 C0 81"],
    ids=["second byte", "turned round", "mode 2", "mode 3"],
)
def test_what_is_no_descriptor(text: str) -> None:
    assert parse_descriptor(bytes.fromhex(text)) is None


def question(expected: Expected) -> Request:
    return Request("QUESTION", b"?", expected)


@pytest.mark.parametrize(
    ("size", "largest", "claimed", "admitted"),
    [
        (20, 0, 20, True),
        (20, 0, 19, False),
        (20, 0, 21, False),
        (4, 68, 3, False),
        (4, 68, 4, True),
        (4, 68, 68, True),
        (4, 68, 69, False),
        (4, 68, 0x3FFFFFFF, False),
    ],
)
def test_a_size_is_admitted_between_its_bounds(size: int, largest: int, claimed: int, admitted: bool) -> None:
    assert question(Expected(4, size, largest)).admits(Descriptor(4, claimed, continuous=False)) is admitted


def test_type_and_mode_must_be_those_expected() -> None:
    assert not question(Expected(4, 20)).admits(Descriptor(6, 20, continuous=False))
    assert not question(Expected(4, 20)).admits(Descriptor(4, 20, continuous=True))
    assert not question(Expected(4, 0)).admits(Descriptor(4, 1, continuous=False))
    assert question(Expected(0x81, 5, continuous=True)).admits(Descriptor(0x81, 5, continuous=True))
    assert not question(Expected(0x81, 5, continuous=True)).admits(Descriptor(0x81, 5, continuous=False))


@pytest.mark.parametrize("stray", [b"", b"99b\n", b"VV\n" + b"#" * 60 + b"\n"])
def test_lines_are_waited_for_and_found_behind_anything(stray: bytes) -> None:
    """A response of SCIP 2: the echo of the request, lines of text, and an empty line."""
    expected = Expected(0, 0, largest=40, prefix=b"VV\n", lines=True)
    response = b"VV\n00P\nVEND:x;y\n\n"
    for end in range(3, len(response)):
        assert find_lines(bytearray(stray + response[:end]), expected) == Lines(len(stray))
    found = find_lines(bytearray(stray + response + b"VV"), expected)
    assert found == Lines(len(stray), len(response), b"00P\nVEND:x;y")


def test_lines_are_found_wherever_the_bytes_are_divided() -> None:
    """Of an echo within a line only its last bytes were kept, and taken for the beginning of a line."""
    expected = Expected(0, 0, largest=40, prefix=b"VV\n", lines=True)
    received = b"0a0VV\n0F]0FT\n\n" + b"VV\n00P\nVEND:x;1\n\n"
    for cut in range(len(received)):
        buffer, found = bytearray(), Lines(0)
        for piece in (received[:cut], received[cut:]):
            buffer += piece
            found = find_lines(buffer, expected)
            del buffer[: found.stray]
        assert found.payload == b"00P\nVEND:x;1", cut


def test_lines_without_an_end_are_not_waited_for() -> None:
    expected = Expected(0, 0, largest=40, prefix=b"VV\n", lines=True)
    assert find_lines(bytearray(b"VV\n" + b"#" * 37), expected) == Lines(0)
    assert find_lines(bytearray(b"VV\n" + b"#" * 38), expected) == Lines(38)


@pytest.mark.parametrize("kind", sorted(FORMATS))
def test_a_stream_is_announced_with_the_size_of_its_packets(kind: int) -> None:
    stream = FORMATS[kind]()
    request = rplidar.express_scan(3, stream)
    assert request.stream is stream
    assert request.expects == Expected(kind, stream.shortest, continuous=True)


def test_what_ends_a_stream_and_what_must_not_be_asked_twice() -> None:
    assert all(request.ends_stream for request in (rplidar.STOP, rplidar.RESET, ydlidar.STOP, ydlidar.RESET))
    for request in (ydlidar.TOGGLE_PROTECTION, *ydlidar.STEPS.values()):
        assert request.attempts == 1
    assert Request("X", b"").expects is None
