"""The vendors' own decoding of all streams, and a scalar decoder written from the protocol sheet.

The vendors truncate angles: RPLIDAR's SDK to 1/64 degrees and again to 90/16384, the 4ROS's to 1/64. The
second truncation can be undone; so angles are compared on the grid of 1/64, where one step of difference is
left to the rounding of the step between samples.
"""

from collections import Counter

import numpy as np
import pytest
from numpy.typing import NDArray

from tests.support.cases import ALL, Case, named
from tests.support.streams import SINGLE_DEG, assembled, feed, in_one_run

Q6_TURN = 360 * 64
SHORT = ("rplidar_9k_81", "rplidar_9k_83", "rplidar_9k_84", "ydlidar_4ros_wrap", "ldrobot_ld19_13hz")
SMALL = [case for case in ALL if case.name in SHORT]
"""One stream of each parser."""
CHUNKS = {"whole": None, "byte by byte": 1, "in 64s": 64}

every_case = pytest.mark.parametrize("case", ALL, ids=named)
SOME_OR_ALL = pytest.mark.exhaustive(
    "how",
    # Byte by byte takes ten times as long as all the others, and each parser goes through it once.
    sample=[(case, chunks) for case in ALL for chunks in CHUNKS.values() if chunks == 64 or case in SMALL],
    full=[(case, chunks) for case in ALL for chunks in CHUNKS.values()],
)


def off_deg(angle: NDArray[np.floating], case: Case) -> NDArray[np.float64]:
    """How far our angles lie past the vendor's, the short way round."""
    found: NDArray[np.float64] = (angle.astype(np.float64) - case.truth.angle_deg + 180) % 360 - 180
    return found


def golden_q6(case: Case) -> NDArray[np.int64]:
    """The vendor's angles before its second truncation."""
    degrees = case.truth.angle_deg.astype(np.float64)
    if case.truth.family == "ydlidar":
        return np.rint(degrees * 64).astype(np.int64)
    q14 = np.rint(degrees * (16384 / 90)).astype(np.int64)
    return -(-q14 * 90 // 256)


@every_case
def test_distances_are_the_vendors_and_angles_within_a_64th(case: Case) -> None:
    truth = case.truth
    samples = case.make_decoder().decode(in_one_run(case.make_format(), feed(case, case.raw).data), None)
    count = len(truth.distance_mm)
    assert count > 3_000
    np.testing.assert_array_equal(samples.distance_mm[:count], truth.distance_mm)
    angle = samples.angle_deg[:count]
    if case.exact:
        # The vendor's angles where nothing came back are those of the beam.
        assert np.abs(off_deg(angle, case)[truth.distance_mm > 0]).max() <= 1e-4
        return
    if truth.sample_us is not None and truth.family == "ydlidar":
        # Truncated, in both directions where the vendor's sum of beam and correction was negative.
        cut = off_deg(angle, case)
        assert -0.0079 <= cut.min() <= cut.max() <= 0.0157
        assert np.count_nonzero(cut < -1e-4) < 0.03 * count
        return
    if case.response_type == 0x83:
        np.testing.assert_array_equal(angle, truth.angle_deg)
        return
    off = (np.floor(angle * 64).astype(np.int64) - golden_q6(case) + Q6_TURN // 2) % Q6_TURN - Q6_TURN // 2
    # Only a step between samples can be rounded differently: a node states its angle itself.
    allowed = 0 if case.response_type == 0x81 and truth.family == "rplidar" else 1
    assert 0 <= off.min() <= off.max() <= allowed


@pytest.mark.long
@every_case
def test_every_figure_is_the_scalar_references(case: Case) -> None:
    samples = case.make_decoder().decode(in_one_run(case.make_format(), feed(case, case.raw).data), None)
    reference = case.samples
    assert list(samples.ends) == np.cumsum(_counts(case)).tolist()
    assert (samples.lost, samples.unbroken) == (0, len(case.packets))
    # The last capsule has no successor to tell how far the rotor turned meanwhile.
    count = len(reference)
    assert count == (samples.ends[-2] if case.lookahead else samples.ends[-1])
    np.testing.assert_array_equal(samples.distance_mm[:count], [s.distance_mm for s in reference])
    # The vendor's near-range correction of 0x84 is truncated to 1/65536 degrees, and so is the reference's.
    allowed = SINGLE_DEG + 1 / 65536 if case.response_type == 0x84 else SINGLE_DEG
    np.testing.assert_allclose(samples.angle_deg[:count], [s.angle_deg for s in reference], rtol=0, atol=allowed)
    found = None if samples.intensity is None else samples.intensity[:count].tolist()
    assert found == case.intensities(reference)
    if found is not None:
        assert case.truth.quality is not None
        # Ten bits have no room in eight.
        shift = max(0, case.intensity_bits - 8)
        assert found[: len(case.truth.quality)] == (case.truth.quality.astype(np.int64) >> shift).tolist()


@SOME_OR_ALL
def test_the_events_are_one_descriptor_and_one_run(how: tuple[Case, int | None]) -> None:
    case, chunks = how
    received = feed(case, case.raw, chunks)
    assert received.events == [in_one_run(case.make_format(), case.raw)]
    assert (received.stats.packets, received.buffered) == (len(case.packets), 0)
    assert received.stats.bytes_received == len(case.descriptor) + len(case.raw)
    assert received.stats.skipped_bytes == received.stats.stray_bytes == 0


@pytest.mark.long
@SOME_OR_ALL
def test_the_scans_are_the_scalar_references_turns(how: tuple[Case, int | None]) -> None:
    case, chunks = how
    scans, stats, _ = assembled(case, case.raw, chunks)
    assert len(scans) == len(case.turns) >= 2
    assert (stats.scans, stats.broken_scans, stats.lost_packets) == (len(scans), 0, 0)
    for number, (scan, turn) in enumerate(zip(scans, case.turns, strict=True)):
        assert (len(scan), scan.seq, scan.lost_packets) == (len(turn), number, 0)
        np.testing.assert_array_equal(scan.device_distances, [s.distance_mm for s in turn])
        angles = np.array([s.angle_deg for s in turn], np.float32)
        off = (scan.device_angles.astype(np.float64) - angles + 180) % 360 - 180
        assert np.abs(off).max() <= 4e-5  # single precision
        assert (None if scan.intensities is None else scan.intensities.tolist()) == case.intensities(turn)


def _counts(case: Case) -> list[int]:
    """How many samples each packet has; the last one that waits for its successor has as many as the one before."""
    counts = Counter(sample.packet for sample in case.samples)
    last = max(counts)
    return [counts[min(number, last)] for number in range(len(case.packets))]
