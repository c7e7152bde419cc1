"""The rotor's step from packet to packet: what is missing is found, also when the first thing seen is a gap."""

from collections.abc import Sequence

import numpy as np
import pytest

from lidario.families.rplidar.decode import DECODERS
from lidario.families.rplidar.simulated import packers
from lidario.families.wheel import Wheel
from tests.support.cases import CASES, KINDS, Case, named
from tests.support.kept import arrivals
from tests.support.streams import assembled, in_one_run
from tests.support.wheels import heads
from tests.support.wheels import lost as lost_in

TURN = 23040
HQ = [case for case in CASES if case.response_type == 0x83]
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


@pytest.mark.long
@pytest.mark.exhaustive("lost", sample=[1, 4], full=range(6))
@pytest.mark.parametrize("name", ["rplidar_32k_82", "rplidar_32k_84", "rplidar_32k_85", "rplidar_32k_86"])
def test_a_stream_joined_at_a_gap_delivers_no_wrong_point(name: str, lost: int) -> None:
    """Joined one packet before a gap across the seam: what that packet held behind the seam is unknown."""
    case = next(case for case in CASES if case.name == name)
    seam = case.turns[0][0].packet
    gone = set(range(seam - lost // 2, seam - lost // 2 + lost))
    gone |= set(range(seam + 9, case.turns[-1][-1].packet, 13))
    left = [n for n in range(seam - lost // 2 - 1, len(case.packets)) if n not in gone]
    raw = b"".join(case.packets[n] for n in left)
    scans, _, _ = assembled(case, raw, [len(case.packets[0])], arrivals(case, left))
    assert len(scans) >= len(case.turns) - 1
    true = {(round(s.distance_mm), round(s.angle_deg * 16)) for s in case.samples}
    true |= {(mm, at + off) for mm, at in true for off in (-1, 1)}
    wrong = sum(
        (round(mm), round(deg * 16)) not in true
        for scan in scans
        for deg, mm in zip(scan.device_angles.tolist(), scan.device_distances.tolist(), strict=True)
        if mm
    )
    slack = 0.02 if case.response_type == 0x86 else 0.002  # smoothed with another neighbour
    assert wrong <= slack * sum(map(len, scans))


@pytest.mark.parametrize("case", HQ, ids=named)
@pytest.mark.parametrize("every", [2, 3])
def test_packets_with_angles_of_their_own_tell_every_gap(case: Case, every: int) -> None:
    """0x83: the arc of a packet is known from its nodes, so that no neighbour is needed."""
    decoder = case.make_decoder()
    left = range(0, len(case.packets), every)
    raw = b"".join(case.packets[n] for n in left)
    samples = decoder.decode(in_one_run(case.make_format(), raw), None)
    assert samples.lost == (len(left) - 1) * (every - 1)
    scans, stats, _ = assembled(case, raw, [781], arrivals(case, list(left)))
    assert len(scans) >= len(case.turns) - 1
    assert stats.broken_scans == 0
    whole = [len(turn) / 96 for turn in case.turns]
    assert all(
        scan.lost_packets == pytest.approx(packets - len(scan) / 96, abs=2.0)
        for scan, packets in zip(scans, whole, strict=False)
    )


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


@pytest.mark.parametrize("case", [case for case in KINDS if case.response_type != 0x81], ids=named)
def test_how_many_packets_a_revolution_has(case: Case) -> None:
    """As the decoders tell it, also when one packet in three is lost."""
    begin, end = case.turns[0][0].packet, case.turns[1][0].packet
    for left in (range(begin, end), [n for n in range(begin, end) if n % 3]):
        raw = b"".join(case.packets[n] for n in left)
        samples = case.make_decoder().decode(in_one_run(case.make_format(), raw), case.packets[end])
        assert samples.certain
        assert samples.revolution_packets == pytest.approx(end - begin, abs=1.1)
        assert samples.revolution_samples == pytest.approx(len(case.turns[0]), rel=0.02)


def test_a_leap_and_the_fall_behind_it_are_no_gap() -> None:
    """0x81: bytes that are no nodes may pass for some; behind them the angle is back where it was."""
    angles = np.arange(3000) * 7 % TURN
    angles[1500:1505] += 28 * 64
    nodes = packers.pack_standard(angles, 4000, 40, np.zeros(3000, bool))
    case = next(case for case in CASES if case.name == "rplidar_32k_81")
    samples = case.make_decoder().decode(in_one_run(case.make_format(), nodes), None)
    assert samples.lost <= 1
