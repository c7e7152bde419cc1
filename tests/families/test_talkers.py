"""The models that only talk are what the protocol sheets say; `docs/devices.md` tells the same lines."""

import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from lidario.basics.model import Health, HealthStatus
from lidario.families.camsense import TALKERS as CAMSENSE
from lidario.families.hlds import TALKERS as HLDS
from lidario.families.hlds.simulated import pack_packet as hlds
from lidario.families.irobotix import TALKERS as IROBOTIX
from lidario.families.irobotix.simulated import pack_failure as irobotix_failure
from lidario.families.irobotix.simulated import pack_measurement as irobotix
from lidario.families.ldrobot import TALKERS as LDROBOT
from lidario.families.neato import TALKERS as NEATO
from lidario.families.neato.simulated import pack_packet as neato
from lidario.families.registry import family_of_simulated
from lidario.families.talking import TalkingDevice, TalkingModel
from lidario.families.ydlidar.models import MODELS as YDLIDAR
from tests.support.scripts import played
from tests.support.streams import in_one_run

DOCS = Path(__file__).parents[2] / "docs/devices.md"
FAMILIES = {"ldrobot": LDROBOT, "hlds": HLDS, "neato": NEATO, "camsense": CAMSENSE, "irobotix": IROBOTIX}
SHEET = {
    # more_families.md B1; more_families_2.md 1.1 and 1.2: baud, samples a second, metres (0 where none is stated).
    "ldrobot": {
        "ld06": (230_400, 4546, 12),
        "ld19": (230_400, 4500, 12),
        "stl-06p": (230_400, 5000, 12),
        "stl-19p": (230_400, 4500, 12),
        "stl-26": (230_400, 5000, 12),
        "stl-27l": (921_600, 21_600, 25),
        "ld14": (115_200, 2300, 8),
        "ld14p": (230_400, 4000, 8),
        "ld08": (115_200, 2300, 8),
    },
    # more_families_2.md 3: one sample a degree, 300 revolutions a minute.
    "neato": {"xv11": (115_200, 1800, 0), "lds02rr": (115_200, 1800, 0), "lds01rr": (115_200, 1800, 9)},
    # 4
    "camsense": {"x1": (115_200, 2080, 8), "lds08rr": (115_200, 2080, 8)},
    # 5
    "irobotix": {
        "delta2a": (230_400, 5000, 8),
        "delta2b": (230_400, 5000, 8),
        "delta2d": (115_200, 2000, 8),
        "delta2g": (115_200, 1890, 8),
        "lds08rr": (115_200, 1890, 8),
    },
}


def facts(model: TalkingModel) -> tuple[int, int, float]:
    """Baud, samples a second, metres."""
    return model.baudrates[0], round(1e6 / model.sample_us), model.reach


@pytest.mark.parametrize("family", SHEET)
def test_each_has_the_line_the_rate_and_the_reach_of_the_sheet(family: str) -> None:
    assert {name: facts(model) for name, model in FAMILIES[family].models.items()} == SHEET[family]


@pytest.mark.parametrize("family", SHEET)
def test_so_has_the_simulated_device_of_each(family: str) -> None:
    for name, (baudrate, rate, metres) in SHEET[family].items():
        model = f"{family}-{name.replace('-', '')}"
        device: Any = family_of_simulated(model).simulate(model, seed=3)
        of = device.profile
        assert (of.baudrate, of.rate) == (baudrate, rate), model
        assert not metres or of.reach_mm[1] == 1000 * metres, model


@pytest.mark.parametrize("family", FAMILIES)
def test_the_stream_of_each_has_the_rate_of_its_mode(family: str) -> None:
    for model in FAMILIES[family].all:
        device = TalkingDevice(FAMILIES[family], model)
        (mode,) = played(device.modes(), lambda _: None)
        assert (mode.sample_us, mode.max_distance) == (model.sample_us, model.reach)
        assert played(device.start(mode), lambda _: b"").sample_ns == 1e3 * model.sample_us


@pytest.mark.parametrize("family", FAMILIES)
def test_one_that_is_not_named_is_read_at_the_line_and_rate_of_one_that_is(family: str) -> None:
    # more_families_2.md 2: an LDS-01 has no other name.
    named = [*SHEET[family].values()] if family in SHEET else [(230_400, 1800, 3.5)]
    # Whatever a Neato or an alike sends.
    others = (
        [NEATO.unnamed(b"", None)]
        if family == "neato"
        else [each for each in FAMILIES[family].all if not each.name]
    )
    assert {facts(model) for model in others} <= set(named)


HEARING = {
    # more_families_2.md 2
    ("hlds", ""): (b"b", b"e", {}),
    # more_families.md B1: 6 Hz are 2160 degrees a second.
    ("ldrobot", "ld14p"): (
        bytes.fromhex("54A004000000005E"),
        bytes.fromhex("54A104000000004A"),
        {6.0: bytes.fromhex("54A20470080000A1")},
    ),
}
"""What starts and stops models, and what sets a speed. All others only talk."""


