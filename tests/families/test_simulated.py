"""What simulated devices of all families do alike; what is particular to one stands in the tests of its family."""

from itertools import pairwise
from typing import Any

import numpy as np
import pytest

from lidario.families.registry import family_of_simulated
from tests.families.neato.about import LAYOUTS as READ_FORTH
from tests.support.cases import ALL, Case
from tests.support.samples import SOME_MODELS, every_model
from tests.support.simulated_rplidar import DUTY_660, EXPRESS_1, SCAN
from tests.support.streams import feed, in_one_run

MS = 1_000_000
S = 1000 * MS
BEGIN = 1000 * S
STARTED_BY = {
    "rplidar": SCAN,
    "ydlidar": b"\xa5\x60",
    "hokuyo": b"MD0044072501000\n",
    "rplidar-s2": EXPRESS_1,
    **dict.fromkeys(("rplidar-a2", "rplidar-a3", "rplidar-a2-empty-list"), DUTY_660 + SCAN),
    "hlds-lds01-2016": b"b",
}
"""What begins a stream, of a family or a model; the others stream from the first moment on."""
TALKERS = [model for model in SOME_MODELS if model.partition("-")[0] not in (*STARTED_BY, "hlds")]
"""Those that hear nothing that would stop them."""


def made(model: str, *, spin_up_s: float = 0.0) -> Any:
    device: Any = family_of_simulated(model).simulate(model, seed=3)
    device.spin_up_s = spin_up_s
    device.transmit(BEGIN)
    device.receive(STARTED_BY.get(model, STARTED_BY.get(model.partition("-")[0], b"")), BEGIN)
    return device


@every_model()
@pytest.mark.parametrize("spin_up_s", [0.0, 0.3])
def test_bytes_do_not_depend_on_the_steps_of_time(model: str, spin_up_s: float) -> None:
    """Nor is anything missed by who looks only when it is told to."""
    end = BEGIN + S // 2
    whole = made(model, spin_up_s=spin_up_s).transmit(end)
    assert len(whole) > 1000
    for step in (237_000, 7 * MS + 1, 333 * MS):
        device, times = made(model, spin_up_s=spin_up_s), [*range(BEGIN, end, step), end]
        assert b"".join(map(device.transmit, times)) == whole
    device, now, data = made(model, spin_up_s=spin_up_s), BEGIN, b""
    while (due := device.wakeup(now)) <= end:
        now = max(due, now + 1)
        data += device.transmit(now)
    assert data + device.transmit(end) == whole


REFERENCES = {
    "camsense_x1_5hz": ["camsense-x1"],
    "hlds_lds01_5hz": ["hlds-lds01"],
    "irobotix_2a_6hz": ["irobotix-delta2a", "irobotix-delta2b", "irobotix-delta2d"],
    "irobotix_2g_5hz": ["irobotix-delta2g", "irobotix-lds08rr"],
    "ldrobot_ld08_5hz": ["ldrobot-ld08"],
    "ldrobot_ld14p_6hz": ["ldrobot-ld14", "ldrobot-ld14p"],
    "ldrobot_ld19_6hz": [f"ldrobot-{name}" for name in ("ld06", "ld19", "stl06p", "stl19p", "stl26", "stl27l")],
    "neato_xv11_5hz": ["neato-xv11"],
}
"""The stream of which the packets are, for some models; the scalar reference of that one judges them."""
JUDGED = [
    *((model, case) for case in ALL for model in REFERENCES.get(case.name, ())),
    *((model, case) for case in READ_FORTH for model in ("neato-lds02rr", "neato-lds01rr")),
]


@pytest.mark.exhaustive(("model", "case"), sample=JUDGED)
def test_it_streams_from_the_first_moment_on_what_the_world_holds(model: str, case: Case) -> None:
    device = made(model)
    assert (device.scanning, device.motor_on) == (True, True)
    heard = feed(case, device.transmit(BEGIN + S))
    # The packet under way when it was first heard.
    assert heard.stats.skipped_bytes < 2 * case.make_format().longest
    packets = case.split(heard.data)
    samples = case.decode(packets)
    assert len(samples) == pytest.approx(device.profile.rate, rel=0.006, abs=2 * len(samples) / len(packets))
    assert case.make_decoder().decode(in_one_run(case.make_format(), heard.data), None).lost == 0
    passed = sum(b.raw_deg % 360 < a.raw_deg % 360 - 180 for a, b in pairwise(samples))
    assert passed == pytest.approx(device.profile.hertz, abs=1)
    angles = np.array([sample.angle_deg for sample in samples])
    distances = np.array([sample.distance_mm for sample in samples])
    assert (distances > 0).mean() > 0.5
    seen = device.world.ranges_mm(angles, np.full(len(angles), BEGIN * 1e-9))
    # The wall of the room is seen within noise, but for beams along its edges and the person who walks.
    assert np.median(np.abs(seen - distances)[distances > 0]) < 40


