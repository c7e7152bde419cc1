"""0x81, the node of five bytes with two check bits: what lost, added and flipped bytes do to it.

A node of the damaged stream is *genuine* when the four bytes of its angle and distance are those of one clean
node; *hit* when it begins where a node does but contains the damage, which nothing in it can tell; and of
*wrong phase* else. The vendor's SDK relocks on wrong phases and sees 275 scan starts for 12 at this rate.
"""

from collections import Counter
from collections.abc import Callable
from itertools import chain
from random import Random

import numpy as np
import pytest

from lidario.families.rplidar import chains
from lidario.families.rplidar.nodes import NodeFormat
from lidario.families.rplidar.simulated.packers import pack_standard
from lidario.revolution.pipeline import Pipeline
from tests.reference import damage
from tests.support.cases import CASES, Case
from tests.support.kept import spoil_inside
from tests.support.samples import one_a_parser
from tests.support.streams import arrived, assembled, cut_up, feed, stream_of

CASES_81 = [case for case in CASES if case.make_format().longest == 5]
RATE = 5e-4
ADDED = -1

every_case = one_a_parser(CASES_81)


def inside(case: Case) -> tuple[int, int]:
    """From behind the beginning of the first whole turn to before the end of the last, in bytes."""
    return 5 * (case.turns[0][0].packet + 60), 5 * (case.turns[-1][-1].packet - 60)


def spoiled(case: Case, harm: str, seed: int) -> tuple[bytes, list[int], int]:
    """The damaged stream, where each of its bytes stood in the clean one, and how often it was hit."""
    begin, end = inside(case)
    if harm == "lost":
        found = damage.drop_bytes(case.raw[begin:end], RATE, seed)
        touched = {begin + place for place in found.touched}
        origin = [place for place in range(len(case.raw)) if place not in touched]
    else:
        found = damage.insert_bytes(case.raw[begin:end], RATE, seed)
        touched = {begin + place for place in found.touched}
        origin = list(
            chain.from_iterable((ADDED, place) if place in touched else (place,) for place in range(len(case.raw)))
        )
    raw = case.raw[:begin] + found.raw + case.raw[end:]
    assert len(raw) == len(origin)
    return raw, origin, len(touched)


def kind(origin: list[int]) -> str:
    """What a node is, of which the bytes stood there."""
    second = origin[1]
    if second % 5 == 1 and origin[1:] == list(range(second, second + 4)):
        return "genuine"
    return "hit" if origin[0] >= 0 and origin[0] % 5 == 0 else "wrong phase"


