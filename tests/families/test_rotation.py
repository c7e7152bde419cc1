"""The rotor's step from packet to packet: what is missing is found, also when the first thing seen is a gap."""

from collections.abc import Sequence

import numpy as np
import pytest

from lidario.families.rplidar.decode import DECODERS
from lidario.families.rplidar.simulated import packers
from lidario.families.wheel import Wheel
from tests.support.cases import CASES
from tests.support.streams import in_one_run
from tests.support.wheels import heads
from tests.support.wheels import lost as lost_in

TURN = 23040
ULTRA_DENSE = [case for case in CASES if case.response_type == 0x86]


def steps(first: int, step: int, count: int, missing: Sequence[int]) -> np.ndarray[tuple[int], np.dtype[np.int32]]:
    """Headings of `count` packets, but for the missing ones."""
    left = [n for n in range(count) if n not in missing]
    return np.array([(first + n * step) % TURN for n in left], np.int32)


@pytest.mark.parametrize("arc", [206, 288, 961])
@pytest.mark.parametrize("width", [1, 2, 3])
@pytest.mark.parametrize("share", [9, 30])
def test_a_gap_seen_first_is_not_the_ordinary_step(arc: int, width: int, share: int) -> None:
    """The part of a revolution that comes first has one span, and that is a gap of one to three packets."""
    wheel, count = Wheel(TURN), TURN // arc
    wheel.follow(heads([TURN + 12 - (width + 1) * arc - arc // 4], 12))
    missing = np.random.default_rng(arc).choice(np.arange(2, count - 2, 2), min(share, count // 3), replace=False)
    found = wheel.follow(heads(steps(12, arc, count, missing.tolist()), 12 + arc * count))
    assert lost_in(found) == len(missing)
    assert found.arc.max() <= 1.05 * arc
    assert found.certain


@pytest.mark.parametrize("split", [False, True])
def test_nothing_is_smoothed_across_a_gap(split: bool) -> None:
    """0x86: distances are halved against the sample before; behind a gap another sample is the one before."""
    mm = np.full((40, 64), 400)
    mm[21:] = 402
    raw = packers.pack_ultra_dense(np.arange(40) * 500, mm, 30)
    packets = [raw[at : at + 170] for at in range(0, len(raw), 170)]
    left = [*packets[:20], *packets[21:]]
    wire, decoder = ULTRA_DENSE[0].make_format(), DECODERS[0x86]()
    if split:
        # The gap is between two stretches that are decoded one after the other.
        decoder.decode(in_one_run(wire, b"".join(left[:20])), left[20])
        behind = decoder.decode(in_one_run(wire, b"".join(left[20:])), None).distance_mm[:64]
    else:
        behind = decoder.decode(in_one_run(wire, b"".join(left)), None).distance_mm[20 * 64 : 21 * 64]
    assert set(behind.tolist()) == {402.0}
    # Where nothing is missing, the step is halved, as the vendor does.
    whole = DECODERS[0x86]().decode(in_one_run(wire, raw), None).distance_mm[21 * 64 : 22 * 64]
    assert whole[0] == 401.0


@pytest.mark.parametrize("kind", DECODERS)
def test_one_packet_alone_tells_no_speed(kind: int) -> None:
    case = next(case for case in CASES if case.response_type == kind and case.name.startswith("rplidar"))
    run = in_one_run(case.make_format(), case.packets[0])
    samples = case.make_decoder().decode(run, None)
    # But for 0x83, whose packets tell the angle of each sample.
    assert samples.certain == (kind == 0x83)
    assert samples.certain or (samples.last.samples, samples.last.packets) == (0, 0)
