"""Streams of real devices, and some like them: whole, in pieces, with packets that are missing or come twice.

A real device's stream is others' data: it is tried where it lies beside the project.
"""

from collections.abc import Iterable
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

import lidario
from lidario.families.ldrobot import TALKERS
from lidario.families.ldrobot.formats import PacketFormat
from lidario.recording.offline import BLOCK, OfflineDecoder
from lidario.wire.blocks import packet_offsets
from lidario.wire.events import Packets
from lidario.wire.link import Link
from tests.reference import golden

SHARED = Path(__file__).parents[3] / "shared" / "golden"
HERE = [golden.DATA / f"{name}.npz" for name in ("ydlidar_tmini_10hz", "ldrobot_ld19_13hz", "ldrobot_ld08_5hz")]
REAL = [SHARED / "real_ydlidar_tmini_plus.npz", SHARED / "ldrobot_ld06_real.npz"]
PATHS = [*HERE, *(path for path in REAL if path.exists())]
RATES = {"ldrobot_ld19_13hz": 4500, "ldrobot_ld06_real": 4546}
"""Samples a second."""
streams = pytest.mark.exhaustive("path", sample=PATHS)


def raw_of(path: Path) -> bytes:
    with np.load(path) as arrays:
        return bytes(arrays["raw"].tobytes())


def packets_of(raw: bytes) -> list[bytes]:
    decoder, link = OfflineDecoder(raw), Link(BLOCK)
    link.enter_stream(decoder.stream.format)
    link.receive_data(raw[decoder.begin :], 0)
    found = []
    for event in link.events_received():
        if isinstance(event, Packets):
            offsets = packet_offsets(event.blocks)
            found += [event.data[begin:end] for begin, end in pairwise(offsets)]
    return found


def points(scans: Iterable[lidario.Scan]) -> list[tuple[float, float]]:
    return [
        pair
        for scan in scans
        for pair in zip(scan.device_angles.tolist(), scan.device_distances.tolist(), strict=True)
    ]


@streams
def test_its_samples_are_the_vendors(path: Path) -> None:
    with np.load(path) as arrays:
        truth = {name: arrays[name] for name in ("angle_deg", "distance_mm", "intensity", "scan")}
    model = "ld08" if "ld08" in path.stem else None
    scans = list(lidario.decode(raw_of(path), model=model))
    first = int(np.flatnonzero(truth["scan"] == max(0, truth["scan"].min()))[0])
    assert len(scans) >= 8
    angles = np.concatenate([scan.device_angles for scan in scans]).astype(float)
    distances = np.concatenate([scan.device_distances for scan in scans])
    # The vendor may count the part before the first seam as a scan; whole ones follow each other.
    starts = [
        at for at in range(first, first + 2000) if (truth["distance_mm"][at : at + 200] == distances[:200]).all()
    ]
    at = starts[0]
    np.testing.assert_array_equal(distances, truth["distance_mm"][at : at + len(distances)])
    strengths = np.concatenate([scan.intensities for scan in scans if scan.intensities is not None])
    np.testing.assert_array_equal(strengths, truth["intensity"][at : at + len(strengths)])
    assert len(strengths) == len(distances)
    off = (angles - truth["angle_deg"][at : at + len(angles)] + 180) % 360 - 180
    assert np.abs(off).max() <= golden.GRID_Q6


@streams
@pytest.mark.parametrize("gone", [(5, 17), (3, 4), range(50, 10_000, 100)], ids=["two", "neighbours", "1 %"])
def test_no_sample_moves_where_packets_are_missing(path: Path, gone: Iterable[int]) -> None:
    packets, gone = packets_of(raw_of(path)), set(gone)
    whole = list(lidario.decode(b"".join(packets)))
    there = set(points(whole))
    scans = list(lidario.decode(b"".join(each for number, each in enumerate(packets) if number not in gone)))
    kept = points(scans)
    assert set(kept) <= there
    assert len(kept) >= 0.9 * len(there)
    # A real one has gaps of its own.
    lost, own = (sum(scan.lost_packets for scan in each) for each in (scans, whole))
    assert lost <= own + sum(number < len(packets) for number in gone)


@pytest.mark.parametrize("path", [path for path in PATHS if path.stem in RATES], ids=lambda path: path.stem)
def test_the_packets_that_are_heard_tell_what_a_sample_takes(path: Path) -> None:
    """To half a percent, wherever in the revolution they begin: a real rotor is faster at some places of it."""
    packets = packets_of(raw_of(path))
    for begin in range(len(packets) - TALKERS.heard):
        heard = b"".join(packets[begin : begin + TALKERS.heard])
        assert PacketFormat.samples_a_second(heard) == pytest.approx(RATES[path.stem], rel=0.005)
