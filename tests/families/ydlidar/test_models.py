"""The models are those of the protocol sheets; `docs/devices.md` tells the same lines.

more_families.md A1; the 10 kHz of a G4: ydlidar_4ros.md 4.
"""

import pytest

from lidario.families.stream import Known
from lidario.families.ydlidar.decode import KINDS
from lidario.families.ydlidar.formats import PointCloud
from lidario.families.ydlidar.models import MODELS, Model
from lidario.families.ydlidar.raw import Turn, find_stream
from lidario.families.ydlidar.simulated.packers import Layout, pack_points
from tests.families.ydlidar.about import CASES

SHEET = {
    # Code, baud, thousand samples a second, whether it only talks; reach in metres by the vendor's tables.
    "4ros": (101, 512_000, (20,), False, 30), "tg30": (101, 512_000, (20,), False, 30),
    "tg15": (100, 512_000, (20, 18, 10), False, 15), "tg50": (102, 512_000, (20, 18, 10), False, 50),
    "x4": (6, 128_000, (5,), False, 10), "s4": (4, 115_200, (4,), False, 8), "s4b": (11, 153_600, (4,), False, 8),
    "f4": (1, 115_200, (4,), False, 12), "f4pro": (8, 230_400, (4, 6), False, 12),
    "g1": (19, 230_400, (9,), False, 12), "g2": (15, 230_400, (5,), False, 12),
    "g2a": (14, 230_400, (5,), False, 12), "g2c": (16, 115_200, (4,), False, 12),
    "g4": (5, 230_400, (10, 9, 8, 4), False, 16), "g4pro": (7, 230_400, (10, 9, 8, 4), False, 16),
    "g4b": (17, 512_000, (10,), False, 16), "g4c": (18, 115_200, (4,), False, 16),
    "g5": (20, 230_400, (10, 9, 8, 4), False, 16),
    "g6": (13, 512_000, (18, 16, 8), False, 25), "g7": (21, 512_000, (18, 16, 8), False, 25),
    "r2": (9, 230_400, (5,), False, 12), "tsa-pro": (131, 230_400, (4,), False, 12),
    "tmini": (140, 230_400, (4,), False, 12), "tmini-pro": (150, 230_400, (4,), False, 12),
    "tmini-plus": (151, 230_400, (4,), False, 12), "tmini-plus-sh": (152, 230_400, (4,), False, 12),
    "x2": (6, 115_200, (3,), True, 8), "x3": (6, 115_200, (3,), True, 8),
    "x4pro": (6, 128_000, (5,), True, 10), "s2pro": (4, 115_200, (3,), True, 8),
    "tx8": (100, 115_200, (4,), True, 8),
}  # fmt: skip
OFFSET = {"r2", "g1", "g2", "g2a", "g2c", "4ros", "tg15", "tg30", "tg50"}
"""Those that tell a zero-angle offset (A5 93)."""
FIXED = {"x4", "s4", "s4b", "x2", "x3", "x4pro", "s2pro", "tx8"}
"""Those whose speed no request sets."""
BY_DTR = {"x4", "s4", "s4b", "x2", "s2pro"}
"""Those whose motor turns while DTR is asserted."""
PROTECTED = {"4ros", "tg15", "tg30", "tg50"}
"""Those with power-down protection (A5 D9)."""
SAMPLES = {
    "tg": {"4ros", "tg15", "tg30", "tg50", "tx8"},
    "x-flags": {"x4pro"},
    "octave": {"g6", "g7"},
    "g2": {"g2", "g4b"},
    "s4b": {"s4b"},
    "tmini": {"tsa-pro", "tmini", "tmini-pro", "tmini-plus"},
    "sh": {"tmini-plus-sh"},
}
"""How samples are read; all others as those of an X4."""
FROM_6_HZ = {"tsa-pro", "tmini", "tmini-pro", "tmini-plus", "tmini-plus-sh"}


def facts(model: Model) -> tuple[int, int, tuple[float, ...], bool, float]:
    """As the rows of the sheet."""
    return model.code, model.baudrate, tuple(rate / 1000 for rate in model.rates), model.one_way, model.reach


def test_each_is_what_the_sheet_says() -> None:
    assert {name: facts(model) for name, model in MODELS.items()} == SHEET


def test_how_each_is_read_switched_on_and_set() -> None:
    assert {name for name, model in MODELS.items() if model.dtr} == BY_DTR
    assert {name for name, model in MODELS.items() if model.protection} == PROTECTED
    assert {name for name, model in MODELS.items() if model.offset} == OFFSET
    assert {name for name, model in MODELS.items() if model.speeds is None} == FIXED
    for name in MODELS.keys() - FIXED:
        assert MODELS[name].speeds == (6.0 if name in FROM_6_HZ else 5.0, 12.0)
    read = {name: {model for model in MODELS if MODELS[model].kind is kind} for name, kind in KINDS.items()}
    assert read == {**SAMPLES, "x": MODELS.keys() - set().union(*SAMPLES.values())}


def test_recordings_tell_how_samples_are_to_be_read_by_these_numbers() -> None:
    numbers = {name: kind.response_type for name, kind in KINDS.items()}
    own = dict(zip(("x", "x-flags", "octave", "g2", "s4b", "tmini", "sh"), range(0xA1, 0xA8), strict=True))
    assert numbers == {"tg": 0x81} | own