@pytest.mark.parametrize("family", FAMILIES)
def test_each_that_hears_is_started_stopped_and_turned_as_the_sheet_says(family: str) -> None:
    for model in FAMILIES[family].all:
        start, stop, speeds = HEARING.get((family, model.name), (b"", b"", {}))
        assert (model.start, model.stop) == (start, stop)
        assert (model.speeds is not None) == bool(speeds)
        for hertz, request in speeds.items():
            assert model.speeds is not None
            assert model.speeds.request(round(hertz / model.speeds.step)).data == request


TURNING: dict[str, tuple[int, Callable[[int, float], bytes]]] = {
    "neato": (360, lambda at, hertz: neato(at, [500.0] * 4, [90] * 4, rpm=60 * hertz)),
    "hlds": (360, lambda at, hertz: hlds(at, [500.0] * 6, [900] * 6, rpm=60 * hertz)),
    "irobotix": (480, lambda at, hertz: irobotix(2250 * at, [500.0] * 30, [90] * 30, hertz=hertz)),
}
"""Families whose packets tell the speed: samples of a revolution, and the packet of such a number at a speed."""


@pytest.mark.parametrize("hertz", [0.0, 0.5, 4.0, 5.0])
@pytest.mark.parametrize("family", TURNING)
def test_what_a_sample_takes_follows_from_the_speed_that_packets_tell(family: str, hertz: float) -> None:
    """Nothing where the rotor stands; of each packet then what it takes at the lowest speed that it could tell."""
    (samples, packet), talkers = TURNING[family], FAMILIES[family]
    packets = b"".join(packet(at, hertz) for at in range(12))
    expected_us = 1e6 / (samples * hertz) if hertz else 0.0
    model = talkers.model_of(None, packets)
    assert model.wire.sample_us(packets) == pytest.approx(expected_us, rel=1e-9)
    run = in_one_run(model.wire(), packets)
    assert model.decoder().decode(run, None).sample_ns == pytest.approx(1e3 * expected_us, rel=1e-9)
    told_ns = model.wire().told_sample_ns(run)
    assert told_ns is not None
    least = 0.05 if family == "irobotix" else 1 / 60
    assert told_ns.tolist() == pytest.approx([1e9 / (samples * (hertz or least))] * 12, rel=1e-9)


ROTORS = {
    "neato": (neato(0, [500.0] * 4, [90] * 4, rpm=300), neato(0, [500.0] * 4, [90] * 4, rpm=60)),
    "irobotix": (irobotix(0, [500.0] * 30, [90] * 30, hertz=5.0), irobotix_failure(1.0)),
}
"""Families whose motor the host powers: a packet of one that turns, and of one that hardly does."""


@pytest.mark.parametrize("family", FAMILIES)
def test_whether_the_rotor_turns_is_all_that_they_tell_of_their_health(family: str) -> None:
    """They have no code of it."""
    device, (turns, hardly) = TalkingDevice(FAMILIES[family]), ROTORS.get(family, (b"", b""))
    assert replace(played(device.health(), lambda _: turns), note="") == Health(HealthStatus.OK, 0)
    if family in ROTORS:
        told = played(device.health(), lambda _: hardly)
        assert replace(told, note="") == Health(HealthStatus.WARNING, 0)
        assert " 60 revolutions a minute" in told.note
    assert (FAMILIES[family].rotor is not None) == (family in ROTORS)


SLOWEST_HZ = {
    "neato": {"": 200 / 60},
    "hlds": {"": 200 / 60},
    "irobotix": {"": 4.0},
    # An LD14P can be set to 2; an LD14 and an LD08 are taken for no faster.
    "ldrobot": {"": 5.0, "ld14": 2.0, "ld14p": 2.0, "ld08": 2.0},
}
"""Revolutions a second, of a family and of models that turn slower."""


@pytest.mark.parametrize("family", SLOWEST_HZ)
def test_a_revolution_may_take_half_as_long_again_as_at_the_lowest_speed(family: str) -> None:
    slowest = SLOWEST_HZ[family]
    for model in FAMILIES[family].all:
        expected = 1.5 / slowest.get(model.name, slowest[""])
        assert model.slowest_turn_s == pytest.approx(expected, rel=0.1), model.name


def test_the_page_of_devices_tells_the_same_lines() -> None:
    """Of the models of YDLIDAR too."""
    told: dict[str, set[int]] = {}
    for row in DOCS.read_text(encoding="utf-8").splitlines():
        cells = [cell.strip() for cell in row.split("|")]
        if len(cells) > 4 and re.fullmatch(r"\d{6}(, \d{6})*", cells[3]):
            for name in re.findall(r"`([\w-]+)`", cells[2]):
                told.setdefault(name, set()).update(map(int, cells[3].split(", ")))
    ours = {name: model.baudrate for name, model in YDLIDAR.items() if name in told}
    assert len(ours) == 20
    sheet = [(name, baud) for models in SHEET.values() for name, (baud, _, _) in models.items()]
    assert all(baud in told[name] for name, baud in (*ours.items(), *sheet))
