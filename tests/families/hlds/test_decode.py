"""The golden stream through the whole path, and a device whose check value nobody knows."""

import numpy as np
import pytest

import lidario
from tests.families.hlds.about import CASES
from tests.reference import golden

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
