"""Packets, records and noise of the LDROBOT stream."""

from collections.abc import Callable
from random import Random

import numpy as np
import pytest
from numpy.typing import NDArray

from lidario.families.ldrobot import TALKERS
from lidario.families.ldrobot.decode import TriangleDecoder
from lidario.families.ldrobot.formats import CRC, PacketFormat, TriangleFormat
from lidario.families.ldrobot.simulated import pack_points
from lidario.families.scripts import hear
from lidario.families.two_angles import TwoAngleDecoder
from lidario.recording.offline import OfflineDecoder
from lidario.wire.events import Response
from lidario.wire.link import Link
from lidario.wire.states import LinkState
from tests.families.ldrobot.about import CASES
from tests.reference import golden, ldrobot
from tests.support.streams import feed, in_one_run

Floats = NDArray[np.float64]

MANUAL = bytes.fromhex(
    "54 2C 68 08 AB 7E E0 00 E4 DC 00 E2 D9 00 E5 D5 00 E3 D3 00 E4 D0 00 E9 CD 00 E4 CA 00 E2 C7 00 E9 C5"
    "00 E5 C2 00 E5 C0 00 E5 BE 82 3A 1A 50"
)
"""The example in the LD06 development manual."""
CLEAN = [
    pack_points(np.arange(12) + 1000 + n, range(100, 112), 950 * n % 36_000, (950 * n + 870) % 36_000)
    for n in range(80)
]
LD19 = next(case for case in CASES if case.name == "ldrobot_ld19_6hz")


def test_the_manuals_example_and_its_check_value() -> None:
    assert CRC.of(MANUAL) == CRC.of(b"") == 0
    assert ldrobot.crc8(MANUAL[:-1]) == MANUAL[-1] == 0x50
    samples = TwoAngleDecoder(PacketFormat).decode(in_one_run(PacketFormat(), MANUAL), None)
    assert samples.distance_mm.tolist()[:3] == [224.0, 220.0, 217.0]
    assert samples.intensity is not None
    assert samples.intensity.tolist()[:3] == [228, 226, 229]
    assert (samples.angle_deg[0], samples.angle_deg[-1]) == (pytest.approx(324.27), pytest.approx(334.7))
    assert samples.last.reported_rpm == pytest.approx(0x0868 / 6)


@pytest.mark.parametrize("chunk", [None, 47])
@pytest.mark.parametrize(("first", "last"), [(9500, 14_100), (9500, 9400), (36_100, 100), (35_900, 37_000)])
def test_what_no_rotor_can_turn_in_a_packet_is_damage(first: int, last: int, chunk: int | None) -> None:
    """A CRC of eight bits holds in one of 256 damaged packets; as of a real LD06 with bytes inserted."""
    odd = pack_points(range(1000, 1012), 100, first, last)
    found = feed(LD19, b"".join(CLEAN[:40]) + odd + b"".join(CLEAN[40:]), chunk)
    assert (found.data, found.stats.skipped_bytes) == (b"".join(CLEAN), 47)


@pytest.mark.parametrize("seed", range(10))
def test_a_packet_that_is_not_due_needs_another_behind_it(seed: int) -> None:
    """Noise with packets in it by chance: a mark, and a check value that holds."""
    random = Random(seed)
    false = MANUAL[:2] + random.randbytes(44)
    false += bytes((CRC.of(false),))
    found = feed(LD19, b"".join(CLEAN[:5]) + random.randbytes(5) + false + random.randbytes(60) + b"".join(CLEAN))
    assert found.data == b"".join(CLEAN[:5] + CLEAN)


def test_the_correction_before_holds_where_nothing_came_back_also_across_packets() -> None:
    far = pack_points([3000] * 12, 100, 1000, 1880)
    nothing = pack_points([0] * 12, 0, 1960, 2840)
    shift = ldrobot.shift_deg(3000)
    decoder = TriangleDecoder(TriangleFormat)
    # Before anything came back there is no correction.
    first = decoder.decode(in_one_run(TriangleFormat(), nothing), None)
    assert first.angle_deg[0] == np.float32(19.6)
    decoder.decode(in_one_run(TriangleFormat(), far), nothing)
    second = decoder.fork()
    for each in (decoder, second):
        after = each.decode(in_one_run(TriangleFormat(), nothing), None)
        np.testing.assert_allclose(after.angle_deg[[0, 11]], [19.6 - shift, 28.4 - shift], atol=2e-5)
    # Of several revolutions the last return counts, too.
    both = in_one_run(TriangleFormat(), CLEAN[0] + CLEAN[1])
    assert decoder.decode_several(both, CLEAN[2], [1, 2], 0, None) is not None
    again = second.decode(in_one_run(TriangleFormat(), nothing), None)
    assert again.angle_deg[0] == pytest.approx(19.6 - shift, abs=2e-5)
    behind = decoder.decode(in_one_run(TriangleFormat(), nothing), None)
    assert behind.angle_deg[0] == pytest.approx(19.6 - ldrobot.shift_deg(1012), abs=2e-5)


