"""Settings of the 4ROS: by hand, and against the simulated device, in driven time."""

import struct
from contextlib import AbstractContextManager, nullcontext
from dataclasses import replace

import pytest

from lidario.errors import InvalidValue, RemoteProtocolError, ResponseTimeout, Unsupported
from lidario.families.ydlidar.device import YdlidarDevice
from lidario.families.ydlidar.models import MODELS
from lidario.families.ydlidar.simulated.device import PROFILES, Simulated4Ros
from lidario.wire.envelope import Request
from tests.support.scripts import drive, played
from tests.support.simulated_4ros import Bench


@pytest.mark.parametrize("hertz", [5.0, 5.1, 6.96, 7.0, 7.9, 8.04, 9.5, 10.0, 11.95, 12.0])
def test_set_scan_frequency(bench: Bench, hertz: float) -> None:
    bench.run(bench.device.set_scan_frequency(10.3))
    before = len(bench.simulated.log)
    got = bench.run(bench.device.set_scan_frequency(hertz))
    assert got == pytest.approx(hertz, abs=0.0501)
    assert got == bench.simulated.set_speed / 100
    assert bench.run(bench.device.scan_frequency()) == got
    assert len(bench.simulated.log) - before < 16


@pytest.mark.parametrize("hertz", [4.9, 12.1, 0.0, -7.0, 1e308])
def test_a_frequency_out_of_range_is_refused_before_anything_is_sent(hertz: float) -> None:
    device = YdlidarDevice()
    script = device.scan_frequency_range()
    with pytest.raises(StopIteration) as done:
        next(script)
    assert done.value.value == (5.0, 12.0)
    with pytest.raises(InvalidValue, match="5 to 12 Hz"):
        next(device.set_scan_frequency(hertz))


def test_a_model_without_a_setting_refuses_it_and_is_asked_nothing() -> None:
    device = YdlidarDevice(MODELS["x4"])
    for script in (
        device.scan_frequency(),
        device.set_scan_frequency(7.0),
        device.zero_offset(),
        device.power_down_protection(True),
    ):
        with pytest.raises(Unsupported):
            next(script)


def test_a_device_that_does_not_step_ends_the_setting() -> None:
    asked: list[int] = []

    def stubborn(request: Request) -> bytes:
        asked.append(request.data[1])
        return struct.pack("<I", 800)

    assert played(YdlidarDevice().set_scan_frequency(10.0), stubborn) == 8.0
    assert asked == [0x0D, 0x0D, 0x0B, 0x0D, 0x0D]


def test_a_device_that_overshoots_is_not_asked_for_ever() -> None:
    speed, asked = 700, 0

    def wild(request: Request) -> bytes:
        nonlocal speed, asked
        asked += 1
        speed += {0x0B: 100, 0x0C: -100, 0x09: 30, 0x0A: -30, 0x0D: 0}[request.data[1]]
        return struct.pack("<I", speed)

    played(YdlidarDevice().set_scan_frequency(8.5), wild)
    assert asked < 50


def test_a_step_without_an_answer_is_not_repeated_blindly() -> None:
    speed, steps = 700, 0

    def deaf_once(request: Request) -> bytes | None:
        nonlocal speed, steps
        if request.data[1] == 0x0D:
            return struct.pack("<I", speed)
        steps += 1
        speed += {0x0B: 100, 0x0C: -100, 0x09: 10, 0x0A: -10}[request.data[1]]
        return None if steps == 2 else struct.pack("<I", speed)

    assert played(YdlidarDevice().set_scan_frequency(10.0), deaf_once) == 10.0
    assert steps == 3


@pytest.mark.parametrize(("quarters", "degrees"), [(0, 0.0), (-7, -1.75), (720, 180.0), (1440, 360.0)])
def test_zero_offset(bench: Bench, quarters: int, degrees: float) -> None:
    bench.simulated.zero_offset = quarters
    assert bench.run(bench.device.zero_offset()) == degrees
    assert [bench.run(bench.device.apply_zero_offset(on)) for on in (True, False)] == [degrees, 0]


def test_an_absurd_zero_offset_is_asked_again() -> None:
    answers = [struct.pack("<i", each) for each in (100_000, 9, 9)]
    assert played(YdlidarDevice().zero_offset(), lambda _: answers.pop(0)) == 2.25


@pytest.mark.parametrize(("quarters", "degrees"), [(100_000, "25000 "), (1441, "360.25 "), (-1441, "-360.25 ")])
def test_more_than_a_turn_is_no_zero_offset(quarters: int, degrees: str) -> None:
    with pytest.raises(RemoteProtocolError, match=degrees):
        played(YdlidarDevice().zero_offset(), lambda _: struct.pack("<i", quarters))


