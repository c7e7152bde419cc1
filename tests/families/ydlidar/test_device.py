"""The 4ROS's scripts: by hand, and against the simulated device through a real `Link`, in driven time."""

import math
import struct
from collections.abc import Callable
from typing import Any, TypeVar

import numpy as np
import pytest

from lidario.errors import InvalidValue, RemoteProtocolError, ResponseTimeout, Unsupported
from lidario.families.base import Script
from lidario.families.ydlidar import FAMILY, commands
from lidario.families.ydlidar.device import YdlidarDevice
from lidario.families.ydlidar.simulated.device import Simulated4Ros, make_simulated
from lidario.model import DeviceInfo, Health, HealthStatus, ScanMode
from lidario.sim.world import World
from lidario.wire.envelope import Request
from lidario.wire.events import Packets, Response
from lidario.wire.link import Link, LinkState
from tests.support.streams import in_one_run

T = TypeVar("T")
MS = 1_000_000


class Bench:
    """Host and simulated device on one table, with a clock that is moved by hand."""

    def __init__(self, simulated: Simulated4Ros) -> None:
        self.simulated = simulated
        self.device = YdlidarDevice()
        self.link = Link()
        self.now = 10**9
        self.packets: list[Packets] = []
        self.answers: list[bytes] = []

    def pass_time(self, seconds: float) -> None:
        end = self.now + round(seconds * 1e9)
        while self.now < end:
            self.now = min(self.now + MS, end)
            self.link.receive_data(self.simulated.transmit(self.now), self.now)
            for event in self.link.events_received():
                if isinstance(event, Packets):
                    self.packets.append(event)
                elif isinstance(event, Response):
                    self.answers.append(event.payload)
                else:
                    self.answers.append(b"")

    def send(self, request: Request) -> None:
        self.link.send_request(request)
        self.simulated.receive(self.link.data_to_send(), self.now)

    def ask(self, request: Request) -> bytes:
        for _ in range(request.attempts):
            self.answers.clear()
            self.send(request)
            if request.expects is None:
                self.pass_time(request.settle)
                return b""
            deadline = self.now + round(request.timeout * 1e9)
            while not self.answers and self.now < deadline:
                self.pass_time(0.001)
            self.link.forget()
            if self.answers:
                return self.answers[0]
        raise ResponseTimeout(request.name, request.timeout)

    def run(self, script: Script[T]) -> T:
        try:
            request = next(script)
            while True:
                try:
                    payload = self.ask(request)
                except ResponseTimeout as timeout:
                    request = script.throw(timeout)
                else:
                    request = script.send(payload)
        except StopIteration as stop:
            value: T = stop.value
            return value

    def sent(self) -> list[str]:
        return [received.name for received in self.simulated.log]


@pytest.fixture
def bench() -> Bench:
    return Bench(make_simulated("ydlidar-4ros", serial="2023061500001234"))


def played(script: Script[T], answer: Callable[[Request], bytes | None]) -> T:
    """Run a script against a function; None is silence."""
    try:
        request = next(script)
        while True:
            payload = answer(request)
            if payload is None:
                request = script.throw(ResponseTimeout(request.name, request.timeout))
            else:
                request = script.send(payload)
    except StopIteration as stop:
        value: T = stop.value
        return value


def test_requests_are_two_bytes() -> None:
    device = YdlidarDevice()
    assert device.stop().data == b"\xa5\x65"
    assert [request.data for request in device.halt()] == [b"\xa5\x00", b"\xa5\x65"]
    assert device.reset().data == b"\xa5\x80"
    assert all(request.ends_stream for request in (device.stop(), device.reset(), *device.halt()))
    assert commands.KEEPALIVE.data == b"\xa5\x60"
    assert commands.KEEPALIVE.expects is None
    assert commands.KEEPALIVE.in_stream


def test_no_request_that_steps_or_toggles_is_repeated_by_itself() -> None:
    steps = (commands.SPEED_UP_BY_1, commands.SPEED_DOWN_BY_1, commands.SPEED_UP_BY_01, commands.SPEED_DOWN_BY_01)
    assert all(request.attempts == 1 for request in (*steps, commands.TOGGLE_PROTECTION))


def test_identify(bench: Bench) -> None:
    info = bench.run(bench.device.identify())
    assert info == DeviceInfo("ydlidar", "YDLIDAR 4ROS", 101, "3.1", 2, "2023061500001234")


