"""Arrays in one go give what one sample at a time gives: decoding, checking, and looking for the seam."""

from collections.abc import Callable, Sequence
from itertools import accumulate, pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from lidario.families.base import Samples
from lidario.revolution.seam import Seam, Split
from lidario.wire.events import Packets
from lidario.wire.formats import BEGINS, RESTARTS, Headings
from tests.reference import ydlidar
from tests.support.cases import KINDS, LAYOUTS, Case, Sample, named
from tests.support.contents import any_packets, point_cloud
from tests.support.harm import messes
from tests.support.samples import one_a_parser
from tests.support.streams import SINGLE_DEG, before_seam, checked_one_by_one, in_one_run

every_layout = pytest.mark.exhaustive("case", sample=[*KINDS, *LAYOUTS])
seeds = st.integers(0, 2**32)
TURN = 23040


def run_of(case: Case, packets: Sequence[bytes]) -> Packets:
    """Packets as the link reports them."""
    return in_one_run(case.make_format(), b"".join(packets))


def assert_same(case: Case, samples: Samples, reference: Sequence[Sample]) -> None:
    """That the first samples are the reference's."""
    count = len(reference)
    np.testing.assert_array_equal(samples.distance_mm[:count], [s.distance_mm for s in reference])
    # The reference's correction of 0x84 is truncated to 1/65536 degrees.
    allowed = SINGLE_DEG + 1 / 65536 if case.response_type == 0x84 else SINGLE_DEG
    off = (samples.angle_deg[:count] - np.array([s.angle_deg for s in reference]) + 180) % 360 - 180
    assert np.abs(off).max(initial=0) <= allowed
    found = None if samples.intensity is None else samples.intensity[:count].tolist()
    assert found == case.intensities(reference)


def test_a_corrected_angle_just_below_360_is_not_rounded_to_360() -> None:
    """At 199 mm the correction of 113/64 degrees is -2e-7 degrees: single precision has nothing so near to 360."""
    case = next(case for case in LAYOUTS if case.name == "ydlidar_x4_11hz")
    assert isinstance(case.layout, ydlidar.Kind)
    packet = point_cloud(case.layout, 113, 113, (4 * 199).to_bytes(2, "little"))
    assert 359.9999 < case.decode([packet])[0].angle_deg < 360
    assert case.make_decoder().decode(run_of(case, [packet]), None).angle_deg.tolist() == [0.0]


@every_layout
@given(seed=seeds, count=st.integers(2, 40))
def test_any_contents_decode_as_the_scalar_reference_decodes_them(case: Case, seed: int, count: int) -> None:
    packets = any_packets(case, seed, count, wild=False)
    samples = case.make_decoder().decode(run_of(case, packets), None)
    assert_same(case, samples, case.decode(packets))
    assert ((samples.angle_deg >= 0) & (samples.angle_deg < 360)).all()
    assert len(samples.ends) == count
    assert samples.ends[-1] == len(samples.distance_mm) == len(samples.angle_deg)


@one_a_parser(KINDS)
@given(seed=seeds, count=st.integers(2, 20), place=st.floats(-0.2, 1.2), somewhere=st.integers(0, TURN - 1))
def test_the_seam_is_found_where_the_scalar_reference_passes_it(
    case: Case, seed: int, count: int, place: float, somewhere: int
) -> None:
    """In the last packet, near it, and anywhere."""
    *packets, following = any_packets(case, seed, count + 1, wild=False)
    raw, reference = run_of(case, packets), case.decode([*packets, following])
    last = [sample.raw_deg for sample in reference if sample.packet == count - 1]
    inside = round((last[0] + place * (last[-1] - last[0])) % 360 / 360 * case.make_format().full_turn)
    for seam in (inside % case.make_format().full_turn, somewhere):
        samples = case.make_decoder().decode(raw, following, 0, seam)
        if samples.lost == 0:
            assert samples.last.before_seam == before_seam(case, reference, count, seam)
    assert case.make_decoder().decode(raw, following).last.before_seam == len(samples.distance_mm)


@one_a_parser(KINDS)
@given(seed=seeds, count=st.integers(2, 40), room=st.integers(1, 200))
def test_room_is_left_at_the_front_of_every_array(case: Case, seed: int, count: int, room: int) -> None:
    raw = run_of(case, any_packets(case, seed, count, wild=False))
    plain, roomy = case.make_decoder().decode(raw, None), case.make_decoder().decode(raw, None, room)
    for one, other in (
        (plain.angle_deg, roomy.angle_deg),
        (plain.distance_mm, roomy.distance_mm),
        (plain.intensity, roomy.intensity),
    ):
        assert (one is None) == (other is None)
        if one is not None and other is not None:
            assert one.dtype == other.dtype
            np.testing.assert_array_equal(other[room:], one)
    assert (list(roomy.ends), roomy.last.before_seam) == (list(plain.ends), plain.last.before_seam)


