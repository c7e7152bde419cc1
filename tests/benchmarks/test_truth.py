"""The truth that scans are compared with: it is right itself, and what is off is seen."""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest

from benchmarks import truth
from benchmarks.report import Setting
from benchmarks.truth_cases import CASES, Case, Line, happen
from benchmarks.truth_code import UNKNOWN, Code
from benchmarks.truth_forms import FORMATS
from benchmarks.truth_score import Score, score
from benchmarks.truth_streams import TrueStream, true_stream
from benchmarks.truth_vendor import by_vendor
from benchmarks.truth_ways import WAYS, Received, receive
from lidario.scans.scan import Scan
from tests.reference import ldrobot, rplidar, ydlidar

AT_ONCE = (3e-4, 6e-4)


def _clean(name: str, seconds: float = 1.0) -> tuple[TrueStream, Line]:
    stream = true_stream(FORMATS[name], lambda times: 9.0 + times, seconds)
    return stream, Line(stream.data, stream.arrivals_ns, 0)


def _by_reference(stream: TrueStream) -> Iterator[tuple[float, float]]:
    """Angle and distance of each sample, by decoders that share no code with lidario's."""
    raw, kind = stream.data.tobytes(), stream.form.kind.mode.response_type
    if stream.form.kind.family == "rplidar":
        for node in rplidar.decode(kind, rplidar.split(kind, raw)):
            yield node.angle_deg, node.distance_mm
    elif stream.form.kind.family == "ydlidar":
        model = ydlidar.Kind(unit=4, triangle=True) if stream.form.name in ("X4", "G4") else ydlidar.FOUR_ROS
        for point in ydlidar.decode(ydlidar.split(raw, model), model):
            yield point.angle_deg, point.distance_mm
    else:
        for sample in ldrobot.decode(ldrobot.split(raw)):
            yield sample.angle_deg, sample.distance_mm


@pytest.mark.exhaustive("name", sample=FORMATS)
def test_an_independent_decoder_finds_every_sample_where_the_truth_says(name: str) -> None:
    stream, _ = _clean(name, 0.4)
    angles, distances = np.array(list(_by_reference(stream))).T
    count = len(angles)
    assert count >= len(stream.turns) - stream.form.samples
    off = np.abs((angles - stream.degrees[:count] + 180) % 360 - 180)
    # Angles are cut to 1/64 degree, and between two of them the rotor, which speeds up here, is taken to be even.
    assert off.max() < 0.03
    packet, place = stream.code.decode(distances.astype(np.float32))
    assert np.array_equal(stream.firsts[packet] + place, np.arange(count))


@pytest.mark.exhaustive(
    ("name", "way"),
    sample=[("0x85 C1", "held"), ("X4", "held"), *((name, way) for name in FORMATS for way in ("read", "file"))],
)
def test_on_a_clean_line_all_is_delivered_and_nothing_is_missing(name: str, way: str) -> None:
    stream, line = _clean(name)
    line = replace(line, pace_s=AT_ONCE)
    found = score(stream, line, receive(stream, line, way), timed=way != "file")
    # Angles are cut: a sample right behind a seam may be told as before it, and so in another revolution.
    assert found.samples - 2 <= found.kept <= found.samples
    assert found.samples > 3000
    assert found.delivered == found.revolutions >= 8
    assert found.farthest_deg < 0.03
    assert not any((found.wrong, found.mixed, found.twice, found.seq_off))
    assert not any((found.missing, found.told, found.missing_revolutions, found.told_revolutions))
    # A packet waits for its read. Of packets that differ in size the line delays the short ones less.
    least_ms, least_percent = 3.0 if stream.form.kind.family == "ydlidar" else 0.7, 1.0
    if stream.form.rates:
        # Until it is known which rate it is, a revolution is dated by its reads.
        least_ms, least_percent = 6.0, 4.0
    assert found.times_off_ms is not None
    assert found.times_off_ms[1] < least_ms
    assert found.overlap_ms < least_ms
    assert found.rpm_off is not None
    assert found.rpm_off[1] < least_percent


def test_a_sample_is_at_the_integral_of_the_speed() -> None:
    stream = true_stream(FORMATS["LD19"], lambda times: 10.0 - 4.0 * times, 1.0, begin=0.25)
    seconds = stream.times_ns * 1e-9
    assert stream.turns == pytest.approx(0.25 + 10.0 * seconds - 2.0 * seconds**2, abs=1e-6)
    assert stream.whole == range(1, 8)


def test_a_packet_has_come_when_its_last_sample_its_delay_and_its_bytes_are_over() -> None:
    stream, _ = _clean("0x85 C1")
    last_ns = stream.arrivals_ns[stream.offsets[1:] - 1]
    # 84 bytes of ten bits at 460800 baud, behind 40 samples of 200 us, and another one and a half.
    first_ns = 39 * 200_000 + 1.5 * 200_000 + 84 * 10e9 / 460_800
    assert last_ns == pytest.approx(first_ns + np.arange(len(last_ns)) * 8e6)


def _changed(stream: TrueStream, line: Line, change: dict[str, object]) -> Score:
    """The score where the third scan is another."""
    received = receive(stream, line, "read")
    scans = [replace(scan, **change) if at == 2 else scan for at, scan in enumerate(received.scans)]  # type: ignore[arg-type]
    return score(stream, line, Received(scans, received.stats, received.packets), timed=True)