@pytest.mark.long
@every_case
@pytest.mark.parametrize("harm", ["lost", "added"])
@pytest.mark.exhaustive("seeds", sample=[4], full=[14])
def test_no_false_turn_and_hardly_a_node_of_wrong_phase(case: Case, harm: str, seeds: int) -> None:
    kinds, hits = Counter[str](), 0
    for seed in range(seeds):
        raw, origin, count = spoiled(case, harm, seed)
        hits += count
        for place, packet in feed(case, raw).places(case, raw).items():
            assert len(packet) == 5
            kinds[kind(origin[place : place + 5])] += 1
        scans, stats, _ = assembled(case, raw)
        # The true turns, each of its length but for the nodes that were hit.
        assert len(scans) == len(case.turns)
        assert stats.broken_scans == 0
        for scan, turn in zip(scans, case.turns, strict=True):
            assert abs(len(scan) - len(turn)) <= 0.02 * len(turn)
    assert hits > 17 * seeds
    # One added byte in five lies behind a first byte. Half of those have the check bit, and it is the lower half of
    # an angle of which nothing else can be tested: with the beams, 31 of 360 degrees continue the node before.
    assert kinds["wrong phase"] <= max(1, hits // 100)
    assert kinds["hit"] <= hits
    # A hit costs its node, and sometimes the one beside it.
    lost = seeds * len(case.packets) - kinds["genuine"]
    assert lost <= 2 * hits


@pytest.mark.long
@every_case
def test_one_byte_in_a_thousand_flipped(case: Case) -> None:
    """A node's distance is guarded by nothing; but its angle is, and so are the turns."""
    for seed in range(12):
        scans, stats, link = assembled(case, spoil_inside(case, 0.001, seed))
        assert len(scans) == len(case.turns), f"seed {seed}"
        assert stats.broken_scans == 0
        for scan, turn in zip(scans, case.turns, strict=True):
            assert 0.98 * len(turn) <= len(scan) <= len(turn) + 1
        share = sum(map(len, scans)) / sum(map(len, case.turns))
        assert 0.997 <= share <= 1
        # A node whose angle reads a few degrees ahead looks like a gap before it; the step back is none.
        lost = sum(scan.lost_packets for scan in scans)
        assert link.skipped_bytes // 10 <= lost <= 0.02 * len(case.packets), f"seed {seed}"


@pytest.mark.long
@pytest.mark.exhaustive("tremble", sample=[40], full=[0, 5, 40, 90])
def test_trembling_nodes_are_the_same_in_any_chunks(tremble: int) -> None:
    """Triangulating models correct each angle by its distance: nodes fall back, also from 0 to 359."""
    random = np.random.default_rng(tremble)
    count = 15_000
    turning = np.arange(count) * 7
    angles = (turning + random.integers(-tremble, tremble + 1, len(turning))) % (360 * 64)
    raw = pack_standard(angles, random.integers(0, 65536, len(angles)), 40, np.zeros(len(angles), bool))
    case = CASES_81[0]
    for chunks in (None, 1, 64, 1024):
        received = feed(case, raw, chunks)
        assert received.events == [arrived(raw, len(angles), 0)], chunks
    scans, stats, _ = assembled(case, raw)
    assert (len(scans), stats.broken_scans) == (count * 7 // (360 * 64) - 1, 0)
    assert all(abs(len(scan) - 360 * 64 / 7) <= 2 * tremble / 7 + 1 for scan in scans)


@every_case
def test_random_bytes_are_no_nodes(case: Case) -> None:
    """16 nodes in a row that turn evenly do not come by chance."""
    for raw in (Random(1).randbytes(100_000), bytes(20_000), b"\xff" * 20_000, b"\x55" * 20_000):
        assert feed(case, raw).stats.packets == 0


@pytest.mark.exhaustive("place", sample=[0, 45, 340], full=[0, 20, 45, 90, 180, 270, 300, 340])
@pytest.mark.exhaustive("chunks", sample=[64, None], full=[3, 64, 4096, None])
@pytest.mark.exhaustive("first", sample=[0, 2500], full=[0, 1000, 2500])
def test_revolutions_follow_the_mark_wherever_it_stands(place: int, chunks: int | None, first: int) -> None:
    """The manual does not say at which angle a scan begins: a mark far from 0 is no damage."""
    turning = np.arange(first, 6 * 3200 + 100) * 7.2  # a mark far from 0 is followed from the third one on
    degrees = turning / 64 % 360
    marks = np.diff((degrees - place) % 360, prepend=0.0) < 0
    if place == 0:
        marks[0] |= first == 0
    raw = pack_standard(np.rint(degrees * 64) % (360 * 64), 4000, 40, marks)
    scans, stats, link = assembled(CASES_81[0], raw, chunks)
    assert link.skipped_bytes == 0
    assert stats.broken_scans == stats.lost_packets == stats.missed_scans == 0
    assert len(scans) >= 4
    for scan in scans[1:]:
        assert abs(len(scan) - 3200) <= 1
        assert abs((scan.device_angles[0] - (place if place >= 30 and place < 330 else 0) + 180) % 360 - 180) < 0.3


@pytest.mark.parametrize("chunks", [64, None])
def test_where_only_the_first_mark_stands_elsewhere_revolutions_begin_at_0(chunks: int | None) -> None:
    """A device may mark the first node of all."""
    degrees = np.arange(1400, 6 * 3200 + 100) * 7.2 / 64 % 360
    marks = np.diff(degrees, prepend=360.0) < 0
    raw = pack_standard(np.rint(degrees * 64) % (360 * 64), 4000, 40, marks)
    pipeline = Pipeline(stream_of(CASES_81[0]))
    scans = [scan for piece in cut_up(raw, chunks) for scan in pipeline.receive(piece)]
    assert pipeline.stats.broken_scans == pipeline.stats.lost_packets == pipeline.stats.missed_scans == 0
    assert len(scans) == 5
    assert all(scan.device_angles[0] < 0.3 for scan in scans)


@every_case
def test_a_false_mark_makes_no_revolution(case: Case) -> None:
    """Both bits of a mark flipped, in one node: the node may be lost, not the revolution."""
    for number in range(case.turns[1][0].packet + 300, case.turns[1][-1].packet - 300, 397):
        raw = bytearray(case.raw)
        raw[5 * number] ^= 3
        scans, stats, _ = assembled(case, bytes(raw))
        assert (len(scans), stats.broken_scans) == (len(case.turns), 0)
        assert all(abs(len(scan) - len(turn)) <= 1 for scan, turn in zip(scans, case.turns, strict=True))


def half(raw: bytes) -> bytes:
    """Fifty bytes of the stream, fifty random ones, and so on."""
    random = Random(3)
    return b"".join(raw[at : at + 50] + random.randbytes(50) for at in range(0, len(raw), 100))


GARBAGE: dict[str, Callable[[bytes], bytes]] = {
    "random": lambda raw: Random(2).randbytes(len(raw)),
    "half of it random": half,
    "each 23rd byte lost": lambda raw: b"".join(raw[at : at + 22] for at in range(0, len(raw), 23)),
    "a node again and again": lambda raw: b"\x41" * len(raw),
    "marks": lambda raw: b"\x01" * len(raw),
}
"""Streams of which nothing can be used, though some of them hold many places that look like a few nodes."""


@pytest.mark.parametrize(("what", "behind"), [*((what, False) for what in GARBAGE), ("random", True)])
def test_garbage_is_passed_over_without_a_look_at_each_byte(
    what: str, behind: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Trying every place by hand took 3 to 9 us a byte, up to 74 % of a core."""
    tried: list[int] = []
    find, steps = NodeFormat.find_step, chains.chain_steps

    def find_counted(self: NodeFormat, data: bytearray, at: int) -> int | None:
        tried.append(at)
        return find(self, data, at)

    def steps_counted(data: bytearray, at: int, length: int, mark: int | None) -> list[int] | None:
        tried.append(at)
        return steps(data, at, length, mark)

    monkeypatch.setattr(NodeFormat, "find_step", find_counted)
    monkeypatch.setattr(chains, "chain_steps", steps_counted)
    case = CASES_81[0]
    garbage = GARBAGE[what](case.raw[20_000:80_000])
    # Behind a part of the stream, nodes that continue it are found even among damage; random bytes hold none.
    feed(case, (case.raw[:20_000] if behind else b"") + garbage, 2000)
    assert len(tried) < len(garbage) / 50
