"""Golden streams and the recording of a real XV-11, each sample; what is lost and what only turns too slowly."""

from pathlib import Path

import numpy as np
import pytest

import lidario
from lidario.families.neato.formats import BackFormat, PacketFormat
from lidario.families.neato.simulated import pack_packet
from lidario.families.slots import DegreeDecoder
from tests.families.neato.about import CASES
from tests.reference import golden, neato
from tests.reference.samples import fold
from tests.support.streams import feed, in_one_run

REAL = Path(__file__).parents[4] / "shared" / "golden" / "real_xv11.npz"
"""A recording of a real XV-11 by somebody else: read where it lies beside the project, and never copied."""
STREAMS = [golden.DATA / "neato_xv11_5hz.npz", *([REAL] if REAL.exists() else [])]
GREETING = b"Piccolo Laser Distance Scanner\r\nLoader\tV2.4.13386\r\n#"
streams = pytest.mark.parametrize("path", STREAMS, ids=lambda path: path.stem)


@pytest.mark.long
@streams
@pytest.mark.parametrize("chunk", [None, 1, 100])
def test_each_sample_is_that_of_the_other_parser(path: Path, chunk: int | None) -> None:
    with np.load(path) as arrays:
        truth = {name: arrays[name] for name in ("raw", "angle_deg", "distance_mm", "intensity")}
    raw = truth["raw"].tobytes()
    received = feed(CASES[0], raw, chunk)
    samples = DegreeDecoder(BackFormat).decode(in_one_run(BackFormat(), received.data), None)
    np.testing.assert_array_equal(samples.distance_mm, truth["distance_mm"])
    np.testing.assert_array_equal(samples.angle_deg, truth["angle_deg"])
    np.testing.assert_array_equal(samples.intensity, np.minimum(truth["intensity"] >> 3, 255))
    assert samples.lost == 0
    assert received.stats.packets == len(truth["angle_deg"]) // 4


@pytest.mark.long
@streams
def test_the_speed_that_packets_tell_dates_the_samples(path: Path) -> None:
    with np.load(path) as arrays:
        raw, speeds, turns = arrays["raw"].tobytes(), arrays["speed_raw"], int(arrays["scan"].max())
    scans = list(lidario.decode(raw))
    # The first turn and the last one are partial.
    assert len(scans) == turns - 1
    assert all(len(scan) == 360 and not scan.lost_packets for scan in scans)
    for scan in scans:
        assert speeds.min() / 64 < scan.reported_rpm < speeds.max() / 64
        assert scan.time_increment_ns == pytest.approx(60e9 / (scan.reported_rpm * 360), abs=1)


def test_weak_returns_are_delivered_and_codes_are_none() -> None:
    packet = bytearray(pack_packet(3, [500.0] * 4, [80] * 4))
    packet[5] |= 0x40
    packet[8:10] = b"\x21\x80"
    packet[20:] = fold(bytes(packet[:20])).to_bytes(2, "little")
    samples = DegreeDecoder(BackFormat).decode(in_one_run(BackFormat(), bytes(packet)), None)
    assert samples.distance_mm.tolist() == [500, 0, 500, 500]
    assert samples.angle_deg.tolist() == [348, 347, 346, 345]


def test_the_wikis_example() -> None:
    packet = bytes.fromhex("FAEE384AE4011301DA012A01258000 00C8013601E93A".replace(" ", ""))
    assert neato.is_packet(packet)
    samples = DegreeDecoder(PacketFormat).decode(in_one_run(PacketFormat(), packet), None)
    assert samples.angle_deg.tolist() == [312, 313, 314, 315]
    assert samples.distance_mm.tolist() == [484, 474, 0, 456]
    assert samples.last.reported_rpm == 296.875


def run_down() -> bytes:
    """A motor that is stopped, as a real one did: packets at 276 to 199 rpm, then two a revolution, then text."""
    healthy = b"".join(CASES[0].packets[: 90 * 4])
    falling = b"".join(
        pack_packet(index % 90, [800.0] * 4, [100] * 4, rpm=276 - index / 4) for index in range(0, 300, 3)
    )
    creeping = b"".join(
        pack_packet(45 * (turn % 2) + turn % 3 // 2, [0] * 4, [20] * 4, rpm=max(49.8, 199 - turn), code=0x52)
        for turn in range(400)
    )
    return healthy + falling + creeping + GREETING


@pytest.mark.parametrize("chunk", [None, 1, 64])
def test_a_motor_that_stops_makes_no_scans_and_loses_no_packets(chunk: int | None) -> None:
    raw = run_down()
    received = feed(CASES[0], raw, chunk)
    slow = sum(packet[2] + 256 * packet[3] < 200 * 64 for packet in neato.split(raw[: -len(GREETING)]))
    assert slow == 400
    assert (received.stats.packets, received.stats.records) == (90 * 4 + 100, 400)
    assert len(received.data) == received.stats.packets * PacketFormat().shortest
    # A last byte may begin another packet.
    assert len(GREETING) - 22 <= received.stats.skipped_bytes <= len(GREETING)
    scans = list(lidario.decode(raw, model="xv11"))
    whole = [scan for scan in scans if len(scan) == 360]
    assert len(whole) == 3
    assert all(scan.lost_packets <= 61 for scan in scans)
    assert len(scans) <= 7