# ------------------------------------------------------------------------------------------ packets as a response


def test_packets_that_nobody_waits_for_any_more_are_no_response() -> None:
    link = Link()
    link.send_request(hear(PacketFormat(), 2))
    link.receive_data(CLEAN[0], 0)
    link.abandon()
    link.receive_data(CLEAN[1], 0)
    assert link.events_received() == []
    assert (link.state, link.stats.late_responses, link.stats.response_bytes) == (LinkState.IDLE, 1, 94)
    # Only that one request was abandoned.
    link.send_request(hear(PacketFormat(), 2))
    link.receive_data(b"".join(CLEAN[2:4]), 7)
    (response,) = link.events_received()
    assert isinstance(response, Response)
    assert response.payload == b"".join(CLEAN[2:4])


def test_what_comes_when_nobody_listens_is_drained() -> None:
    link = Link()
    link.send_request(hear(PacketFormat(), 2))
    link.receive_data(b"".join(CLEAN[:2]), 0)
    link.receive_data(b"".join(CLEAN[2:4]), 0)
    assert (link.stats.drained_bytes, link.stats.stray_bytes) == (94, 0)


# ------------------------------------------------------------------------------------------ a real device


def test_the_rate_is_told_by_step_and_speed() -> None:
    for name, rate in (("ldrobot_ld19_6hz", 4500), ("ldrobot_stl27l_13hz", 21_600), ("ldrobot_ld14p_6hz", 4000)):
        raw = b"".join(ldrobot.split(golden.load(name).raw)[:24])
        assert PacketFormat.samples_a_second(raw) == pytest.approx(rate, rel=0.01)


def packets_of(late_s: float, told: Callable[[Floats], Floats], rate: float) -> bytes:
    """Packets of a rotor whose way in degrees is told by the time, and its speed some time later."""
    seconds = np.arange(600)[:, None] * 12 / rate + np.arange(12) / rate
    way = np.floor(told(seconds) * 100).astype(np.int64) % 36_000
    before = seconds[:, 0] - late_s
    speed = np.rint((told(before) - told(before - 1e-3)) / 1e-3).astype(np.int64)
    at_ms = (29_990 + seconds[:, 0] * 1e3).astype(np.int64) % 30_000
    return pack_points(np.full((600, 12), 1000), 100, way[:, 0], way[:, -1], speed=speed, milliseconds=at_ms)


@pytest.mark.parametrize("rate", [2300, 4000, 4500, 5000])
def test_while_the_rotor_speeds_up_the_rate_is_told_within_a_tenth_or_not_at_all(rate: int) -> None:
    raw, many = packets_of(0.01, lambda seconds: 300 * seconds**2, rate), 24 * PacketFormat.layout.itemsize
    told = [PacketFormat.samples_a_second(raw[at : at + many]) for at in range(0, len(raw) - many, many // 24)]
    assert [each for each in told if each] == pytest.approx([rate] * len(told), rel=0.1)


@pytest.mark.parametrize(
    ("rate", "title"),
    [
        (2300, "LDROBOT LD14 or LD08"),
        (4000, "LDROBOT LD14P"),
        (4500, "LDROBOT LD06, LD19 or alike"),
        (5000, "LDROBOT LD06, LD19 or alike"),
        (21_600, "LDROBOT STL-27L"),
    ],
)
@pytest.mark.parametrize(
    "told",
    [
        pytest.param(np.zeros_like, id="stands"),
        pytest.param(lambda seconds: 3 * seconds, id="creeps"),
        pytest.param(lambda seconds: 4000 * np.maximum(seconds, 0) ** 2, id="speeds up"),
        pytest.param(lambda seconds: 3600 * seconds, id="turns"),
    ],
)
@pytest.mark.parametrize("late_s", [0.0, 0.01])
def test_a_rotor_that_does_not_turn_evenly_yet_hides_no_model(
    rate: float, title: str, told: Callable[[Floats], Floats], late_s: float
) -> None:
    assert OfflineDecoder(packets_of(late_s, told, rate)).title == title


@pytest.mark.parametrize(
    ("baudrate", "title"),
    [
        (None, "LDROBOT LD06, LD19 or alike"),
        (230_400, "LDROBOT LD06, LD19 or alike"),
        (115_200, "LDROBOT LD14 or LD08"),
    ],
)
def test_where_nothing_tells_the_model_it_is_a_guess(baudrate: int | None, title: str) -> None:
    model = TALKERS.unnamed(pack_points([[1000] * 12] * 24, 100, 9000, 9000, speed=0), baudrate)
    assert model.title == title
    assert "name the model" in model.note


@pytest.mark.parametrize(("more", "packets"), [(1, 0), (2, 1)])
def test_behind_noise_a_packet_is_believed_when_the_next_one_begins(more: int, packets: int) -> None:
    assert feed(LD19, bytes(50) + CLEAN[0] + CLEAN[1][:more]).stats.packets == packets
