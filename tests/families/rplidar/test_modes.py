"""The modes of an RPLIDAR: those it lists, and those it has where it lists none."""

import struct
from dataclasses import replace

import pytest

from lidario.basics.model import ScanMode
from lidario.families.rplidar.commands import Conf, get_lidar_conf
from lidario.wire.envelope import Request
from tests.support.rplidar_device import A1, C1, DENSE_BOOST, LISTED, STANDARD, conf, identified, mode_answers
from tests.support.scripts import Answers, drive, played


def test_values_have_the_numbers_of_the_sheet() -> None:
    """rplidar.md 3."""
    modes = {"MODE_COUNT": 0x70, "SAMPLE_DURATION": 0x71, "MAX_DISTANCE": 0x74, "RESPONSE_TYPE": 0x75}
    modes |= {"TYPICAL_MODE": 0x7C, "MODE_NAME": 0x7F}
    rotation = {"DESIRED_ROTATION": 0x01, "MIN_ROTATION": 0x04, "MAX_ROTATION": 0x05}
    addresses = {"MAC_ADDRESS": 0x79, "NETWORK_ADDRESS": 0x1CCC0}
    assert {kind.name: kind.value for kind in Conf} == rotation | modes | addresses


def test_modes_are_the_devices_own() -> None:
    modes, sent = drive(identified().modes(), LISTED)
    assert modes == (STANDARD, DENSE_BOOST)
    assert modes[1].samples_per_second == 32000
    assert sent[0].data == get_lidar_conf(Conf.MODE_COUNT).data
    # Each until two responses are alike.
    assert len(sent) == 2 * (2 + 2 * 4)


@pytest.mark.parametrize(
    ("raw", "name"),
    [
        (b"Dense\x1b[31mBoost\0rubbish", "Dense[31mBoost"),
        (b"\x07\x08Boost\r\n", "Boost"),
        (b"  Spaced  ", "Spaced"),
        (b"", "mode 0"),
        (b"\0\0", "mode 0"),
        (b"\x01\x02\x7f", "mode 0"),
        (None, "mode 0"),
        (b"B\xfcro", "B\N{REPLACEMENT CHARACTER}ro"),
        ("Höhe \N{CJK UNIFIED IDEOGRAPH-5BC6}\0".encode(), "Höhe \N{CJK UNIFIED IDEOGRAPH-5BC6}"),
    ],
)
def test_mode_names_are_safe_to_print(raw: bytes | None, name: str) -> None:
    answers = {**LISTED, **conf(Conf.MODE_COUNT, b"\x01\0"), **conf(Conf.MODE_NAME, raw, 0)}
    (mode,), _ = drive(identified().modes(), answers)
    assert mode.name == name
    assert mode.name.isprintable()


def test_values_that_are_missing_or_cut_short_are_nothing() -> None:
    answers = {
        **conf(Conf.MODE_COUNT, b"\x02\0"),
        **mode_answers(0, None, None, None, 0x81),
        **mode_answers(1, b"X", 8000, 7680, None),
        **conf(Conf.MAX_DISTANCE, b"\0\x1e", 1),
        **conf(Conf.TYPICAL_MODE, b"\x01"),
    }
    modes, _ = drive(identified().modes(), answers)
    # What the second sends is not told: it is none. So the first is the typical one.
    assert modes == (ScanMode(0, "mode 0", 0.0, 0.0, 0x81, typical=True),)


@pytest.mark.parametrize(
    ("missing", "note"),
    [
        ({}, ""),
        (conf(Conf.MODE_NAME, None, 1), "did not tell all of its scan modes"),
        (mode_answers(1, None, None, None, None), "did not tell all of its scan modes"),
        (conf(Conf.MODE_COUNT, None), "did not tell its scan modes; those of older firmware are assumed"),
    ],
)
def test_what_is_not_told_is_noted(missing: Answers, note: str) -> None:
    device = identified()
    drive(device.modes(), {**LISTED, **missing})
    assert device.modes_note.removeprefix("the device ") == note


@pytest.mark.parametrize(
    "kind", [Conf.SAMPLE_DURATION, Conf.MAX_DISTANCE, Conf.RESPONSE_TYPE, Conf.MODE_NAME, Conf.TYPICAL_MODE]
)
def test_what_was_lost_once_is_asked_again(kind: Conf) -> None:
    """The typical mode is not the last one, which is taken where none is told."""
    answers = {**LISTED, **conf(Conf.TYPICAL_MODE, b"\0\0")}
    number = None if kind is Conf.TYPICAL_MODE else 1
    lost, times = get_lidar_conf(kind, number).data, 0

    def lossy(request: Request) -> bytes | None:
        nonlocal times
        times += request.data == lost
        # Of a mode that it does not have it tells the question alone.
        return None if request.data == lost and times == 1 else answers.get(request.data, request.data[3:7])

    modes = played(identified().modes(), lossy)
    assert modes == (replace(STANDARD, typical=True), replace(DENSE_BOOST, typical=False))


