"""``auto`` over every kind of device: how long it takes, and how much is written until it is found.

Times are of a driven clock and lines that garble what is sent at another speed, so any machine gives the same.
"""

import asyncio
from typing import Any

import numpy as np
import pytest

from lidario import list_lidars, open_lidar
from lidario.basics.source import parse_source
from lidario.families.registry import family_named
from lidario.port.simulated import connect_in_memory
from lidario.session.finding import listening
from lidario.session.finding.asking import Attempt, Woken, find_by_dtr
from lidario.session.finding.connect import connect
from lidario.sim.line import TransmitQueue
from tests.support.devices import hears_only, left_still, make_rig
from tests.support.loop import now, now_ns
from tests.support.speeds import plugged_in, serial_in_memory
from tests.support.times import takes

ONE_OF_EACH: dict[str, tuple[float, int]] = {  # seconds, bytes written
    "rplidar-s2": (0.3, 30),
    "rplidar-a1": (0.75, 38),
    "rplidar-c1": (0.85, 62),
    "ydlidar-4ros": (0.35, 20),
    "ydlidar-g2": (0.7, 40),
    "ydlidar-tmini-pro": (0.7, 40),
    "ydlidar-x4": (1.6, 60),
    "ydlidar-f4": (0.9, 52),
    "ydlidar-s4b": (1.8, 64),
    "ydlidar-x2": (2.8, 60),
    "ldrobot-ld06": (0.4, 0),
    "ldrobot-stl27l": (0.9, 0),
    "ldrobot-ld14": (0.75, 0),
    "ldrobot-ld14p": (0.6, 16),
    "hokuyo-urg04lx": (0.7, 40),
    "hokuyo-utm30lx": (0.7, 40),
    "neato-xv11": (0.7, 0),
    "camsense-x1": (0.7, 0),
    "irobotix-delta2a": (0.7, 0),
    "irobotix-delta2g": (0.7, 0),
    "hlds-lds01": (0.7, 2),
    "hlds-lds01-2016": (1.0, 30),
}
"""Bounds on what is measured, until it is known and left as it was. LDROBOT devices are found without a byte; a
model of a family with others that obey, after it went on in spite of two STOPs; the LD14P is left with two."""


@pytest.mark.long
@pytest.mark.parametrize("model", ONE_OF_EACH)
async def test_auto_finds_each_in_turn(model: str, monkeypatch: pytest.MonkeyPatch) -> None:
    device = make_rig(model).device
    written = plugged_in(monkeypatch, only=device)
    longest, most = ONE_OF_EACH[model]
    began = now()
    (found,) = await list_lidars()
    took, size = now() - began, sum(len(data) for _, data in written)
    print(f"{model:20} {took:5.2f} s {size:4} bytes written")
    assert found.info is not None, found.error
    assert found.info.family == model.partition("-")[0]
    assert found.baudrate == device.baudrate
    assert (took < longest, size <= most) == (True, True), (took, size)
    async with open_lidar("auto") as lidar, lidar.scans() as stream:
        await anext(stream)


