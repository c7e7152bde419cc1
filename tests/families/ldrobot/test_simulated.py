"""The simulated LDROBOT lidars: what they send, and what the one that hears obeys."""

from __future__ import annotations

from itertools import pairwise
from typing import Literal

import numpy as np
import pytest

from lidario.families.ldrobot.simulated.device import PROFILES, make_simulated
from tests.reference import ldrobot

S = 1_000_000_000
BEGIN = 1000 * S
START, STOP = bytes.fromhex("54A004000000005E"), bytes.fromhex("54A104000000004A")
SIX_HERTZ = bytes.fromhex("54A20470080000A1")


def whole(data: bytes) -> list[bytes]:
    """The packets in what was heard from anywhere on."""
    at = next(at for at in range(len(data)) if ldrobot.crc8(data[at : at + 47]) == 0 and data[at] == 0x54)
    return ldrobot.split(data[at : at + (len(data) - at) // 47 * 47])


@pytest.mark.parametrize("model", PROFILES)
def test_it_streams_from_the_first_moment_on(model: str) -> None:
    device, profile = make_simulated(model), PROFILES[model]
    device.transmit(BEGIN)
    packets = whole(device.transmit(BEGIN + S))
    assert len(packets) == pytest.approx(profile.rate / 12, rel=0.01)
    samples = ldrobot.decode(packets)
    turned = sum(b.raw_deg % 360 < a.raw_deg % 360 - 180 for a, b in pairwise(samples))
    assert turned == pytest.approx(profile.hertz, abs=1)
    times = [int.from_bytes(packet[44:46], "little") for packet in packets]
    assert all((b - a) % 30_000 <= 6 for a, b in pairwise(times))
    assert device.scanning
    assert device.motor_on


def test_bytes_do_not_depend_on_the_steps_of_time() -> None:
    one, other = make_simulated("ldrobot-ld06", seed=3), make_simulated("ldrobot-ld06", seed=3)
    one.transmit(BEGIN)
    other.transmit(BEGIN)
    in_steps = b"".join(other.transmit(BEGIN + step * S // 100) for step in range(1, 101))
    assert one.transmit(BEGIN + S) == in_steps


def test_a_model_without_a_line_for_requests_sees_none() -> None:
    device = make_simulated("ldrobot-ld06")
    device.receive(STOP, BEGIN)
    assert (device.log, device.scanning) == ([], True)
    device.transmit(BEGIN)
    assert len(whole(device.transmit(BEGIN + S))) > 370


def test_the_one_with_requests_obeys_them() -> None:
    device = make_simulated("ldrobot-ld14p")
    device.receive(STOP, BEGIN)
    device.transmit(BEGIN + S)
    assert (device.scanning, device.motor_on) == (False, False)
    assert device.transmit(BEGIN + 3 * S) == b""
    assert device.wakeup(BEGIN + 3 * S) is None
    device.receive(SIX_HERTZ + START, BEGIN + 3 * S)
    assert device.scanning
    packets = device.transmit(BEGIN + 6 * S)
    assert packets.startswith(bytes.fromhex("54A204"))
    assert [each.name for each in device.log] == ["stop", "set_speed", "start"]
    assert all(each.obeyed for each in device.log)


@pytest.mark.discards("a request with a wrong check value")
def test_a_wrong_check_value_is_discarded() -> None:
    device = make_simulated("ldrobot-ld14p")
    device.receive(STOP[:-1] + b"\0", BEGIN)
    assert [(each.name, each.why) for each in device.log] == [("stop", "wrong check value")]
    assert device.scanning


@pytest.mark.parametrize("blocked", [False, True])
def test_power_frozen_and_blocked(blocked: bool) -> None:
    device = make_simulated("ldrobot-ld19")
    device.transmit(BEGIN)
    device.reboot(BEGIN + S)
    device.transmit(BEGIN + S)
    assert device.transmit(BEGIN + S + S // 3) == b""
    assert len(whole(device.transmit(BEGIN + 3 * S))) > 100
    if blocked:
        device.protection_stop(1)
    else:
        device.freeze(BEGIN + 3 * S)
    device.transmit(BEGIN + 3 * S + S // 10)
    assert device.transmit(BEGIN + 4 * S) == b""
    device.reboot(BEGIN + 4 * S)
    assert len(whole(device.transmit(BEGIN + 6 * S))) > 100


@pytest.mark.parametrize(
    ("model", "lens"), [("ldrobot-ld06", ""), ("ldrobot-ld14", "ld14"), ("ldrobot-ld08", "ld08")]
)
def test_what_it_sends_is_what_the_world_holds(model: str, lens: Literal["", "ld08", "ld14"]) -> None:
    device = make_simulated(model)
    device.transmit(BEGIN)
    samples = ldrobot.decode(whole(device.transmit(BEGIN + S)), lens=lens)[:400]
    angles = np.array([sample.angle_deg for sample in samples])
    distances = np.array([sample.distance_mm for sample in samples])
    seconds = np.full(len(angles), BEGIN * 1e-9)
    near = np.abs(device.world.ranges_mm(angles, seconds) - distances)[distances > 0]
    # The wall of the room is seen within noise, but for beams along its edges and the person who walks.
    assert np.median(near) < 40
