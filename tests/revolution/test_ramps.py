"""Revolutions are counted by the time of a sample, which stays, not by the speed of the rotor, which changes."""

from collections.abc import Sequence

import numpy as np
import pytest

from lidario.families.rplidar.simulated import packers
from lidario.revolution.assemble import Assembler, AssemblerStats
from lidario.scan import Scan
from tests.support.cases import CASES, Case
from tests.support.numbered import BAUD, DENSE, SAMPLE_NS, TURN, on_time
from tests.support.ramp import ramp
from tests.support.streams import arrived, stream_of

PACKET_S = 40 * SAMPLE_NS * 1e-9
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


def dense(angles: np.ndarray[tuple[int], np.dtype[np.int64]]) -> list[bytes]:
    """Packets that begin at these angles."""
    raw = packers.pack_dense(angles % TURN, np.arange(len(angles) * 40).reshape(-1, 40) % 65535 + 1)
    return [raw[at : at + 84] for at in range(0, len(raw), 84)]


@pytest.mark.parametrize(("first_hz", "last_hz"), [(10.0, 2.0), (10.0, 1.2), (2.0, 10.0), (5.0, 12.0)])
@pytest.mark.parametrize("run", [1, 7, 300])
def test_a_ramp_on_a_clean_line_loses_nothing(first_hz: float, last_hz: float, run: int) -> None:
    angles = ramp(first_hz, last_hz, PACKET_S, before_s=0.5, until_s=3.0)
    scans, stats = scans_of(DENSE, dense(angles), range(len(angles)), run)
    assert (stats.lost_packets, stats.missed_scans, stats.broken_scans) == (0, 0, 0)
    assert [scan.seq for scan in scans] == list(range(len(scans)))
    assert len(scans) >= int(angles[-1] / TURN) - 1


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
