"""The golden stream through the whole path, and a device whose check value nobody knows."""

from __future__ import annotations

import numpy as np
import pytest

import lidario
from lidario.families.hlds.decode import PacketDecoder
from lidario.families.hlds.formats import PacketFormat
from lidario.families.hlds.simulated.device import pack_packet
from tests.families.hlds.about import CASES
from tests.reference import golden, hlds
from tests.support.streams import in_one_run

PACKETS = CASES[0].packets
TRUTH = golden.load("hlds_lds01_5hz")


def without_check(packets: tuple[bytes, ...]) -> bytes:
    """As a device sends them that computes something else."""
    return b"".join(packet[:40] + bytes((packet[5] ^ 0x35, packet[9])) for packet in packets)


def test_turns_are_those_of_the_vendors_driver_whatever_the_check_value() -> None:
    scans = list(lidario.decode(without_check(PACKETS)))
    assert TRUTH.scan is not None
    assert len(scans) == int(TRUTH.scan.max()) - 1
    for number, scan in enumerate(scans, 1):
        inside = number == TRUTH.scan
        np.testing.assert_array_equal(scan.device_angles, TRUTH.angle_deg[inside])
        np.testing.assert_array_equal(scan.device_distances, TRUTH.distance_mm[inside])
        assert scan.lost_packets == 0
        assert scan.time_increment_ns == pytest.approx(60e9 / (scan.reported_rpm * 360), abs=1)


def test_a_lost_byte_costs_one_packet() -> None:
    raw = without_check(PACKETS)
    scans = list(lidario.decode(raw[:20_000] + raw[20_001:]))
    assert [scan.lost_packets for scan in scans if scan.lost_packets] == [1]
    assert sum(map(len, scans)) == 360 * len(scans) - 6


def test_what_is_reserved_changes_nothing() -> None:
    packets = [pack_packet(at, [500.0] * 6, [8190] * 6, reserved=0xFFFF) for at in range(60)]
    samples = PacketDecoder(PacketFormat).decode(in_one_run(PacketFormat(), b"".join([*packets, packets[0]])), None)
    assert set(samples.distance_mm.tolist()) == {500.0}
    assert samples.intensity is not None
    assert set(samples.intensity.tolist()) == {255}
    assert samples.angle_deg.tolist()[:360] == list(range(360))
    assert hlds.decode(packets)[7].angle_deg == 7.0
