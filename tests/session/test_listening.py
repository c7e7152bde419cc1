"""Opening a port of which nothing is known: listening first, asking in rounds, at speeds that garble each other."""

import asyncio
import itertools
import random
from collections.abc import Callable
from contextlib import suppress
from typing import Any
from unittest.mock import create_autospec

import pytest

from lidario import ConnectFailed, list_lidars, open_lidar
from lidario.families.registry import FAMILIES, family_named
from lidario.port.port import Port
from lidario.session.finding import search
from lidario.session.finding.discovery import PortInfo
from lidario.session.finding.listening import LISTEN_S, family_of_stream, listen
from tests.support.cases import CASES
from tests.support.devices import babble, is_off, leave_streaming, make_rig
from tests.support.loop import now_ns
from tests.support.refused import refused
from tests.support.speeds import misread, serial_in_memory
from tests.support.times import takes

STREAMING = (
    ("rplidar-s2", 0), ("rplidar-s2", 1), ("rplidar-s1", 0), ("rplidar-s1", 1), ("rplidar-express", 0),
    ("rplidar-hq", 0), ("rplidar-ultra", 0), ("rplidar-ultradense", 0), ("ydlidar-4ros", 0),
    ("hokuyo-urg04lx", 0), ("hokuyo-ust10lx", 0),
)  # fmt: skip
QUESTION = {family.name: next(family.device().identify()).data for family in FAMILIES}