@one_a_parser(KINDS)
@given(data=st.data(), seed=seeds, count=st.integers(2, 60))
def test_it_does_not_matter_where_the_stream_is_cut_into_turns(
    case: Case, data: st.DataObject, seed: int, count: int
) -> None:
    packets = any_packets(case, seed, count, wild=False)
    cuts = sorted(data.draw(st.sets(st.integers(1, count - 1), max_size=6), "cuts"))
    decoder, parts = case.make_decoder(), []
    for begin, end in pairwise([0, *cuts, count]):
        parts.append(decoder.decode(run_of(case, packets[begin:end]), packets[end] if end < count else None))
    whole = case.make_decoder().decode(run_of(case, packets), None)
    np.testing.assert_array_equal(np.concatenate([part.distance_mm for part in parts]), whole.distance_mm)
    known = len(whole.angle_deg) if not case.lookahead else int(whole.ends[-2])
    angles = np.concatenate([part.angle_deg for part in parts])
    np.testing.assert_allclose(angles[:known], whole.angle_deg[:known], rtol=0, atol=SINGLE_DEG)


@pytest.mark.exhaustive("case", sample=[case for case in KINDS if case.make_format().longest > 5])
@given(st.data())
def test_checking_as_an_array_finds_what_checking_one_by_one_finds(case: Case, data: st.DataObject) -> None:
    """For the node, whose check depends on the last angle, see test_rplidar_nodes."""
    lead = data.draw(st.binary(max_size=5), "lead")
    count = data.draw(st.integers(0, 30), "count")
    first = data.draw(st.integers(0, len(case.packets) - count), "first")
    raw = bytearray(lead + b"".join(case.packets[first : first + count]) + data.draw(messes(case), "mess"))
    for bit in data.draw(st.lists(st.integers(0, 8 * len(raw) - 1), max_size=2) if raw else st.just([]), "bits"):
        raw[bit // 8] ^= 1 << bit % 8
    wire = case.make_format()
    assert wire.run(raw, len(lead)) == checked_one_by_one(wire, raw, len(lead))


@pytest.mark.exhaustive("case", sample=[case for case in [*KINDS, *LAYOUTS] if case.make_format().longest > 5])
@pytest.mark.parametrize("seed", range(2))
def test_every_flipped_bit_of_a_packet_is_seen(case: Case, seed: int) -> None:
    """A node has no check value: see test_nodes."""
    wire, packet = case.make_format(), bytearray(any_packets(case, seed, 1, wild=False)[0])
    assert wire.measure(packet, 0) == len(packet)
    assert wire.intact(packet, 0, len(packet))
    for bit in range(8 * len(packet)):
        packet[bit // 8] ^= 1 << bit % 8
        size = wire.measure(packet, 0)
        assert not 0 < size <= len(packet) or not wire.intact(packet, 0, size), f"bit {bit}"
        packet[bit // 8] ^= 1 << bit % 8


@pytest.mark.parametrize("case", [case for case in [*KINDS, *LAYOUTS] if case.layout is not None], ids=named)
@given(seed=seeds, count=st.integers(1, 12), place=st.floats(0, 1, exclude_max=True))
def test_a_flipped_bit_of_any_contents_is_seen(case: Case, seed: int, count: int, place: float) -> None:
    packets = any_packets(case, seed, count, wild=False)
    raw = bytearray(b"".join(packets))
    bit = int(place * len(raw) * 8)
    raw[bit // 8] ^= 1 << bit % 8
    wire = case.make_format()
    whole = sum(end <= bit // 8 for end in accumulate(map(len, packets)))
    assert wire.run(raw, 0) == checked_one_by_one(wire, raw, 0)
    assert sum(block.packets for block in wire.run(raw, 0).packets) == whole


# --------------------------------------------------------------------------------------------------------- seam


def walked(seam: Seam, headings: Sequence[int]) -> list[Split]:
    """The splits, found one heading at a time."""
    return [split._replace(packet=n) for n, heading in enumerate(headings) for split in seam.splits([heading])]


def state(seam: Seam) -> dict[str, object]:
    """All that it remembers, but for the headings as they were given."""
    return {name: value for name, value in vars(seam).items() if name not in ("_recent", "_headings")}


@st.composite
def readings(draw: st.DrawFn) -> list[int]:
    """Headings of a rotor that turns, trembles, jumps, is marked and begins anew."""
    result, heading = [], draw(st.integers(0, TURN - 1))
    for _ in range(draw(st.integers(1, 8))):
        step = draw(st.integers(1, 2500))
        tremble = draw(st.sampled_from([0, 0, 60, 600]))
        for _ in range(draw(st.integers(1, 80))):
            heading += step + (draw(st.integers(-tremble, tremble)) if tremble else 0)
            result.append(heading % TURN)
        heading += draw(st.sampled_from([0, 0, TURN // 2, -TURN // 2, 5000, -300]))
    for place in draw(st.lists(st.integers(0, len(result) - 1), max_size=3)):
        result[place] |= draw(st.sampled_from([BEGINS, RESTARTS]))
    return result


@given(
    readings(),
    st.one_of(st.none(), st.integers(0, TURN - 1)),
    st.lists(st.integers(1, 120), max_size=6),
    st.sampled_from([list, np.array]),
)
def test_leaping_over_many_headings_finds_the_splits_a_walk_finds(
    headings: list[int], angle: int | None, sizes: list[int], kind: Callable[[list[int]], Headings]
) -> None:
    walk, leap = Seam(TURN, angle), Seam(TURN, angle)
    begin = 0
    for size in [*sizes, len(headings)]:
        part = headings[begin : begin + size]
        assert leap.splits(kind(part)) == walked(walk, part)
        assert state(leap) == state(walk)
        begin += size
