"""Revolutions are counted by the time of a sample, which stays, not by the speed of the rotor, which changes."""

from collections.abc import Sequence
from functools import partial

import numpy as np
import pytest
from numpy.typing import NDArray

from benchmarks import truth_cases
from lidario.families.rplidar.simulated import packers
from lidario.revolution.assemble import Assembler, AssemblerStats
from lidario.scans.scan import Scan
from tests.revolution.test_known_truth import scored
from tests.support.cases import CASES, Case
from tests.support.numbered import BAUD, SAMPLE_NS, TURN, on_time
from tests.support.streams import arrived, stream_of

NODES = next(case for case in CASES if case.name == "rplidar_32k_81")


def scans_of(
    case: Case, packets: Sequence[bytes], numbers: Sequence[int], run: int, sample_ns: float = float(SAMPLE_NS)
) -> tuple[list[Scan], AssemblerStats]:
    """The scans of packets with these numbers in their stream, each of one size, so many of which come together."""
    assembler, scans = Assembler(stream_of(case, sample_ns=sample_ns), BAUD), list[Scan]()
    samples = 1 if case is NODES else 40
    for at in range(0, len(numbers), run):
        here = [packets[number] for number in numbers[at : at + run]]
        last = numbers[min(at + run, len(numbers)) - 1]
        at_ns = on_time(last) if samples > 1 else (last + 2.5) * sample_ns
        scans += assembler.add(arrived(b"".join(here), len(here), round(at_ns)))
    return scans, assembler.stats


@pytest.mark.parametrize("first_deg", [300, 332, 345, 356])
def test_a_stream_that_begins_right_before_the_seam_tells_an_outage(first_deg: int) -> None:
    """Of nodes, the first part of a revolution may be so short that it tells nothing of the time."""
    angles = first_deg * 64 + np.arange(20_000) * 25
    marks = np.diff(angles // TURN, prepend=0) > 0
    raw = packers.pack_standard(angles % TURN, np.arange(len(angles)) % 4000 + 4, 40, marks)
    nodes = [raw[at : at + 5] for at in range(0, len(raw), 5)]
    a_turn = TURN / 25
    begin = round(8.4 * a_turn)
    end = begin + round(5 * a_turn)
    kept = [*range(begin), *range(end, len(nodes))]
    scans, stats = scans_of(NODES, nodes, kept, 100, 108_000.0)
    assert stats.lost_packets == pytest.approx(end - begin, rel=0.01)
    assert scans[-1].seq == int(angles[-1] / TURN) - 2


def starting(
    hertz: float, seconds: NDArray[np.float64], *, rest_s: float = 0.0, in_s: float = 0.8
) -> NDArray[np.float64]:
    return -hertz * np.expm1(-np.maximum(seconds - rest_s, 0.0) / in_s)


@pytest.mark.parametrize("name", ["0x82 A1", "0x84 A3"])
def test_while_a_rotor_speeds_up_lost_packets_cost_no_revolution(name: str) -> None:
    """From rest, so that its arcs are many times as long at the end of a revolution as at the beginning."""
    damage = partial(truth_cases.lose_share, 2, spoilt=False)
    case = truth_cases.Case("starting slowly", damage, partial(starting, rest_s=1.0, in_s=1.2), 4.0, begin=0.88)
    found = scored(name, case)
    assert (found.delivered, found.told_revolutions, found.wrong) == (found.revolutions, 0, 0)