def test_what_is_not_told_is_asked_twice() -> None:
    _, sent = drive(identified().modes(), {**LISTED, **conf(Conf.MODE_NAME, None, 1)})
    assert [request.data for request in sent].count(get_lidar_conf(Conf.MODE_NAME, 1).data) == 2


def test_a_typical_mode_nobody_can_read_is_not_typical() -> None:
    answers = {
        **LISTED,
        **conf(Conf.MODE_COUNT, b"\x03\0"),
        **conf(Conf.TYPICAL_MODE, b"\x02\0"),
        **mode_answers(2, b"Newest", 4000, 7680, 0x87),
    }
    modes, _ = drive(identified().modes(), answers)
    assert [mode.typical for mode in modes] == [False, True, False]
    assert modes[2].response_type == 0x87


def test_a_device_of_only_unknown_modes_has_no_typical_one() -> None:
    answers = {**LISTED, **conf(Conf.MODE_COUNT, b"\x01\0"), **conf(Conf.RESPONSE_TYPE, b"\x99", 0)}
    (mode,), _ = drive(identified().modes(), answers)
    assert not mode.typical


@pytest.mark.parametrize("count", [b"\0\0", b"", None])
def test_an_empty_list_falls_back_on_the_plain_scan(count: bytes | None) -> None:
    answers = {**conf(Conf.MODE_COUNT, count), b"\xa5\x59": struct.pack("<HH", 63, 31)}
    modes, _ = drive(identified().modes(), answers)
    assert modes == (ScanMode(0, "Standard", 63.0, 16.0, 0x81, typical=True),)
    # Even where it tells no sample rate either.
    modes, _ = drive(identified().modes(), conf(Conf.MODE_COUNT, count))
    assert modes == (ScanMode(0, "Standard", 0.0, 16.0, 0x81, typical=True),)


def test_parts_of_a_metre_and_of_a_microsecond_are_told() -> None:
    """The vendor's SDK cuts distances to whole metres (rplidar.md 3)."""
    answers = {**LISTED, **conf(Conf.MODE_COUNT, b"\x01\0"), **mode_answers(0, b"Near", 16_001, 3201, 0x81)}
    (mode,), _ = drive(identified().modes(), answers)
    assert (mode.sample_us, mode.max_distance) == (16_001 / 256, 3201 / 256)


def test_an_absurd_number_of_modes_ends() -> None:
    modes, sent = drive(identified().modes(), conf(Conf.MODE_COUNT, b"\xff\xff"))
    assert [mode.response_type for mode in modes] == [0x81]
    assert len(sent) < 100
    modes, _ = drive(identified().modes(), {**LISTED, **conf(Conf.MODE_COUNT, b"\xff\xff")})
    assert modes == (STANDARD, DENSE_BOOST)


def test_old_firmware_is_not_asked_for_what_it_lacks() -> None:
    modes, sent = drive(identified(A1, (1, 23)).modes(), {b"\xa5\x59": struct.pack("<HH", 500, 250)})
    assert [request.name for request in sent] == ["GET_SAMPLERATE"] * 2
    assert modes == (
        ScanMode(0, "Standard", 500.0, 16.0, 0x81),
        ScanMode(1, "Express", 250.0, 16.0, 0x82, typical=True),
    )
    oldest, sent = drive(identified(A1, (1, 16)).modes(), {})
    assert (sent, oldest) == ([], (ScanMode(0, "Standard", 476.0, 16.0, 0x81, typical=True),))
    _, sent = drive(identified(A1, (1, 24)).modes(), LISTED)
    assert sent[0].data == get_lidar_conf(Conf.MODE_COUNT).data
    _, sent = drive(identified(C1, (1, 0)).modes(), LISTED)
    assert sent[0].data == get_lidar_conf(Conf.MODE_COUNT).data


def test_a_device_silent_about_its_modes_is_not_asked_for_a_minute() -> None:
    count = conf(Conf.MODE_COUNT, b"\x10\0")
    for told in (
        {},
        {key: value for mode in range(16) for key, value in conf(Conf.RESPONSE_TYPE, b"\x81", mode).items()},
    ):
        answers = {**count, **told}
        modes, sent = drive(identified().modes(), answers)
        assert modes
        in_vain = [each for each in sent if answers.get(each.data) is None]
        assert sum(each.timeout * each.attempts for each in in_vain) <= 6.0
        assert sum("LIDAR_CONF" in each.name for each in in_vain) == 4


def test_a_device_that_never_tells_the_same_is_not_asked_for_ever() -> None:
    script, asked = identified().modes(), 0
    request = next(script)
    with pytest.raises(StopIteration):
        while asked < 10_000:
            asked += 1
            request = script.send(request.data[3:7] + bytes((asked & 0xFF, asked >> 8, 1, 1)))
    # Of each four or five questions that were asked five times: how many modes, and which one; and the sample rate.
    assert asked < 50