@pytest.mark.parametrize(
    ("model", "name"), [(100, "YDLIDAR TG15"), (102, "YDLIDAR TG50"), (6, "YDLIDAR X4"), (99, "YDLIDAR (model 99)")]
)
def test_model_names_and_firmware_order(model: int, name: str) -> None:
    payload = bytes((model, 10, 1, 0)) + bytes(range(9)) + b"\x09\x0a" + bytes(5)
    info = played(YdlidarDevice().identify(), lambda _: payload)
    assert (info.model, info.firmware, info.serial) == (name, "1.10", "0123456789[0a]00000")


def test_health_is_asked_as_in_the_manual(bench: Bench) -> None:
    bench.simulated.health = (1, 0x1234)
    assert bench.run(bench.device.health()) == Health(HealthStatus.WARNING, 0x1234)
    assert [received.data for received in bench.simulated.log] == [b"\xa5\x91"]


def test_health_falls_back_to_the_other_request_and_remembers_it() -> None:
    bench = Bench(make_simulated("ydlidar-4ros-92"))
    for _ in range(2):
        assert bench.run(bench.device.health()).ok
    assert [received.data[1] for received in bench.simulated.log] == [0x91, 0x92, 0x92]


def test_health_gives_up_after_each_way_was_tried_twice(bench: Bench) -> None:
    bench.simulated.mute = True
    with pytest.raises(ResponseTimeout):
        bench.run(bench.device.health())
    assert [received.data[1] for received in bench.simulated.log] == [0x91, 0x92, 0x91, 0x92]
    bench.simulated.mute = False
    assert bench.run(bench.device.health()).ok


def test_an_undefined_health_is_a_warning() -> None:
    health = played(YdlidarDevice().health(), lambda _: b"\x03\x00\x00")
    assert health.status is HealthStatus.WARNING
    assert "status 3" in health.note


def test_the_only_mode(bench: Bench) -> None:
    (mode,) = bench.run(bench.device.modes())
    assert (mode.name, mode.samples_per_second, mode.max_distance, mode.typical) == ("Standard", 20_000, 30, True)
    assert bench.sent() == []


def test_a_stream(bench: Bench) -> None:
    (mode,) = bench.run(bench.device.modes())
    stream = bench.run(bench.device.start(mode))
    assert bench.link.state is LinkState.STREAMING
    assert (stream.sample_ns, stream.mode, stream.keepalive) == (50_000, mode, None)
    bench.pass_time(stream.spin_up_s)
    assert bench.packets
    bench.packets.clear()
    bench.pass_time(1.0)
    data = in_one_run(stream.format, b"".join(run.data for run in bench.packets))
    samples = stream.decoder.decode(data, None)
    assert len(samples.distance_mm) == pytest.approx(20_000, abs=120)
    assert samples.lost == 0
    assert bench.link.stats.skipped_bytes == 0
    starts = [heading for heading in stream.format.headings(data) if heading >> 28]
    assert len(starts) == 7
    bench.ask(bench.device.stop())
    bench.pass_time(0.1)
    bench.packets.clear()
    bench.pass_time(0.5)
    assert not bench.packets
    assert not bench.simulated.motor_on


def test_each_stream_has_a_format_of_its_own(bench: Bench) -> None:
    (mode,) = bench.run(bench.device.modes())
    first = bench.run(bench.device.start(mode))
    bench.ask(bench.device.stop())
    second = bench.run(bench.device.start(mode))
    assert first.format is not second.format
    assert first.decoder is not second.decoder


def test_a_lost_scan_header_leads_to_a_new_start_from_standstill(bench: Bench) -> None:
    (mode,) = bench.run(bench.device.modes())
    bench.simulated.mute = True
    script = bench.device.start(mode)
    request = next(script)
    with pytest.raises(ResponseTimeout) as caught:
        bench.ask(request)
    bench.simulated.mute = False
    second = script.throw(caught.value)
    assert second.data == b"\xa5\x65"
    bench.ask(second)
    third = script.send(b"")
    assert third.stream is not request.stream
    bench.ask(third)
    with pytest.raises(StopIteration) as done:
        script.send(b"")
    assert done.value.value.format is third.stream
    bench.pass_time(2.0)
    assert bench.packets