@pytest.mark.parametrize(("model", "mode"), STREAMING)
async def test_a_device_that_streams_is_recognised_before_a_byte_is_written(
    model: str, mode: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    device = make_rig(model).device
    written = serial_in_memory(monkeypatch, left=device)
    leave_streaming(device, now_ns(), mode)
    with takes(0.9):
        lidar = await open_lidar("left")
    async with lidar:
        assert lidar.info.family == model.partition("-")[0]
        speeds = [each for family in FAMILIES for each in family.baudrates]
        assert len(written) > 1
        assert {speed for speed, _ in written} == {device.baudrate} <= set(speeds)


ONE_SPEED = pytest.param(
    True, marks=pytest.mark.discards("the questions of both families reach a device that boots"), id="one speed"
)


@pytest.mark.parametrize("shared", [pytest.param(False, id="by speed"), ONE_SPEED])
@pytest.mark.parametrize("boot_s", [0.7, 2.0, 3.1, 4.2])
@pytest.mark.parametrize("model", ["rplidar-s1", "rplidar-s2", "ydlidar-4ros"])
async def test_a_device_that_boots_is_asked_again(
    model: str, boot_s: float, shared: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It is found a round after the boot at the latest, or a round after the models that need DTR were asked."""
    device = make_rig(model).device
    serial_in_memory(monkeypatch, boots=device)
    family = model.partition("-")[0]
    device.boot_s = boot_s
    device.receive(b"\xa5\x80" if family == "ydlidar" else b"\xa5\x40", now_ns())
    with takes(boot_s + 8.5):
        lidar = await open_lidar(device if shared else "boots")
    assert lidar.info.family == family
    await lidar.close()


@pytest.mark.discards("half a request swallows what follows it")
@pytest.mark.parametrize(
    ("shared", "family"),
    [(False, None), (True, None), (True, "rplidar")],
    ids=["by speed", "one speed", "its family is known"],
)
@pytest.mark.parametrize("model", ["rplidar-s1", "rplidar-s2"])
async def test_half_a_request_is_outlived(
    model: str, shared: bool, family: str | None, monkeypatch: pytest.MonkeyPatch
) -> None:
    for half in (b"\xa5", b"\xa5\x82", b"\xa5\x84\xff", b"\xa5\x82\x05\x01"):
        device = make_rig(model).device
        serial_in_memory(monkeypatch, holds=device)
        device.receive(half, now_ns())
        async with open_lidar(device if shared else "holds", family=family) as lidar:
            assert lidar.info.family == "rplidar", half
            await lidar.scan()


def test_no_question_reads_as_a_request_at_another_speed() -> None:
    for asked, heard in itertools.permutations(FAMILIES, 2):
        device = asked.device()
        said = [device.stop().data, QUESTION[asked.name], device.complete_probe(), *(r.data for r in device.halt())]
        for at, read_at in itertools.product(asked.baudrates, (*heard.baudrates, *asked.baudrates)):
            if at != read_at:
                assert all(0xA5 not in misread(data, at, read_at) for data in said), (at, read_at)


@pytest.mark.long
@pytest.mark.parametrize(("model", "mode"), STREAMING)
def test_a_stream_is_recognised_at_its_own_speed_alone(model: str, mode: int) -> None:
    device = make_rig(model).device
    leave_streaming(device, 10**9, mode)
    data = b"".join(device.transmit(10**9 + step * 10**7) for step in range(1, 13))
    family = family_of_stream(bytearray(data[:16384]))
    assert family is not None
    assert family.name == model.partition("-")[0]
    for speed in {each for family in FAMILIES for each in family.baudrates} - {device.baudrate}:
        assert family_of_stream(bytearray(misread(data, device.baudrate, speed)[:4096])) is None, speed


def test_noise_is_no_stream() -> None:
    dice = random.Random(7)
    for _ in range(40):
        assert family_of_stream(bytearray(dice.randbytes(dice.randrange(4096)))) is None
    assert family_of_stream(bytearray(4096)) is None
    assert family_of_stream(bytearray()) is None


@pytest.mark.parametrize("name", ["rplidar_32k_85", "ydlidar_4ros_room7", "irobotix_2a_6hz"])
def test_most_of_the_bytes_must_be_packets_and_three_of_them(name: str) -> None:
    case = next(each for each in CASES if each.name == name)
    for count in (2, 3, 6):
        packets = b"".join(case.packets[:count])
        for noise, recognised in ((len(packets) - 4, count >= 3), (len(packets) + 4, False)):
            for data in (packets + bytes(noise), bytes(noise) + packets):
                family = family_of_stream(bytearray(data))
                assert family is None or family.name == name.partition("_")[0]
                assert (family is not None) == recognised


@pytest.mark.parametrize(
    ("harm", "says", "least_s", "most_s"),
    [
        (lambda device: setattr(device, "mute", True), "nothing came back", 5.0, 13.0),
        pytest.param(babble, "garbage", 9.0, 18.0, marks=pytest.mark.long),
    ],
    ids=["silence", "noise"],
)
async def test_where_nothing_listens_it_ends(
    harm: Callable[[Any], object], says: str, least_s: float, most_s: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    device = make_rig("rplidar-s2").device
    harm(device)
    written = serial_in_memory(monkeypatch, mute=device)
    with takes(most_s, more_than_s=least_s), refused("silent", says):
        await open_lidar("mute")
    if harm is babble:
        return
    at_each = [
        next(data for each, data in written if each == speed) for speed in dict.fromkeys(s for s, _ in written)
    ]
    order = ("rplidar", "ydlidar", "", "hokuyo", "rplidar", "ydlidar", "rplidar", "ydlidar")
    # The third writes only to wake the one model that hears anything.
    assert at_each == [QUESTION[name] if name else bytes.fromhex("54A004000000005E") for name in order]


@pytest.mark.exhaustive("ended_after_s", sample=[0.5, 2.0, 4.0, None])
@pytest.mark.parametrize("model", ["ldrobot-ld14p", "hlds-lds01"])
async def test_what_the_search_may_have_started_is_left_still(
    model: str, ended_after_s: float | None, monkeypatch: pytest.MonkeyPatch
) -> None:
    device = make_rig(model).device
    written = serial_in_memory(monkeypatch, mute=device)
    stop = bytes.fromhex("54A104000000004A") if model == "ldrobot-ld14p" else b"e"
    device.receive(stop, now_ns())
    assert not device.motor_on
    device.mute = True
    with pytest.raises((ConnectFailed, TimeoutError)):
        async with asyncio.timeout(ended_after_s):
            await open_lidar("mute")
    # What was written last may still be under way.
    await asyncio.sleep(1.0)
    assert not device.motor_on
    assert written.came_whole(stop)


async def test_noise_is_listened_to_once_in_a_round_of_questions(monkeypatch: pytest.MonkeyPatch) -> None:
    """Each time takes a second, in which nobody is asked."""
    device = make_rig("rplidar-s2").device
    device.mute = True
    serial_in_memory(monkeypatch, noisy=device)
    listened = create_autospec(listen, side_effect=listen)
    monkeypatch.setattr(search, "listen", listened)
    asyncio.get_running_loop().call_later(0.7, babble, device)
    with pytest.raises(TimeoutError):
        async with asyncio.timeout(3.5):
            await open_lidar("noisy", family="rplidar")
    # At first, as the noise had begun, and in the next round.
    assert listened.await_count == 3


async def test_a_speed_the_adapter_cannot_do_is_left_out(monkeypatch: pytest.MonkeyPatch) -> None:
    device = make_rig("rplidar-s1").device
    serial_in_memory(monkeypatch, poor=device)
    change = Port.set_baudrate

    def refuse(self: Port, baudrate: int) -> None:
        if baudrate == 512_000:
            raise ConnectFailed("cannot run at 512000 baud", reason="silent")
        change(self, baudrate)

    monkeypatch.setattr(Port, "set_baudrate", refuse)
    leave_streaming(device, now_ns(), 1)
    for _ in range(2):
        async with open_lidar("poor") as lidar:
            assert lidar.info.family == "rplidar"


async def test_cancelled_while_it_listens_it_asks_only_those_that_turn(monkeypatch: pytest.MonkeyPatch) -> None:
    device = make_rig("ydlidar-4ros").device
    written = serial_in_memory(monkeypatch, rests=device)
    ports: list[Port] = []

    async def spied(port: Port, *rest: Any) -> Any:
        ports.append(port)
        return await listen(port, *rest)

    monkeypatch.setattr("lidario.session.finding.search.listen", spied)
    with pytest.raises(TimeoutError):
        async with asyncio.timeout(LISTEN_S / 2):
            await open_lidar("rests")
    assert not ports[0].is_open
    # Nobody keeps what comes any more.
    assert not ports[0].taps
    questions = [(speed, QUESTION["rplidar"]) for speed in family_named("rplidar").baudrates]
    assert [each for each in written if each[1]] == questions
    assert device.log == []


DAMAGED = ("ydlidar-4ros", "ydlidar-g2", "hokuyo-urg04lx", "ldrobot-ld14p", "hlds-lds01")
WHEN_S = (0.01, 0.1, 0.7, 1.2, 1.7)


@pytest.mark.long
@pytest.mark.exhaustive(
    ("model", "at_s"),
    sample=[(DAMAGED[(row + row * turn) % 5], at_s) for turn in (1, 2) for row, at_s in enumerate(WHEN_S)],
    full=list(itertools.product(DAMAGED, WHEN_S)),
)
async def test_one_whose_packets_are_not_recognised_is_stopped_where_its_search_is_cancelled(
    model: str, at_s: float, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    """Each of them is damaged. Nobody says that it goes on sending: who was asked just then is another family."""
    device = make_rig(model).device
    serial_in_memory(monkeypatch, unknown=device)
    leave_streaming(device, now_ns(), 1)
    send = device.transmit

    def damaged(now: int) -> bytes:
        data = bytearray(send(now))
        data[::7] = bytes(byte ^ 0x10 for byte in data[::7])
        return bytes(data)

    device.transmit = damaged
    with takes(at_s + 2.5), pytest.raises(TimeoutError):
        async with asyncio.timeout(at_s):
            await open_lidar("unknown")
    # What was written last may still be under way.
    await asyncio.sleep(0.05)
    assert is_off(device)
    assert not caplog.records


@pytest.mark.long
@pytest.mark.parametrize("after_s", [0.0, 0.013, 0.05, 0.091])
@pytest.mark.parametrize("model", ["hokuyo-urg04lx", "hokuyo-ust10lx"])
async def test_whose_packets_are_whole_scans_is_recognised_by_one_where_its_search_is_cancelled(
    model: str, after_s: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of a URG-04LX hardly more than one comes while it is listened to; a UST-10LX sends 3.3 KB in each."""
    device = make_rig(model).device
    written = serial_in_memory(monkeypatch, unknown=device)
    leave_streaming(device, now_ns(), 0)
    await asyncio.sleep(after_s)
    with pytest.raises(TimeoutError):
        async with asyncio.timeout(0.01):
            await open_lidar("unknown")
    assert written == [(115_200, b"QT\n")]
    await asyncio.sleep(0.05)
    assert not device.scanning


@pytest.mark.long
@pytest.mark.parametrize("model", ["rplidar-a1", "ydlidar-x2", "ydlidar-s2-pro"])
@pytest.mark.parametrize("source", ["serial://unknown", "serial://unknown?baud=115200"])
async def test_dtr_is_left_as_the_model_needs_it(model: str, source: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """What stops the motor of an A1 starts that of an X2. The search is cancelled every 60 ms."""
    for step in range(len(model) % 3, 75, 3):
        device = make_rig(model).device
        serial_in_memory(monkeypatch, unknown=device)
        with suppress(TimeoutError):
            async with asyncio.timeout(0.02 * step + 0.001), open_lidar(source):
                pass
        await asyncio.sleep(2.0)
        assert not device.motor_on, step


async def test_ports_are_asked_side_by_side_and_patiently_if_none_responds(monkeypatch: pytest.MonkeyPatch) -> None:
    models = ("rplidar-s2", "ydlidar-4ros", "rplidar-s1", "rplidar-s1")
    first, second, third, mute = (make_rig(model).device for model in models)
    mute.mute = True
    third.boot_s = 4.0
    serial_in_memory(monkeypatch, a=first, b=mute, c=second, d=third)
    known = [PortInfo(path, "", "CP2102", "") for path in "bd"]
    monkeypatch.setattr("lidario.session.finding.discovery.list_serial_ports", lambda: known)
    with takes(5.5):
        found = await list_lidars(("a", "b", "c"))
    assert [each.port.path for each in found if each.info] == ["a", "c"]
    third.receive(b"\xa5\x40", now_ns())
    async with open_lidar("auto") as lidar:
        assert lidar.info.serial == third.serial.hex().upper()


async def test_a_search_in_vain_stops_the_motor_of_a_family_that_was_named(monkeypatch: pytest.MonkeyPatch) -> None:
    """It responds too late at each of its speeds. The opening of the port has set it in motion."""
    device = make_rig("rplidar-a1").device
    device.response_delay_s = 0.2
    serial_in_memory(monkeypatch, late=device)
    with pytest.raises(ConnectFailed):
        await open_lidar("late", family="rplidar")
    assert not device.motor_on
