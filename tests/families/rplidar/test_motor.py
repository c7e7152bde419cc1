"""How the motor is turned: decided once for each model, by the requests that the model understands."""

import struct

import pytest

from lidario.errors import Unsupported
from lidario.families.rplidar.commands import Conf
from lidario.families.rplidar.device import RplidarDevice
from tests.support.rplidar_device import A1, C1, S1, S2, STANDARD, conf, identified
from tests.support.scripts import Answers, drive

A2, A3, S3 = 0x2C, 0x31, 0x82
BOARD = bytes.fromhex("a5ff04000000005e")
YES, NO = {BOARD: b"\x01\0\0\0"}, {BOARD: bytes(4)}
LIMITS = {**conf(Conf.MIN_ROTATION, b"\xe0\x01"), **conf(Conf.MAX_ROTATION, b"\xd0\x02")}


def sent_at_start(device: RplidarDevice, answers: Answers) -> list[str]:
    """The requests of a start, less the questions for configuration values."""
    _, sent = drive(device.start(STANDARD), answers)
    return [request.data.hex() or request.name for request in sent if request.data[1:2] != b"\x84"]


def halted(device: RplidarDevice) -> list[str]:
    return [request.data.hex() or request.name for request in device.halt()]


def test_a_duty_that_cannot_be_is_not_taken() -> None:
    absurd = conf(Conf.DESIRED_ROTATION, struct.pack("<HH", 600, 1024))
    assert sent_at_start(identified(A2), {**YES, **absurd})[1] == "a5f0029402c1"


@pytest.mark.parametrize("answers", [NO, {BOARD: b"\xfe\xff\xff\xff"}, {}])
def test_without_a_board_nothing_starts_the_motor(answers: Answers) -> None:
    device = identified(A2)
    assert sent_at_start(device, answers)[-1] == "a520"
    assert sent_at_start(device, {}) == ["a520"]
    # That there is one may have been lost.
    assert halted(device) == ["a5f002000057", "a525"]


@pytest.mark.parametrize(
    ("model", "request_"), [(A2, "a5f002000057"), *((model, "a5a80200000f") for model in (C1, S1, S2, S3, None))]
)
def test_motor_off_comes_before_stop(model: int | None, request_: str) -> None:
    """A program that was killed may have left it on; a device that does not know the request ignores it."""
    device = RplidarDevice() if model is None else identified(model)
    assert halted(device) == [request_, "a525"]
    assert (device.stop().data, device.reset().data) == (b"\xa5\x25", b"\xa5\x40")


@pytest.mark.parametrize(
    "answers",
    [
        {},
        conf(Conf.MIN_ROTATION, b"\xe0\x01"),
        {**conf(Conf.MIN_ROTATION, b""), **conf(Conf.MAX_ROTATION, b"\xd0\x02")},
    ],
)
def test_another_c1_is_asked_once_and_takes_none(answers: Answers) -> None:
    device = identified(C1)
    assert sent_at_start(device, answers) == ["a520"]
    # What it has told may have been lost.
    assert halted(device) == ["a5a80200000f", "a525"]
    _, sent = drive(device.start(STANDARD), answers)
    assert len(sent) == 1


@pytest.mark.parametrize(
    ("model", "answers", "why"),
    [(A1, {}, "on and off"), (A2, YES, "a duty"), (A2, {}, "no motor control"), (C1, {}, "were lost")],
)
def test_a_speed_that_cannot_be_set_is_refused_with_the_reason(model: int, answers: Answers, why: str) -> None:
    device = identified(model)
    for script in (device.set_scan_frequency(10.0), device.scan_frequency(), device.scan_frequency_range()):
        with pytest.raises(Unsupported, match=why):
            drive(script, answers)


def test_a_c1_is_asked_again_for_limits_that_were_lost_and_not_for_those_that_it_does_not_have() -> None:
    device = identified(C1)
    assert sent_at_start(device, {}) == ["a520"]
    assert drive(device.set_scan_frequency(10.0), LIMITS)[0] == 10.0
    none = {**conf(Conf.MIN_ROTATION, b""), **conf(Conf.MAX_ROTATION, b"")}
    device = identified(C1)
    assert sent_at_start(device, none) == ["a520"]
    with pytest.raises(Unsupported, match="no motor control"):
        drive(device.set_scan_frequency(10.0), LIMITS)


def test_a_board_whose_response_was_lost_is_asked_for_again_when_no_packet_comes() -> None:
    device = identified(A3)
    assert sent_at_start(device, {})[-1] == "a520"
    assert drive(device.explain_silence(0.0), {})[0] is False
    # Packets have come: their end has another cause.
    assert drive(device.explain_silence(2.0), YES) == (False, [])
    assert drive(device.explain_silence(0.0), YES)[0] is True
    assert sent_at_start(device, {}) == ["a5f0029402c1", "a520"]


TOLD = conf(Conf.DESIRED_ROTATION, struct.pack("<HH", 720, 512))


@pytest.mark.parametrize(
    ("model", "assumed", "told"),
    [(S2, "a5a802580255", "a5a802d002dd"), (A2, "a5f0029402c1", "a5f002000255")],
    ids=["rpm", "duty"],
)
def test_a_typical_speed_that_was_lost_is_asked_for_again_by_the_next_start(
    model: int, assumed: str, told: str
) -> None:
    device = identified(model)
    assert assumed in sent_at_start(device, YES)
    assert told in sent_at_start(device, {**YES, **TOLD})
    # Now it is known.
    _, sent = drive(device.start(STANDARD), {})
    assert [request.data.hex() for request in sent] == [told, "a520"]


def test_a_device_that_never_tells_its_typical_speed_is_soon_not_asked_any_more() -> None:
    device = identified(S2)
    asked = [
        [request for request in drive(device.start(STANDARD), {})[1] if request.data[1:2] == b"\x84"]
        for _ in range(6)
    ]
    assert [len(each) for each in asked] == [1, 1, 1, 1, 0, 0]
    # A stream that is interrupted does not wait for long.
    assert all(request.timeout * request.attempts < 0.2 for again in asked[1:] for request in again)


def test_a_device_that_has_no_typical_speed_is_asked_once() -> None:
    device = identified(S2)
    none = conf(Conf.DESIRED_ROTATION, b"")
    assert len(drive(device.start(STANDARD), none)[1]) == 3
    assert len(drive(device.start(STANDARD), none)[1]) == 2


def test_the_speed_that_was_assumed_is_told_while_it_turns_so_and_one_that_was_set_stays() -> None:
    device = identified(S2)
    drive(device.start(STANDARD), {})
    assert drive(device.scan_frequency(), TOLD) == (10.0, [])
    drive(device.set_scan_frequency(8.0), {})
    assert "a5a802e001ee" in sent_at_start(device, TOLD)


def test_another_model_at_the_same_port_is_decided_anew() -> None:
    device = identified(A1)
    drive(device.identify(), {b"\xa5\x50": bytes((S2, 2, 1, 18)) + bytes(16)})
    assert halted(device) == ["a5a80200000f", "a525"]