def test_a_first_packet_that_is_late_after_the_header() -> None:
    bench = Bench(make_simulated("ydlidar-4ros-slow"))
    (mode,) = bench.run(bench.device.modes())
    stream = bench.run(bench.device.start(mode))
    bench.pass_time(2.4)
    assert not bench.packets
    assert bench.link.state is LinkState.STREAMING
    bench.pass_time(stream.spin_up_s - 2.4)
    assert bench.packets


def test_what_is_not_this_device_is_not_decoded() -> None:
    device = YdlidarDevice()
    (mode,) = played(device.modes(), lambda _: b"")
    with pytest.raises(Unsupported, match="forced"):
        played(device.start(mode, force=True), lambda _: b"")
    with pytest.raises(Unsupported, match="one scan mode"):
        played(device.start(ScanMode(1, "Boost", 31.25, 30, 0x85)), lambda _: b"")
    played(device.identify(), lambda _: bytes((99,)) + bytes(19))
    with pytest.raises(Unsupported, match="model 99"):
        played(device.start(mode), lambda _: b"")


@pytest.mark.parametrize("hertz", [5.0, 5.1, 6.96, 7.0, 7.9, 8.04, 9.5, 10.0, 11.95, 12.0])
def test_set_scan_frequency(bench: Bench, hertz: float) -> None:
    bench.run(bench.device.set_scan_frequency(10.3))
    before = len(bench.simulated.log)
    got = bench.run(bench.device.set_scan_frequency(hertz))
    assert got == pytest.approx(hertz, abs=0.0501)
    assert got == bench.simulated.set_speed / 100
    assert bench.run(bench.device.scan_frequency()) == got
    assert len(bench.simulated.log) - before < 16


def test_the_set_frequency_is_reached_without_the_vendors_correction(bench: Bench) -> None:
    assert bench.run(bench.device.scan_frequency()) == 7.0
    assert bench.run(bench.device.set_scan_frequency(10.0)) == 10.0
    assert [received.data[1] for received in bench.simulated.log] == [0x0D, 0x0D, 0x0B, 0x0B, 0x0B, 0x0D]


@pytest.mark.parametrize("hertz", [4.9, 12.1, 0.0, -7.0, 1e308])
def test_a_frequency_out_of_range_is_refused_before_anything_is_sent(hertz: float) -> None:
    device = YdlidarDevice()
    script = device.scan_frequency_range()
    with pytest.raises(StopIteration) as done:
        next(script)
    assert done.value.value == (5.0, 12.0)
    with pytest.raises(InvalidValue, match="5 to 12 Hz"):
        device.set_scan_frequency(hertz)


@pytest.mark.parametrize("hertz", [math.nan, math.inf, "10", None, 1j, 10**400])
def test_what_is_no_frequency_is_refused(hertz: Any) -> None:
    with pytest.raises(InvalidValue, match="scan frequency"):
        YdlidarDevice().set_scan_frequency(hertz)


def test_a_device_that_does_not_step_ends_the_setting() -> None:
    asked: list[int] = []

    def stubborn(request: Request) -> bytes:
        asked.append(request.data[1])
        return struct.pack("<I", 800)

    assert played(YdlidarDevice().set_scan_frequency(10.0), stubborn) == 8.0
    assert asked == [0x0D, 0x0B, 0x0D]


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


def test_an_absurd_zero_offset_is_asked_again_and_refused() -> None:
    answers = [struct.pack("<i", 100_000), struct.pack("<i", 9)]
    assert played(YdlidarDevice().zero_offset(), lambda _: answers.pop(0)) == 2.25
    with pytest.raises(RemoteProtocolError, match="25000"):
        played(YdlidarDevice().zero_offset(), lambda _: struct.pack("<i", 100_000))


def test_zero_offset_is_applied_only_on_demand(bench: Bench) -> None:
    bench.simulated.zero_offset = -10
    (mode,) = bench.run(bench.device.modes())

    def offset() -> float:
        stream = bench.run(bench.device.start(mode))
        bench.ask(bench.device.stop())
        return stream.zero_offset_deg

    assert offset() == 0.0
    bench.run(bench.device.apply_zero_offset(True))
    assert offset() == -2.5
    bench.run(bench.device.apply_zero_offset(False))
    assert offset() == 0.0


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


