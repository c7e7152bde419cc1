"""The simulated devices: what they say of themselves, and what becomes of a motor that nobody powers."""

from functools import partial
from itertools import pairwise

import pytest

from lidario.families.neato.simulated import make_simulated
from tests.reference import neato, samples

S = 1_000_000_000
BEGIN = 1000 * S
whole = partial(samples.whole, size=neato.PACKET_BYTES, is_packet=neato.is_packet)


def test_it_tells_what_it_is_when_it_has_booted() -> None:
    device = make_simulated("neato-xv11")
    device.transmit(BEGIN)
    device.reboot(BEGIN + S)
    device.transmit(BEGIN + S)
    assert device.transmit(BEGIN + 3 * S).startswith(b"Piccolo")


@pytest.mark.long
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