def test_where_no_packet_tells_how_long_a_revolution_is_the_slowest_rate_of_the_model_is_taken() -> None:
    """So that no revolution is too long."""
    case = next(each for each in CASES if each.name.startswith("ydlidar_x4"))
    # Of one sample each: they tell no step.
    packets = b"".join([packet for packet in case.packets if packet[2] & 1 and packet[3] == 1])
    found = find_stream(memoryview(packets), Known(model="g4"))
    assert found is not None
    assert found.stream.sample_ns == 1e9 / 4000


def silent(samples: int, each: int = 40) -> memoryview:
    """Revolutions of so many samples, whose start packets tell no speed, as an X4 sends them.

    In the others that byte tells something else.
    """
    angles = [at * 23040 // samples for at in range(samples)]
    parts = [angles[at : at + each] for at in range(0, samples, each)]
    turn = [pack_points([900] * len(part), part[0], part[-1], control=14) for part in parts]
    return memoryview(b"".join([pack_points([900], 0, 0, control=1), *turn] * 3))


@pytest.mark.parametrize("is_whole", [True, False])
def test_the_model_is_told_by_a_response_that_the_bytes_begin_with(is_whole: bool) -> None:
    """Where it is cut behind its header, as a crash may leave it, the model is guessed."""
    said = (bytes((5, 0, 1, 1)) + bytes(16)) * is_whole
    found = find_stream(memoryview(bytes.fromhex("a55a14000000 04") + said + bytes(silent(500))), Known())
    assert found is not None
    assert (found.title, not found.guess) == ("YDLIDAR G4" if is_whole else "YDLIDAR X4", is_whole)


@pytest.mark.parametrize("seen_mm", [0, 900])
@pytest.mark.parametrize("name", ["x4", "g2", "s4b", "tmini", "tmini-plus-sh"])
def test_how_long_samples_are_is_told_also_by_a_start_packet_that_saw_nothing(name: str, seen_mm: int) -> None:
    kind = MODELS[name].kind
    layout = Layout(kind.wire.sample_size, kind.unit, flags=kind.flags, bits=kind.bits)
    start = pack_points([seen_mm], 0, 0, control=1, layout=layout, intensities=70)
    parts = [pack_points([900] * 40, at, at + 2245, layout=layout, intensities=70) for at in range(0, 23040, 2304)]
    found = find_stream(memoryview(bytes(1000) + start + b"".join(parts)), Known())
    assert found is not None
    assert found.begin == 1000
    assert isinstance(found.stream.format, PointCloud)
    assert found.stream.format.sample_size == kind.wire.sample_size


def test_packets_tell_how_long_samples_are_also_where_the_last_ones_of_one_saw_nothing() -> None:
    """Two packets of 40 samples, five of them 0, pass for one of 40 longer samples, check value and all."""
    seen = [[900] * 40, [900] * 35 + [0] * 5, *[[900] * 40] * 20]
    parts = [pack_points(each, at * 1440 % 23040, (at * 1440 + 1400) % 23040) for at, each in enumerate(seen)]
    found = find_stream(memoryview(b"".join(parts)), Known())
    assert found is not None
    assert isinstance(found.stream.format, PointCloud)
    assert (found.begin, found.stream.format.sample_size) == (0, 2)


@pytest.mark.parametrize("each", [2, 40])
@pytest.mark.parametrize(
    ("samples", "title"), [(380, "S4"), (390, "X4"), (1240, "X4"), (1265, "G6"), (1400, "G6"), (6000, "none")]
)
def test_where_no_speed_is_told_it_is_one_that_a_model_has(samples: int, title: str, each: int) -> None:
    """Of 4 to 13 revolutions a second; of the models that fit, the likeliest one."""
    found = find_stream(silent(samples, each), Known())
    assert found is not None
    assert "no model that is known" in found.guess if title == "none" else found.title == f"YDLIDAR {title}"
    # Those whose samples are to be read in another way are named.
    others = {390: "; x4pro would", 1240: "; g6, g7, x4pro would"}.get(samples)
    assert others is None or f"{others} fit as well" in found.guess


@pytest.mark.parametrize(
    ("samples", "rate"), [(500, 4000), (700, 4000), (715, 8000), (1050, 8000), (1070, 9000), (1125, 9000)]
)
def test_where_no_speed_is_told_the_rate_is_that_of_about_8_revolutions_a_second(samples: int, rate: int) -> None:
    found = find_stream(silent(samples), Known(model="g4"))
    assert found is not None
    assert found.stream.sample_ns == 1e9 / rate


@pytest.mark.parametrize(
    ("name", "samples", "rate"),
    [
        *(("g4", *each) for each in ((410, 4000), (430, 4000), (440, 4400), (600, 6000), (800, 8000))),
        ("f4pro", 500, 5000),
        ("x4", 600, 5000),
    ],
)
def test_a_rate_that_a_model_does_not_have_is_that_of_another_one(name: str, samples: int, rate: int) -> None:
    """A G4 takes 4000, 8000, 9000 or 10 000 samples a second, an F4 Pro 4000 or 6000, an X4 always 5000."""
    model = MODELS[name]
    assert Turn(samples, 100 - model.kind.speed_base).rate(model) == rate