@pytest.mark.parametrize("on", [np.True_, 1, "yes", np.False_, 0])
def test_what_is_as_good_as_true_switches_protection(bench: Bench, on: Any) -> None:
    assert bench.run(bench.device.power_down_protection(on)) is bool(on)
    assert bench.simulated.protected is bool(on)


def test_a_toggle_whose_answer_was_lost_ends_in_the_wanted_state() -> None:
    enabled, toggles = False, 0

    def lossy(request: Request) -> bytes | None:
        nonlocal enabled, toggles
        enabled, toggles = not enabled, toggles + 1
        return None if toggles == 1 else bytes((not enabled,))

    assert played(YdlidarDevice().power_down_protection(True), lossy) is True
    assert (enabled, toggles) == (True, 3)


def test_protection_that_does_not_change_is_an_error() -> None:
    with pytest.raises(RemoteProtocolError, match="does not go on"):
        played(YdlidarDevice().power_down_protection(True), lambda _: b"\x01")
    with pytest.raises(ResponseTimeout):
        played(YdlidarDevice().power_down_protection(True), lambda _: None)


@pytest.mark.parametrize(("interval", "survives"), [(1.0, True), (2.5, True), (3.5, False)])
def test_keepalive_holds_the_stream_of_a_protected_device(bench: Bench, interval: float, survives: bool) -> None:
    bench.run(bench.device.power_down_protection(True))
    (mode,) = bench.run(bench.device.modes())
    stream = bench.run(bench.device.start(mode))
    assert stream.keepalive is not None
    for _ in range(round(10 / interval)):
        bench.pass_time(interval)
        if not bench.simulated.scanning:
            break
        bench.send(stream.keepalive.request)
    assert (bench.simulated.lapses == 0) is survives
    if survives:
        data = in_one_run(stream.format, b"".join(run.data for run in bench.packets))
        assert stream.decoder.decode(data, None).lost == 0
        assert bench.link.stats.skipped_bytes == 0


@pytest.mark.discards("asks a device that is scanning")
def test_queries_wait_for_the_end_of_the_stream(bench: Bench) -> None:
    bench.simulated.begin_streaming(bench.now)
    with pytest.raises(ResponseTimeout):
        bench.ask(commands.GET_INFO)
    bench.ask(bench.device.stop())
    bench.pass_time(FAMILY.timing.quiet_s)
    assert bench.run(bench.device.identify()).model == "YDLIDAR 4ROS"


def test_after_a_restart_it_is_asked_until_it_answers(bench: Bench) -> None:
    bench.ask(bench.device.reset())
    bench.link.drained()
    tried = 0
    while True:
        tried += 1
        try:
            bench.run(bench.device.identify())
            break
        except ResponseTimeout:
            assert bench.now < 10**9 + FAMILY.timing.boot_s * 1e9
    assert bench.run(bench.device.health()).ok
    assert bench.run(bench.device.scan_frequency()) == 7.0


def test_an_answer_of_another_length_is_not_taken(bench: Bench) -> None:
    # Information that nobody asked for has the same type as the answer to this question.
    bench.ask(bench.device.reset())
    bench.link.drained()
    bench.pass_time(0.999)
    bench.simulated.response_delay_s = 0.01
    assert bench.run(bench.device.scan_frequency()) == 7.0
    assert bench.link.stats.stray_bytes >= 27


def test_garbled_answers_are_asked_again(bench: Bench) -> None:
    bench.simulated.garble_responses = 1
    assert bench.run(bench.device.identify()).model_id == 101
    bench.simulated.garble_responses = 1
    assert bench.run(bench.device.health()).ok


def test_samples_show_the_world() -> None:
    # A spiral: the distance tells the direction it was measured in.
    directions = (np.arange(1 << 15) + 0.5) * 360 / (1 << 15)
    bench = Bench(make_simulated("ydlidar-4ros", world=World(1000 + 50 * directions)))
    (mode,) = bench.run(bench.device.modes())
    stream = bench.run(bench.device.start(mode))
    bench.pass_time(3.0)
    samples = stream.decoder.decode(in_one_run(stream.format, b"".join(run.data for run in bench.packets)), None)
    assert len(samples.distance_mm) > 30_000
    # 1/64 degree in the packet, 1/91 in the world's table, 1/100 in a millimetre.
    error = (samples.angle_deg - (samples.distance_mm - 1000) / 50 + 180) % 360 - 180
    assert np.abs(error).max() < 0.05
