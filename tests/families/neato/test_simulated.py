"""The simulated devices: what they send, and what becomes of a motor that nobody powers."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest

from lidario.families.neato.simulated.device import PROFILES, make_simulated
from tests.reference import neato

S = 1_000_000_000
BEGIN = 1000 * S


def whole(data: bytes) -> list[bytes]:
    """The packets in what was heard from anywhere on."""
    at = next(at for at in range(len(data)) if neato.is_packet(data[at : at + 22]))
    return neato.split(data[at : at + (len(data) - at) // 22 * 22])


@pytest.mark.parametrize("model", PROFILES)
def test_it_streams_from_the_first_moment_on(model: str) -> None:
    device = make_simulated(model)
    device.transmit(BEGIN)
    packets = whole(device.transmit(BEGIN + S))
    assert len(packets) == pytest.approx(450, abs=2)
    assert all((b[1] - a[1]) % 90 == 1 for a, b in pairwise(packets))
    assert {int.from_bytes(packet[2:4], "little") for packet in packets} == {300 * 64}
    assert device.scanning
    assert device.motor_on


@pytest.mark.parametrize("model", PROFILES)
def test_what_it_sends_is_what_the_world_holds(model: str) -> None:
    device = make_simulated(model)
    device.transmit(BEGIN)
    samples = neato.decode(whole(device.transmit(BEGIN + S)), back=PROFILES[model].back)[:360]
    angles = np.array([sample.angle_deg for sample in samples])
    distances = np.array([sample.distance_mm for sample in samples])
    near = np.abs(device.world.ranges_mm(angles, np.full(len(angles), BEGIN * 1e-9)) - distances)[distances > 0]
    assert np.median(near) < 40


def test_bytes_do_not_depend_on_the_steps_of_time() -> None:
    one, other = make_simulated("neato-xv11", seed=3), make_simulated("neato-xv11", seed=3)
    one.transmit(BEGIN)
    other.transmit(BEGIN)
    in_steps = b"".join(other.transmit(BEGIN + step * S // 100) for step in range(1, 101))
    assert one.transmit(BEGIN + S) == in_steps


def test_it_hears_nothing() -> None:
    device = make_simulated("neato-xv11")
    device.receive(b"\x1b" * 3, BEGIN)
    device.transmit(BEGIN)
    assert len(whole(device.transmit(BEGIN + S))) > 440
    assert device.log == []


@pytest.mark.parametrize("blocked", [False, True])
def test_power_frozen_and_blocked(blocked: bool) -> None:
    device = make_simulated("neato-xv11")
    device.transmit(BEGIN)
    device.reboot(BEGIN + S)
    device.transmit(BEGIN + S)
    assert device.transmit(BEGIN + S + S // 3) == b""
    data = device.transmit(BEGIN + 3 * S)
    assert data.startswith(b"Piccolo")
    assert len(whole(data)) > 100
    if blocked:
        device.protection_stop(1)
    else:
        device.freeze(BEGIN + 3 * S)
    device.transmit(BEGIN + 3 * S + S // 10)
    assert device.transmit(BEGIN + 4 * S) == b""
    device.reboot(BEGIN + 4 * S)
    assert len(whole(device.transmit(BEGIN + 6 * S))) > 100


def test_below_200_rpm_two_packets_a_revolution_tell_that() -> None:
    device = make_simulated("neato-xv11")
    device.transmit(BEGIN)
    device.power_motor(60.0, BEGIN + S)
    device.transmit(BEGIN + 4 * S)
    packets = whole(device.transmit(BEGIN + 9 * S))
    assert len(packets) == pytest.approx(10, abs=1)
    assert all((b[1] - a[1]) % 90 == 45 for a, b in pairwise(packets))
    assert {packet[4:6] for packet in packets} == {b"\x52\x80"}
    device.power_motor(300.0, BEGIN + 9 * S)
    device.transmit(BEGIN + 11 * S)
    assert len(whole(device.transmit(BEGIN + 12 * S))) > 440
    device.power_motor(0.0, BEGIN + 12 * S)
    device.transmit(BEGIN + 16 * S)
    assert device.transmit(BEGIN + 20 * S) == b""
    assert device.wakeup(BEGIN + 20 * S) is None
