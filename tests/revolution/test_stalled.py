"""A rotor that is held for a while in the midst of a revolution, and let go."""

from __future__ import annotations

import numpy as np
import pytest

from lidario.revolution.assemble import Assembler
from lidario.scan import Scan
from tests.support.cases import KINDS, Case, named
from tests.support.streams import in_one_run, stream_of

TURN = 360 * 64

# Those whose packets only tell where they begin.
BEGINNINGS = [case for case in KINDS if case.truth.family == "rplidar" and case.response_type != 0x83]


@pytest.mark.long
@pytest.mark.parametrize("case", BEGINNINGS, ids=named)
@pytest.mark.parametrize("held_s", [0.02, 0.3, 2.0])
def test_what_comes_behind_is_whole_and_nothing_is_told_as_lost(case: Case, held_s: float) -> None:
    packet_s = len(case.samples) / len(case.packets) * case.sample_us * 1e-6
    on = np.arange(0, 8 * TURN, TURN * packet_s * 7)
    still = int(2.4 * len(on) / 8)
    starts = np.insert(on, still, np.full(int(held_s / packet_s), on[still]))
    packets = case.contents(case, np.random.default_rng(1), np.rint(starts).astype(np.int64) % TURN, False)
    stream = stream_of(case)
    assembler, scans = Assembler(stream), list[Scan]()
    for number, packet in enumerate(packets, 1):
        scans += assembler.add(in_one_run(stream.format, packet, round(number * packet_s * 1e9)))
    assembler.end()
    assert len(scans) >= 4
    assert not any(scan.lost_packets for scan in scans[-3:])
    assert assembler.stats.lost_packets <= 2
