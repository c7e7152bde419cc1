"""From packets to revolutions: what stamps and speeds rest on, and that late bytes cost nothing."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from lidario.families.base import DecodedRevolution, Samples
from lidario.families.ydlidar import formats as ydlidar_formats
from lidario.revolution.assemble import Assembler
from lidario.revolution.ended import EndedRevolution
from lidario.revolution.partial import PartialRevolution, SampleArrays
from lidario.revolution.pipeline import Pipeline
from lidario.revolution.timing import first_sample_ns
from lidario.scans.scan import Scan
from lidario.wire.blocks import Block
from lidario.wire.events import Packets
from tests.support.cases import KINDS
from tests.support.numbered import BAUD, DENSE, SAMPLE_NS, numbered, on_time
from tests.support.streams import arrived, cut_up, open_stream, stream_of


@pytest.mark.parametrize("made", [Assembler, Pipeline])
def test_unless_it_is_told_otherwise_the_wall_clock_is_that_of_the_stamps(
    made: type[Assembler] | type[Pipeline],
) -> None:
    raw = arrived(b"".join(numbered(60, 960)), 60, 10**9)
    assembler = made(stream_of(DENSE))
    steps = assembler.ends(raw) if isinstance(assembler, Assembler) else assembler.take(raw)
    scans = [scan for step in steps for scan in step]
    assert [scan.wall_stamp_ns for scan in scans] == [scan.stamp_ns for scan in scans] != []


@pytest.mark.parametrize("run", [1, 5, 9])
def test_gaps_in_a_read_do_not_delay_the_stamps(run: int) -> None:
    """The read that brings the first packets ends behind the gap: what is missing was measured before, too."""
    left = [number for number in range(24 * 12) if number % 24 not in (2, 3, 13)]
    packets = numbered(24 * 12, 960)
    assembler, scans = Assembler(stream_of(DENSE, sample_ns=float(SAMPLE_NS)), BAUD), list[Scan]()
    for begin in range(0, len(left), run):
        some = left[begin : begin + run]
        data = b"".join(packets[number] for number in some)
        scans += assembler.add(arrived(data, len(some), round(on_time(some[-1]))))
    assert sum(scan.lost_packets for scan in scans) > 20
    for scan in scans:
        assert abs(scan.stamp_ns - (round(float(scan.device_distances[0])) - 1) * SAMPLE_NS) <= 1
        assert scan.rpm == pytest.approx(2000, rel=1e-3)


@pytest.mark.parametrize("chunk", [700, 4096, 40_000])
def test_packets_of_many_sizes_are_walked_only_by_the_parser(chunk: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """Where they begin is found once, and carried with them through the assembler and the decoder."""
    case = next(case for case in KINDS if case.truth.family == "ydlidar")
    link, events = open_stream(case), list[Packets]()
    for piece in cut_up(case.raw, chunk):
        link.receive_data(piece, 0)
        events += [event for event in link.events_received() if isinstance(event, Packets)]
    walks: list[int] = []

    def walk(data: bytes, at: int, size: int) -> int:
        walks.append(at)
        return equal_sizes(data, at, size)

    equal_sizes = ydlidar_formats.equal_sizes
    monkeypatch.setattr(ydlidar_formats, "equal_sizes", walk)
    assembler = Assembler(stream_of(case))
    scans = [scan for event in events for scan in assembler.add(event)]
    assert len(scans) == len(case.turns)
    assert walks == []


@given(
    delays=st.lists(st.integers(0, 5_000_000), min_size=1, max_size=20),
    carried=st.integers(0, 39),
    byte_ns=st.sampled_from([0.0, 10_000.0]),
)
def test_the_time_of_the_first_sample_does_not_depend_on_whether_angles_are_certain(
    delays: list[int], carried: int, byte_ns: float
) -> None:
    """Without a gap, and with one in which no sample is missing; packets come late, each by another delay."""
    each, packets, sample_ns = 40, len(delays), float(SAMPLE_NS)
    began_ns, some = 10**12, np.zeros(carried, np.float32)
    exact = [began_ns + round((carried + (number + 1) * each - 1) * sample_ns) for number in range(packets)]
    latest = 0
    arrivals = []
    for number, (at_ns, delay) in enumerate(zip(exact, delays, strict=True)):
        latest = max(latest, at_ns + delay)
        arrivals.append((number + 1, latest))
    run = Packets(bytes(84 * packets), (Block(84, packets),), tuple(arrivals))
    decoded = DecodedRevolution(packets * each, 0.0, 0.0)
    samples = Samples(some, some, None, range(each, packets * each + 1, each), [decoded], 0, packets)
    found = []
    for lost, certain in ((0, True), (0, False), (1, True)):
        samples = replace(samples, certain=certain)
        partial = PartialRevolution(whole=True, runs=[run], lost_behind_carried=lost)
        if carried:
            partial.carried, partial.carried_ns = SampleArrays(some, some, None), began_ns + 10**10
        elif lost:
            samples = replace(samples, gaps=[(0, 0)])
        ended = EndedRevolution(partial, run, samples, SampleArrays(some, some, None), 0, [], revoked=0)
        ended.sample_ns = sample_ns
        found.append(first_sample_ns(ended, byte_ns))
    assert found[0] == found[1] == found[2]
    least = min(late - at_ns for (_, late), at_ns in zip(arrivals, exact, strict=True))
    assert found[0] == pytest.approx(began_ns + least - 1.5 * sample_ns - 84 * byte_ns, abs=1)
