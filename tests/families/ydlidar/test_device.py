"""The 4ROS's scripts: by hand, and against the simulated device, in driven time."""

from dataclasses import replace

import pytest

import lidario
from lidario.basics.model import Health, HealthStatus, ScanMode
from lidario.errors import ResponseTimeout, Unsupported
from lidario.families.ydlidar import commands
from lidario.families.ydlidar.device import YdlidarDevice
from lidario.families.ydlidar.models import MODELS
from lidario.families.ydlidar.simulated.device import PROFILES, Simulated4Ros, make_simulated
from lidario.wire.envelope import Request
from lidario.wire.events import Descriptor
from tests.families.ydlidar.test_models import silent
from tests.support.scripts import played
from tests.support.simulated_4ros import Bench
from tests.support.speeds import serial_in_memory


# An S4 whose motor is switched by DTR must be named.
@pytest.mark.parametrize(
    ("baudrate", "by_dtr", "title"),
    [(115_200, False, "YDLIDAR S4"), (153_600, False, "YDLIDAR S4B"), (153_600, True, "YDLIDAR S4B")],
)
@pytest.mark.parametrize("source", ["only", "serial://only?family=ydlidar"])
async def test_of_two_models_with_one_code_the_speed_of_the_line_tells(
    source: str, baudrate: int, by_dtr: bool, title: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Code 4 is that of the S4 and of some S4B, whose samples are longer (more_families.md A1)."""
    made = PROFILES["ydlidar-s4b"]
    if baudrate == 115_200:
        made = replace(made, layout=PROFILES["ydlidar-x4"].layout, baudrate=baudrate)
    device = Simulated4Ros(replace(made, model=4, by_dtr=by_dtr))
    serial_in_memory(monkeypatch, only=device)
    async with lidario.open_lidar(source) as lidar:
        assert (lidar.info.model, lidar.info.model_id) == (title, 4)
        assert len(await lidar.scan()) > 100


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
    # Trouble is believed when it comes twice.
    assert [received.data for received in bench.simulated.log] == [b"\xa5\x91", b"\xa5\x91"]
    bench.simulated.log.clear()
    bench.simulated.health = (0, 0)
    assert bench.run(bench.device.health()).ok
    assert len(bench.simulated.log) == 1


def test_health_falls_back_to_the_other_request_and_remembers_it() -> None:
    """A question that is cancelled, or that still waits, forgets nothing."""
    bench = Bench(make_simulated("ydlidar-4ros-92"))
    assert bench.run(bench.device.health()).ok
    cancelled, waits = bench.device.health(), bench.device.health()
    assert [next(cancelled).data[1], next(waits).data[1]] == [0x92, 0x92]
    cancelled.close()
    assert bench.run(bench.device.health()).ok
    assert [received.data[1] for received in bench.simulated.log] == [0x91, 0x92, 0x92]


@pytest.mark.parametrize(("model", "asked"), [("ydlidar-4ros", [0x91, 0x92]), ("ydlidar-x4", [0x92, 0x91])])
def test_health_gives_up_after_each_way_was_tried_twice(model: str, asked: list[int]) -> None:
    bench = Bench(make_simulated(model))
    bench.run(bench.device.identify())
    bench.simulated.log.clear()
    bench.simulated.mute = True
    with pytest.raises(ResponseTimeout):
        bench.run(bench.device.health())
    assert [received.data[1] for received in bench.simulated.log] == asked * 2
    bench.simulated.mute = False
    assert bench.run(bench.device.health()).ok


@pytest.mark.parametrize("model", [None, "4ros", "x4", "x2", "tx8"])
def test_only_one_that_hears_is_told_to_stop_and_only_one_that_may_talk_is_listened_to(model: str | None) -> None:
    """While it streams: one whose STOP was lost is told again. A motor that DTR turns has longer to begin."""
    one_way = model in ("x2", "tx8")
    asked, waited = list[bytes](), list[float]()

    def silent(request: Request) -> bytes | None:
        asked.append(request.data)
        waited.extend([] if request.expects is None else [request.timeout * request.attempts])
        return b"" if request.expects is None else None

    with pytest.raises(ResponseTimeout):
        played(YdlidarDevice(None if model is None else MODELS[model]).overhear(), silent)
    twice = [] if one_way else [commands.STOP.data, commands.GET_INFO.data] * 2
    assert asked == twice + [b""] * (one_way or model is None)
    assert waited == [0.25] * (len(twice) // 2) + [1.5 if model == "x2" else 0.5] * (one_way or model is None)


@pytest.mark.parametrize("talks", [True, False])
def test_what_a_device_says_when_it_gets_power_is_no_response_of_one_that_only_talks_on(talks: bool) -> None:
    """An X2 tells its code at power-on (X2 manual, 3), and a response may be lost: what streams then only talks."""
    responses: list[bytes | None] = [bytes([6]) + bytes(19), None, bytes([6]) + bytes(19)]
    waited = list[float]()

    def respond(request: Request) -> bytes | None:
        waited.append(request.timeout * request.attempts)
        if request.stream is not None:
            return bytes(silent(400)) if talks else None
        return responses.pop(0)

    info = played(YdlidarDevice().identify(), respond)
    assert (info.model, info.firmware) == (("YDLIDAR X2, X3 or alike", "") if talks else ("YDLIDAR X4", "0.0"))
    # Until the second response is given up, and it is listened to.
    assert waited[1] <= 0.5


@pytest.mark.parametrize(("samples", "is_known"), [(1250, True), (1350, False)])
def test_one_that_sends_more_a_revolution_than_any_that_only_talks_is_none_of_them(
    samples: int, is_known: bool
) -> None:
    def talks(request: Request) -> bytes | None:
        if request.stream is not None:
            return bytes(silent(samples))
        return b"" if request.expects is None else None

    device = YdlidarDevice()
    if is_known:
        info = played(device.overhear(), talks)
        health = played(device.health(), talks)
        assert (health.status, health.code) == (HealthStatus.OK, 0)
        assert "?model=" in health.note
        assert played(YdlidarDevice(MODELS["x3"]).health(), talks) == Health(HealthStatus.OK, 0)
        assert (info.model, info.firmware, info.hardware, info.serial) == ("YDLIDAR X2, X3 or alike", "", 0, "")
    else:
        with pytest.raises(ResponseTimeout):
            played(device.overhear(), talks)


def test_a_lost_scan_header_leads_to_a_new_start_from_standstill(bench: Bench) -> None:
    (mode,) = bench.run(bench.device.modes())
    bench.simulated.mute = True
    script = bench.device.start(mode)
    request = next(script)
    assert bench.ask(request) is None
    bench.simulated.mute = False
    second = script.throw(ResponseTimeout(request.name, request.timeout))
    assert second.data == b"\xa5\x65"
    bench.ask(second)
    third = script.send(b"")
    assert third.stream is not request.stream
    bench.ask(third)
    with pytest.raises(StopIteration) as done:
        script.send(b"")
    stream = done.value.value
    assert stream.format is third.stream
    # 2.5 s are assumed for the motor, and a margin; 3 Hz is the lowest speed that packets can tell.
    assert (stream.spin_up_s, stream.slowest_turn_s) == (4.0, 1.5 / 3)
    assert (stream.zero_offset_deg, stream.sample_ns, stream.may_take_ns) == (0, 50_000, (50_000,))
    assert bench.pass_time(2.0).startswith(b"\xaa\x55")


def test_what_is_not_this_device_is_not_decoded() -> None:
    device = YdlidarDevice()
    (mode,) = played(device.modes(), lambda _: b"")
    with pytest.raises(Unsupported, match="forced"):
        played(device.start(mode, force=True), lambda _: b"")
    with pytest.raises(Unsupported, match="one scan mode"):
        played(device.start(ScanMode(1, "Boost", 31.25, 30, 0x85)), lambda _: b"")
    played(device.identify(), lambda _: bytes((99,)) + bytes(19))
    with pytest.raises(Unsupported, match="model 99") as refused:
        played(device.start(mode), lambda _: b"")
    listed = str(refused.value).partition("lidario decodes models ")[2].partition(". If")[0].split(", ")
    # Those that tell a code: one that only talks is not known by it.
    assert {"6 (X4)", "4 (S4)", "101 (4ROS)", "101 (TG30)", "140 (Tmini)"} <= set(listed)
    assert not {"6 (X2)", "6 (X3)", "6 (X4 Pro)", "4 (S2 Pro)", "100 (TX8)"} & set(listed)
    codes = [int(each.partition(" ")[0]) for each in listed]
    assert codes == sorted(codes)


@pytest.mark.parametrize("name", ["4ros", "x4", "tmini"])
def test_a_recording_that_is_played_announces_its_stream_as_every_model_does(name: str) -> None:
    """The length in it is 5, whatever the packets are (ydlidar_4ros.md)."""
    device = YdlidarDevice(MODELS[name])
    assert device.respond(b"\xa5\x60", Descriptor(0x81, 90, continuous=True)) == bytes.fromhex("A55A0500004081")
    told = device.respond(b"\xa5\x91", Descriptor(0x06, 3, continuous=False), b"\0\0\0")
    assert told == bytes.fromhex("A55A0300000006000000")
