"""What the golden streams tell of themselves; a Delta-2D; how many frames a revolution has."""

import numpy as np
import pytest

from lidario.families.irobotix import TALKERS
from lidario.families.irobotix.decode import FrameDecoder, frames_a_turn
from lidario.families.irobotix.formats import FifteenFormat, FrameFormat
from lidario.families.irobotix.simulated.device import pack_measurement
from lidario.families.stream import Known
from tests.families.irobotix.about import CASES
from tests.reference import irobotix
from tests.support.case import Case
from tests.support.cases import named
from tests.support.streams import in_one_run

every_case = pytest.mark.parametrize("case", CASES, ids=named)


def test_each_model_has_the_speeds_of_the_sheet() -> None:
    """more_families_2.md 5.1."""
    assert {model.name: model.baudrates for model in TALKERS.all if model.name} == {
        "delta2a": (230_400, 115_200),
        "delta2b": (230_400,),
        "delta2d": (115_200,),
        "delta2g": (115_200,),
        "lds08rr": (115_200,),
    }


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