@pytest.mark.parametrize("before", [False, True])
@pytest.mark.parametrize("wanted", [False, True])
def test_power_down_protection_is_toggled_until_it_is_as_wanted(bench: Bench, before: bool, wanted: bool) -> None:
    bench.simulated.protected = before
    assert bench.run(bench.device.power_down_protection(wanted)) is wanted
    assert bench.simulated.protected is wanted
    assert len(bench.simulated.log) == (2 if before is wanted else 1)
    (mode,) = bench.run(bench.device.modes())
    stream = bench.run(bench.device.start(mode))
    assert (stream.keepalive is not None) is wanted
    if stream.keepalive:
        assert stream.keepalive.request.data == b"\xa5\x60"
        assert stream.keepalive.interval_s == 0.4


@pytest.mark.parametrize(
    ("before", "lost", "made", "ends"),
    [
        (False, 1, 3, nullcontext()),
        (False, 2, 3, nullcontext()),
        (True, 3, 4, nullcontext()),
        (False, 3, 4, pytest.raises(RemoteProtocolError, match="does not go on")),
        (False, 4, 4, pytest.raises(ResponseTimeout)),
    ],
)
def test_a_toggle_whose_answer_was_lost_ends_in_the_wanted_state(
    before: bool, lost: int, made: int, ends: AbstractContextManager[object]
) -> None:
    """Unless four toggles do not lead there. So many responses are lost, the first ones."""
    enabled, toggles = before, 0

    def lossy(request: Request) -> bytes | None:
        nonlocal enabled, toggles
        enabled, toggles = not enabled, toggles + 1
        return None if toggles <= lost else bytes((not enabled,))

    with ends:
        assert played(YdlidarDevice().power_down_protection(True), lossy) is True
        assert enabled
    assert toggles == made


@pytest.mark.parametrize("before", [False, True])
@pytest.mark.parametrize(("lost", "lasted_s"), [(0, 0.0), (1, 2.6), (2, 3.9)])
def test_two_toggles_tell_protection_and_leave_it(before: bool, lost: int, lasted_s: float) -> None:
    enabled, toggles = before, 0

    def lossy(request: Request) -> bytes | None:
        nonlocal enabled, toggles
        enabled, toggles = not enabled, toggles + 1
        return None if toggles == lost else bytes((not enabled,))

    assert played(YdlidarDevice().explain_silence(lasted_s), lossy) is enabled
    assert toggles == (3 if lost else 2)


@pytest.mark.parametrize(
    ("model", "protected", "lasted_s"),
    [("x4", False, 0.0), ("4ros", True, 0.0), ("4ros", False, 2.4), ("4ros", False, 4.1)],
)
def test_protection_is_not_toggled_where_it_explains_nothing(model: str, protected: bool, lasted_s: float) -> None:
    """A model has none, it is known to be on, or it would have stopped the device 3 s after its start."""
    device = YdlidarDevice(MODELS[model])
    if protected:
        played(device.power_down_protection(True), lambda _: b"\0")
    assert drive(device.explain_silence(lasted_s), {}) == (False, [])


def test_a_response_that_is_no_state_of_protection_tells_nothing() -> None:
    states = [b"\x02", b"\x01"]
    assert played(YdlidarDevice().power_down_protection(False), lambda _: states.pop(0)) is False
    assert states == []
    states = [b"\x02", b"\x01", b"\x00"]
    assert played(YdlidarDevice().explain_silence(0.0), lambda _: states.pop(0)) is True
    assert states == []


@pytest.mark.parametrize(
    ("model", "firmware", "degrees"),
    [
        ("ydlidar-r2", (1, 7), 180.0),
        ("ydlidar-r2", (1, 8), 7.2),
        ("ydlidar-r2", (2, 0), 7.2),
        ("ydlidar-g1", (1, 8), 180.0),
    ],
)
def test_the_offset_of_a_newer_r2_is_told_in_hundredths_of_a_degree(
    model: str, firmware: tuple[int, int], degrees: float
) -> None:
    """Of all others in quarters (ydlidar_4ros.md 4)."""
    bench = Bench(Simulated4Ros(replace(PROFILES[model], firmware=firmware)))
    bench.run(bench.device.identify())
    for sign in (1, -1):
        bench.simulated.zero_offset = sign * 720
        assert bench.run(bench.device.zero_offset()) == sign * degrees
    bench.simulated.zero_offset = round(720 * 360 / degrees) + 1
    with pytest.raises(RemoteProtocolError, match="zero-angle offset of 360"):
        bench.run(bench.device.zero_offset())
