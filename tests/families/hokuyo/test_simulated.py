"""The simulated devices: what they obey, refuse and send, read by the scalar reference alone."""

from dataclasses import replace
from itertools import pairwise

import pytest

from lidario.families.hokuyo.simulated import PROFILES, SimulatedHokuyo, make_simulated
from tests.reference import hokuyo

pytestmark = pytest.mark.discards("what the simulated device discards is tested here")

S = 1_000_000_000
BEGIN = 1000 * S


class Dialogue:
    """A host with a clock of its own."""

    def __init__(self, model: str = "hokuyo-urg04lx") -> None:
        self.device: SimulatedHokuyo = make_simulated(model, seed=2)
        self.now = BEGIN

    def hear(self, seconds: float) -> bytes:
        self.now += round(seconds * S)
        return self.device.transmit(self.now)

    def say(self, text: str, seconds: float = 0.05) -> str:
        self.device.receive(text.encode("latin-1"), self.now)
        return self.hear(seconds).decode("latin-1")

    def fields(self, word: str) -> dict[str, str]:
        echo, status, *lines = self.say(word + "\n").removesuffix("\n\n").split("\n")
        assert (echo, status) == (word, "00P")
        for line in lines:
            assert hokuyo.sealed(line[:-1]) == line or hokuyo.sealed(line[:-2])[-1] == line[-1]
        return {name: value[:-2] for name, _, value in (line.partition(":") for line in lines)}


@pytest.mark.long
@pytest.mark.parametrize("model", PROFILES)
def test_it_tells_what_it_is_and_measures_what_it_told(model: str) -> None:
    host, of = Dialogue(model), PROFILES[model]
    assert host.fields("VV")["PROT"] == "SCIP 2.0"
    told = host.fields("PP")
    assert told["MODL"].startswith(of.product)
    assert host.fields("II")["LASR"] == "OFF"
    first, last = int(told["AMIN"]), int(told["AMAX"])
    words = ("MD", "ME") if of.intensity else ("MD",)
    for word in words:
        heard = host.say(f"{word}{first:04}{last:04}01000\n", 0.8).encode("latin-1")
        assert host.device.motor_on
        blocks = hokuyo.split(heard[: heard.rindex(b"\n\n") + 2])
        assert len(blocks) == pytest.approx(int(told["SCAN"]) / 60 * 0.75, abs=2)
        field = hokuyo.Field(int(told["AFRT"]), int(told["ARES"]), int(told["DMIN"]), int(told["DMAX"]))
        samples = hokuyo.decode(blocks, field=field)
        assert len(samples) == len(blocks) * (last - first + 1)
        assert sum(each.distance_mm > 0 for each in samples) > 0.8 * len(samples)
        times = [hokuyo.milliseconds(block) for block in blocks]
        period = 60_000 / int(told["SCAN"])
        assert all(abs((b - a) % (1 << 24) - period) <= 1 for a, b in pairwise(times))
        assert host.say("QT\n", 0.2).endswith("QT\n00P\n\n")
        assert (host.device.scanning, host.device.motor_on) == (False, False)
        assert host.hear(1.0) == b""


def test_it_counts_down_skips_and_joins() -> None:
    host = Dialogue()
    heard = host.say("MD0100010102103\n", 3.0)
    echoes = [text[:15] for text in heard.split("\n\n")[1:-1]]
    assert echoes == ["MD0100010102102", "MD0100010102101", "MD0100010102100"]
    blocks = [text.split("\n") for text in heard.split("\n\n")[1:-1]]
    times = [hokuyo.number(lines[2][:4]) for lines in blocks]
    assert [(b - a) % (1 << 24) for a, b in pairwise(times)] == pytest.approx([200, 200], abs=1)
    assert all(len(lines[3]) == 3 + 1 for lines in blocks)  # two steps are one value
    assert not host.device.scanning


def test_a_single_scan_needs_the_laser() -> None:
    host = Dialogue()
    assert host.say("GD0044072501\n").startswith("GD0044072501\n10")
    assert host.say("BM\n") == "BM\n00P\n\n"
    assert host.say("BM\n") == "BM\n02R\n\n"
    echo, status, time, *lines = host.say("GD0044072501\n", 0.5).removesuffix("\n\n").split("\n")
    assert (echo, status, len(time)) == ("GD0044072501", "00P", 5)
    assert sum(len(line) - 1 for line in lines) == 3 * 682


@pytest.mark.parametrize(
    ("text", "status"),
    [
        ("XX\n", "0E"), ("MD\n", "0C"), ("MD00440725010000\n", "0D"), ("MD0043072501000\n", "04"),
        ("MD0044072601000\n", "04"), ("MD0044O72501000\n", "0H"), ("MD0400030001000\n", "05"),
        ("ME0044072501000\n", "0E"), ("\xa5\x50VV\n", "0E"), ("SS999999\n", "0F"),
    ],
)  # fmt: skip
def test_what_it_does_not_know_is_refused_and_logged(text: str, status: str) -> None:
    host = Dialogue()
    assert host.say(text).split("\n")[1] == hokuyo.sealed(status)
    assert [each.obeyed for each in host.device.log] == [False]
    assert not host.device.scanning


def test_half_a_line_waits_and_an_empty_one_ends_it() -> None:
    host = Dialogue()
    assert host.say("MD0044") == ""
    assert host.say("\n").startswith("MD0044\n0C")
    assert host.say("\n\n") == ""
    assert host.fields("VV")["VEND"]


def test_while_its_clock_is_adjusted_it_obeys_nothing_else() -> None:
    host = Dialogue()
    assert host.say("TM0\n") == "TM0\n00P\n\n"
    assert host.say("VV\n") == "VV\n0Ee\n\n"
    echo, status, clock = host.say("TM1\n").removesuffix("\n\n").split("\n")
    assert (echo, status, clock) == ("TM1", "00P", hokuyo.sealed(clock[:4]))
    assert host.say("TM2\n") == "TM2\n00P\n\n"
    # The clock is told at any time (seqsense/urg_stamped).
    assert host.say("TM1\n").startswith("TM1\n00P\n")
    assert host.fields("VV")["VEND"]


def test_an_old_one_obeys_nothing_else_before_it_is_told_to_speak_scip_2() -> None:
    host = Dialogue()
    host.device = SimulatedHokuyo(replace(PROFILES["hokuyo-urg04lx"], begins_scip1=True))
    assert host.say("VV\n") == "VV\nE\n\n"
    assert host.say("SCIP2.0\n") == "SCIP2.0\n0\n\n"
    assert host.fields("VV")["VEND"]
    assert host.say("RS\n", 2.0) == "RS\n00P\n\n"
    assert host.say("VV\n") == "VV\nE\n\n"


def test_a_failed_laser_is_told_and_cured_by_a_reset() -> None:
    host = Dialogue()
    host.say("MD0044072501000\n", 0.5)
    host.device.protection_stop(32)
    host.hear(0.5)
    assert host.fields("II")["STAT"] == "Trouble!! Error No. =[00->32]"
    assert host.say("MD0044072501000\n").startswith("MD0044072501000\n50")
    assert host.say("RS\n", 0.5) == "RS\n00P\n\n"
    assert host.say("VV\n", 1.0) == ""
    assert host.fields("II")["STAT"] == "Sensor works well."