@pytest.mark.parametrize(
    ("model", "title"), [("camsense-lds08rr", "LDS08RR of Camsense"), ("irobotix-lds08rr", "LDS08RR of 3irobotix")]
)
async def test_a_name_that_two_families_have_is_that_of_the_one_that_is_heard(
    model: str, title: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    serial_in_memory(monkeypatch, only=make_rig(model).device)
    async with open_lidar("serial://only?model=lds08rr") as lidar:
        assert (lidar.info.family, lidar.info.model) == (model.partition("-")[0], title)
        await lidar.scan()


TURRETS = ("neato-xv11", "camsense-x1", "irobotix-delta2a", "irobotix-delta2d", "irobotix-delta2g")
TALKING = ("ydlidar-x4-pro", "ldrobot-ld06", "ldrobot-ld14", "ldrobot-stl27l", *TURRETS, "hlds-lds01")
PORT = "serial://only"
SLOW = [
    # It was stopped before. A first, short search has stopped it again.
    pytest.param("ldrobot-ld14p", 1.0, bytes.fromhex("54A104000000004A"), "auto", 7.5, marks=pytest.mark.long),
    *((model, 2.0, b"e", PORT, 10.0) for model in ("hlds-lds01", "hlds-lds01-2016")),
    # Its motor is switched on by DTR.
    *(("ydlidar-x2", 1.4, b"", PORT + options, 6.5) for options in ("", "?baud=115200", "?model=x2")),
    # They were asked last, behind all that others may need to hear a question: 6.5 to 8.7 s.
    *(
        ("ydlidar-x4", 1.0, b"", PORT, 1.5),
        ("ydlidar-s4b", 1.0, b"", PORT, 1.7),
        ("ydlidar-x2", 1.0, b"", PORT, 2.4),
    ),
    # They get power when their port is opened. An S2 was asked again after 9 s; an XV-11 was listened to for 15 s.
    *(
        (model, 0.5, off_s, PORT, 5.0)
        for model in ("rplidar-s2", "rplidar-a1", "rplidar-c1", "ydlidar-x4", "ydlidar-x2", "neato-xv11")
        for off_s in (0.0, 0.5)
    ),
    # An LD06 sends 0.5 to 0.7 s after it got power (more_families.md B2), and no question wakes it.
    *(
        pytest.param(model, 0.5, 0.5, PORT, 8.0, marks=pytest.mark.long)
        for model in ("ldrobot-ld06", "ldrobot-stl27l", "ldrobot-ld14", *TURRETS[1:])
    ),
]
"""How long the rotor needs, what the device has heard before or how long it was off, and the longest search."""


@pytest.mark.parametrize(("model", "spin_up_s", "before", "source", "longest"), SLOW)
async def test_one_that_needs_time_is_found_soon_and_left_still(
    model: str,
    spin_up_s: float,
    before: bytes | float,
    source: str,
    longest: float,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    rig = make_rig(model)
    rig.device.spin_up_s = spin_up_s
    plugged_in(monkeypatch, only=rig.device)
    if isinstance(before, float):
        rig.device.reboot(now_ns(), off_s=before)
    else:
        rig.device.receive(before, now_ns())
    with takes(longest):
        lidar = await open_lidar(source)
    async with lidar:
        assert lidar.info.family == rig.family
        assert (await lidar.get_health()).ok
        await asyncio.sleep(1.0)
        assert (await lidar.scan()).valid.any()
    assert left_still(rig)


@pytest.mark.long
async def test_all_of_them_together(monkeypatch: pytest.MonkeyPatch) -> None:
    plugged_in(monkeypatch, **{model: make_rig(model).device for model in ONE_OF_EACH})
    # As long as the slowest of them alone.
    with takes(max(seconds for seconds, _ in ONE_OF_EACH.values())):
        found = await list_lidars()
    assert [each.info.family if each.info else "" for each in found] == [
        model.partition("-")[0] for model in ONE_OF_EACH
    ]


@pytest.mark.long
@pytest.mark.exhaustive("case", sample=[(0.1, 2), (0.3, 2)], full=[(0.0, 5), (0.1, 5), (0.3, 5)])
async def test_lost_packets_make_none_another_one(case: tuple[float, int], monkeypatch: pytest.MonkeyPatch) -> None:
    """Of those that are found by listening; the marks of two of them are the same."""
    share, tries = case
    _lose(monkeypatch, share, np.random.default_rng(7))
    for seed in range(tries):
        plugged_in(monkeypatch, **{model: make_rig(model, seed=seed).device for model in TALKING})
        found = await list_lidars()
        told = {each.port.path: each.info.family if each.info else each.error for each in found}
        assert told == {model: model.partition("-")[0] for model in TALKING}
        models = {each.port.path: each.info.model for each in found if each.info}
        assert models["irobotix-delta2g"] == "Delta-2G or LDS08RR"
        assert models["irobotix-delta2a"] == "Delta-2A, 2B or 2D"


def _lose(patch: pytest.MonkeyPatch, share: float, random: np.random.Generator) -> None:
    """Leave out packets on their way into the line."""
    push = TransmitQueue.push

    def some(queue: TransmitQueue, data: bytes, ready: int, *, size: int = 0, period: int = 0) -> None:
        size = size or len(data)
        rows = [data[at : at + size] for at in range(0, len(data), size or 1)]
        for number, row in enumerate(rows):
            if random.random() >= share:
                push(queue, row, ready + number * period, size=len(row), period=period)

    patch.setattr(TransmitQueue, "push", some)


async def test_the_last_one_at_an_adapter_is_tried_first(monkeypatch: pytest.MonkeyPatch, tmp_path: Any) -> None:
    # What is remembered outlives the test, and so its adapter has a name of its own.
    link = tmp_path / f"usb-{tmp_path.name}"
    link.symlink_to(tmp_path / "ttyUSB0")
    monkeypatch.setattr(listening, "BY_ID", tmp_path)
    path = str(tmp_path / "ttyUSB0")
    written = serial_in_memory(monkeypatch, **{path: make_rig("ydlidar-f4").device})
    loop, took = asyncio.get_running_loop(), []
    for _ in range(2):
        written.clear()
        began = loop.time()
        connection = await connect(parse_source(path))
        took.append(loop.time() - began)
        await connection.dialogue.close()
    assert took[1] < 0.2 < took[0]
    assert {speed for speed, _ in written} == {115_200}


def test_nothing_is_remembered_without_a_lasting_name(monkeypatch: pytest.MonkeyPatch, tmp_path: Any) -> None:
    monkeypatch.setattr(listening, "BY_ID", tmp_path / "absent")
    assert listening.adapter_of("/dev/ttyUSB0") is None
    monkeypatch.setattr(listening, "BY_ID", tmp_path)
    assert listening.adapter_of("/dev/ttyUSB0") is None


async def test_one_that_responds_while_others_are_looked_for_by_dtr_is_what_it_says() -> None:
    """A model that needs DTR is only a guess: what responds meanwhile may be another one of its family."""
    device = make_rig("ydlidar-4ros").device
    device.response_delay_s = 0.12
    port = connect_in_memory(device)
    port.baudrate = 0
    received = listening.ReceivedInSilence()
    port.add_tap(received.see)
    connection = await find_by_dtr(Woken(port), [Attempt(family_named("ydlidar"), 0)], received)
    assert connection is not None
    assert connection.info.model == "YDLIDAR 4ROS"
    (mode,) = await connection.dialogue.run(connection.dialogue.device.modes())
    assert mode.response_type == 0x81
    await connection.dialogue.close()


async def test_behind_a_search_by_dtr_that_finds_none_what_dtr_lights_is_dark_again() -> None:
    device = make_rig("ydlidar-x4").device
    device.transmit = lambda now: b""
    port = connect_in_memory(device)
    port.baudrate = 0
    tries = [Attempt(family_named("ydlidar"), 0)]
    assert await find_by_dtr(Woken(port), tries, listening.ReceivedInSilence()) is None
    assert not device.lit
    await port.close()


async def test_one_that_holds_half_a_request_is_asked_until_it_has_forgotten_that() -> None:
    """`Timing.forget_s` tells how long that may take; nothing is known of the device, so each is asked so long."""
    rig, forgets_at = make_rig("rplidar-s2"), now() + 4.5
    hears_only(rig, lambda _: now() >= forgets_at)
    async with open_lidar(rig.device) as lidar:
        assert lidar.info.family == "rplidar"
    assert now() >= forgets_at


async def test_one_whose_response_is_damaged_while_dtr_is_asserted_is_asked_once_more() -> None:
    """It is dark before, so the question that was damaged is the only one that it was asked."""
    damaged = 0
    device = make_rig("ydlidar-x4").device
    send = device.transmit

    def transmit(now: int) -> bytes:
        nonlocal damaged
        data: bytes = send(now)
        if data and not damaged:
            damaged = len(data)
            return data[:-1]
        return data

    device.transmit = transmit
    async with open_lidar(device) as lidar:
        assert lidar.info.model.startswith("YDLIDAR X4")
    assert damaged