@pytest.mark.parametrize(
    "model", ["neato-xv11", "neato-lds02rr", "hlds-lds01", "irobotix-delta2a", "hokuyo-urg04lx"]
)
def test_samples_of_a_packet_are_measured_one_after_the_other(model: str) -> None:
    class Watched:
        """A wall all around, and when which beam met it."""

        def __init__(self) -> None:
            self.beams = list[float]()
            self.seconds = list[float]()

        def ranges_mm(self, angles_deg: Any, seconds: Any) -> Any:
            self.beams += angles_deg.tolist()
            self.seconds += seconds.tolist()
            return np.full(len(angles_deg), 1000.0)

    device = made(model)
    device.world = world = Watched()
    assert device.transmit(BEGIN + S)
    is_hokuyo, turned = model.startswith("hokuyo"), np.diff(world.beams) % 360.0
    if is_hokuyo or device.profile.back:
        turned = 360.0 - turned
    # From sample to sample it turns by a degree or so, also from one packet to the next; but a Hokuyo sees no more
    # than its field.
    assert (turned < 2.0).all() or is_hokuyo
    hertz = device.profile.rpm / 60 if is_hokuyo else device.profile.hertz
    assert np.diff(world.seconds) == pytest.approx(turned / (360.0 * hertz), abs=2e-9)


@pytest.mark.exhaustive("model", sample=TALKERS)
def test_one_without_a_line_for_requests_sees_none(model: str) -> None:
    deaf, asked = made(model), made(model)
    if not deaf.profile.commands:
        asked.receive(b"\x1b" * 3 + bytes.fromhex("54A104000000004A"), BEGIN)
    assert asked.transmit(BEGIN + S) == deaf.transmit(BEGIN + S)
    assert asked.log == []


@pytest.mark.exhaustive("model", sample=TALKERS)
@pytest.mark.parametrize("blocked", [False, True])
def test_without_power_frozen_or_blocked_a_talker_is_silent(model: str, blocked: bool) -> None:
    """Until it has booted again."""
    device = made(model)
    device.reboot(BEGIN + S)
    device.transmit(BEGIN + S)
    assert device.transmit(BEGIN + S + S // 3) == b""
    assert len(device.transmit(BEGIN + 3 * S)) > 4000
    if blocked:
        device.protection_stop(1)
    else:
        device.freeze(BEGIN + 3 * S)
    device.transmit(BEGIN + 3 * S + S // 10)
    assert device.transmit(BEGIN + 4 * S) == b""
    device.reboot(BEGIN + 4 * S)
    assert len(device.transmit(BEGIN + 6 * S)) > 4000


@pytest.mark.parametrize("model", ["neato-xv11", "irobotix-delta2a", "hlds-lds01"])
@pytest.mark.parametrize("spin_up_s", [0.3, 3.0])
def test_a_rotor_that_stood_sends_again_when_its_motor_is_powered(model: str, spin_up_s: float) -> None:
    device = made(model, spin_up_s=spin_up_s)
    device.power_motor(0.0, BEGIN)
    device.transmit(BEGIN + 30 * S)
    device.power_motor(300.0, BEGIN + 30 * S)
    device.transmit(BEGIN + 34 * S)
    assert len(device.transmit(BEGIN + 35 * S)) > 8000


@pytest.mark.parametrize(
    ("model", "told"),
    [("neato-xv11", b"\x52\x80\x14\x00" * 4), ("irobotix-delta2a", b"\x61\xae"), ("hlds-lds01", b"")],
)
def test_what_tells_that_its_rotor_is_too_slow_does_so_while_that_speeds_up(model: str, told: bytes) -> None:
    """So AE frames of a Delta come (more_families_2.md 5.3); of an LDS-01 no document tells what it sends then."""
    device = made(model, spin_up_s=2.0)
    device.reboot(BEGIN, off_s=10.0)
    device.transmit(BEGIN + 10 * S + S // 2)
    early = device.transmit(BEGIN + 11 * S)
    assert told in early
    assert bool(early) == bool(told)
    assert len(device.transmit(BEGIN + 14 * S)) > 8000