def test_what_is_off_is_seen() -> None:
    stream, line = _clean("0x84 A3")
    third: Scan = receive(stream, line, "read").scans[2]
    clean = _changed(stream, line, {})
    # Samples right behind a seam, see above.
    assert clean.samples - 2 <= clean.kept <= clean.samples
    turned = third.device_angles.copy()
    turned[10:60] += 1.5
    found = _changed(stream, line, {"device_angles": turned % 360})
    assert (found.wrong, found.strange, found.kept) == (50, 0, clean.kept - 50)
    assert found.farthest_deg == pytest.approx(1.5, abs=0.05)
    farther = third.device_distances.copy()
    farther[200:210] += 3.0
    found = _changed(stream, line, {"device_distances": farther})
    assert (found.wrong, found.strange, found.kept) == (10, 10, clean.kept - 10)
    # Nor has it moved where its distance became that of a sample elsewhere.
    another = third.device_distances.copy()
    another[200:210] = another[500:510]
    found = _changed(stream, line, {"device_distances": another})
    assert (found.wrong, found.strange, found.kept) == (10, 10, clean.kept - 10)
    assert (found.mixed, found.twice) == (0, 0)
    assert found.farthest_deg < 0.05
    found = _changed(stream, line, {"stamp_ns": third.stamp_ns + 40_000_000})
    assert found.times_off_ms is not None
    assert found.times_off_ms[1] == pytest.approx(40, abs=7)
    assert found.overlap_ms == pytest.approx(40, abs=7)
    assert _changed(stream, line, {"seq": 4}).seq_off == 2
    found = _changed(stream, line, {"rpm": third.rpm * 1.2})
    assert found.rpm_off is not None
    assert found.rpm_off[1] == pytest.approx(20, abs=4)


def test_a_point_of_another_revolution_is_seen_and_one_that_comes_twice() -> None:
    stream, line = _clean("0x85 S1")
    received = receive(stream, line, "read")
    first, second, *others = received.scans
    joined = replace(
        first,
        device_angles=np.concatenate((first.device_angles[:300], second.device_angles[300:400])),
        device_distances=np.concatenate((first.device_distances[:300], second.device_distances[300:400])),
    )
    scans = [joined, second, *others]
    found = score(stream, line, Received(scans, received.stats, received.packets), timed=True)
    assert (found.mixed, found.twice, found.wrong) == (100, 100, 0)
    assert found.kept == found.samples - (len(first) - 300)


@pytest.mark.parametrize(
    "code", [Code(1, 1, 65535, 40, 5000), Code(4096, 8, 510, 96, 1000), Code(0, 5, 300, 3, 99)]
)
def test_the_number_of_a_sample_is_found_by_its_neighbours(code: Code) -> None:
    packet = np.repeat(np.arange(code.packets - 30, code.packets), code.samples)
    place = np.tile(np.arange(code.samples), 30)
    millimetres = code.millimetres(packet, place).astype(np.float32)
    left = np.ones(len(packet), np.bool_)
    left[: code.samples - 1] = left[5 * code.samples : 9 * code.samples] = left[-code.samples + 2 :] = False
    found = code.decode(millimetres[left])
    told = found[0] >= 0
    assert np.array_equal(found[0][told], packet[left][told])
    assert np.array_equal(found[1], place[left])
    # Of a packet of which but few samples are there, more than one may be meant.
    assert (~told).sum() <= 3
    assert (code.decode(millimetres + np.float32(code.step / 2))[0] == UNKNOWN).all()
    millimetres[0] += np.float32(code.step / 2)
    assert (code.decode(millimetres)[1] == [UNKNOWN, *place[1:]]).all()


@pytest.mark.long
@pytest.mark.parametrize(
    ("name", "gone"),
    [("each second packet gone", 0.5), ("40 % of the packets spoilt", 0.4), ("an outage of two turns", 0.05)],
)
def test_what_is_missing_is_known(name: str, gone: float) -> None:
    stream, line = happen(CASES[name], FORMATS["4ROS"])
    assert line.missing is not None
    assert line.missing == pytest.approx(gone * (len(stream.offsets) - 1), rel=0.1)
    assert receive(stream, line, "read").packets == pytest.approx(len(stream.offsets) - 1 - line.missing, abs=1)
    assert len(line.data) == len(line.at_ns)
    assert (np.diff(line.at_ns) >= 0).all()


def test_the_same_happens_each_time() -> None:
    for name in ("bursts of 200 bytes", "10 % of the packets twice", "1 % of the bytes lost"):
        (_, once), (_, again) = (happen(CASES[name], FORMATS["X4"]) for _ in range(2))
        assert np.array_equal(once.data, again.data)


def _arc_over_a_gap(case: Case) -> tuple[int, int] | None:
    return by_vendor(*happen(case, FORMATS["0x85 C1"]))


@pytest.mark.long
def test_the_vendors_rules_spread_a_packet_over_a_gap() -> None:
    stream, line = happen(CASES["clean"], FORMATS["0x85 C1"])
    points = score(stream, line, receive(stream, line, "read"), timed=True).samples
    assert _arc_over_a_gap(CASES["clean"]) == (points, 0)
    gone, spoilt = (_arc_over_a_gap(CASES[f"20 % of the packets {how}"]) for how in ("gone", "spoilt"))
    assert gone is not None
    assert spoilt is not None
    assert gone[1] > 0.1 * points
    # A packet behind which damage was seen is dropped. By chance, a check value holds in the midst of packets.
    assert spoilt[1] < 0.01 * points
    assert 0.5 * points < spoilt[0] < 0.75 * points
    assert by_vendor(*happen(CASES["clean"], FORMATS["X4"])) is None


@pytest.mark.long
def test_rows_are_selected_by_words() -> None:
    result = truth.run(Setting(quick=False, words=("0x85 C1", "two turns")))
    assert [row["way"] for row in result.rows] == list(WAYS)
    assert {row["case"] for row in result.rows} == {"an outage of two turns"}
    assert len(result.tables[0].rows) == len(WAYS)
