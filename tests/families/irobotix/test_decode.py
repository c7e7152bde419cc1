"""What the golden streams tell of themselves; a Delta-2D; how many frames a revolution has."""

import numpy as np
import pytest

import lidario
from lidario.families.irobotix import TALKERS
from lidario.families.irobotix.decode import FrameDecoder, frames_a_turn
from lidario.families.irobotix.formats import FifteenFormat, FrameFormat
from lidario.families.irobotix.simulated import pack_failure, pack_frame, pack_measurement
from lidario.families.stream import Known
from tests.families.irobotix.about import CASES
from tests.reference import irobotix
from tests.support.case import Case
from tests.support.cases import named
from tests.support.kept import arrivals
from tests.support.streams import assembled, in_one_run

every_case = pytest.mark.parametrize("case", CASES, ids=named)


def test_one_model_has_two_speeds() -> None:
    """more_families_2.md 5.1; the first speed of each is told of by `tests/families/test_talkers.py`."""
    assert [model.name for model in TALKERS.all if len(model.baudrates) > 1] == ["delta2a"]
    assert TALKERS.models["delta2a"].baudrates == (230_400, 115_200)


@every_case
def test_frames_of_a_turn_are_counted_by_where_they_begin(case: Case) -> None:
    frames = 15 if "2g" in case.name else 16
    for at in range(0, 200, 6):
        for count in (2, 6):
            heard = b"".join(case.packets[at : at + count])
            assert frames_a_turn(heard) == frames
            assert TALKERS.model_of(None, heard).wire.sample_us(heard) == pytest.approx(case.sample_us, rel=0.05)


@every_case
@pytest.mark.parametrize("spoilt", [1, 3])
def test_one_frame_alone_tells_no_model(case: Case, spoilt: int) -> None:
    """The count of frames follows from two start angles (more_families_2.md 5.3), and 0 is one of any model."""
    begin = next(at for at, packet in enumerate(case.packets) if packet[11:13] == b"\0\0")
    frames = list(case.packets[begin : begin + 40])
    frames[spoilt] = frames[spoilt][:20] + bytes((frames[spoilt][20] ^ 1,)) + frames[spoilt][21:]
    found = TALKERS.find_stream(memoryview(b"".join(frames)), Known())
    assert found is not None
    kind = FifteenFormat if "2g" in case.name else FrameFormat
    assert type(found.stream.format) is kind


# What real ones had: samples of a frame, speed (1/20 Hz), calibration, microseconds of a sample. A frame in a test
# of R2D2-2019; heads of two turrets at 115200 baud; a Delta-2D of which the SangamIO driver describes 67064 frames.
REAL = [
    ([47], 0x82, 135, 204.6),
    ([21], 0x7B, -36, 483.9),
    ([17], 0x75, -32, 628.5),
    ([19, 18, 20, 19], 0x80, 10, 514.0),
]


@pytest.mark.parametrize(("counts", "speed", "calibration", "sample_us"), REAL)
def test_frames_of_real_devices(counts: list[int], speed: int, calibration: int, sample_us: float) -> None:
    """They have any length, also at 115200 baud, and a calibration; each is a sixteenth of a revolution."""
    frames = [pack_failure(speed / 20)] * 3
    for at in range(16 * 4):
        count = counts[at % len(counts)]
        frame = pack_measurement(at % 16 * 2250, [2126.5] * count, [70] * count, hertz=speed / 20)
        head = frame[8:9] + calibration.to_bytes(2, "big", signed=True) + frame[11:-2]
        frames.append(pack_frame(0xAD, head))
    found = TALKERS.find_stream(memoryview(b"".join(frames)), Known())
    assert found is not None
    assert type(found.stream.format) is FrameFormat
    assert found.stream.sample_ns == pytest.approx(1e3 * sample_us, rel=1e-3)
    scans = list(lidario.decode(b"".join(frames)))
    turn = 16 // len(counts) * sum(counts)
    assert [(len(scan), scan.lost_packets) for scan in scans] == [(turn, 0)] * 2
    assert scans[0].rpm == pytest.approx(3 * speed, rel=1e-3)
    assert scans[0].device_angles[0] == 0
    assert set(scans[0].device_distances.tolist()) == {2126.5}


def test_a_frame_that_tells_its_last_angle() -> None:
    frames = [
        pack_measurement(2250 * at, [1234.25] * 30, [7] * 30, end=2250 * at + 2175, version=0x10)
        for at in range(16)
    ]
    assert len(frames[0]) == 107
    samples = FrameDecoder(FrameFormat).decode(in_one_run(FrameFormat(), b"".join(frames)), None)
    assert set(samples.distance_mm.tolist()) == {1234.25}
    np.testing.assert_allclose(samples.angle_deg, np.arange(480) * 0.75, atol=1e-4)
    assert [each.angle_deg for each in irobotix.decode(frames)] == pytest.approx(
        samples.angle_deg.tolist(), abs=1e-4
    )


@every_case
def test_of_revolutions_of_which_nothing_came_all_frames_are_told(case: Case) -> None:
    """A frame is as long as its speed makes it: of a Delta-2G, far shorter than the longest that is accepted."""
    begins = [samples[0].packet for samples in case.turns]
    gone = range(begins[2] + 4, begins[4] + 4)
    left = [number for number in range(len(case.packets)) if number not in gone]
    raw = b"".join([case.packets[number] for number in left])
    found = assembled(case, raw, 64, arrivals(case, left))
    assert found.stats.lost_packets == len(gone)
    # Parts of two have met in the one in which the gap is.
    assert found.stats.missed_scans == 3
