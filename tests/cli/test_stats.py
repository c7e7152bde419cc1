"""``lidario stats``: what it measures, and the word it finds for it."""

import json
from pathlib import Path

import pytest

from lidario.cli.stats import Measured, verdict
from lidario.web.traffic import Traffic
from tests.cli.processes import invoke_driven

S2 = "sim://rplidar-s2?via=memory&world=circle"


def line(**changes: float) -> Traffic:
    usual = {"packets": 800, "bytes_a_second": 67_000.0, "load": 0.67}
    return Traffic(**{**usual, **changes})  # type: ignore[arg-type]


def measured(periods: list[float] | None = None, *, returns: int = 3000, **changes: float) -> Measured:
    stamps, now = [(0, 0.0)], 0.0
    for seq, period in enumerate(periods or [0.1] * 10):
        now += period
        stamps.append((seq + 1, now))
    count = len(stamps)
    return Measured(stamps, [3200] * count, [returns] * count, line(**changes), now)


@pytest.mark.long
def test_a_clean_line_is_good_and_every_figure_is_right() -> None:
    ended = invoke_driven("stats", S2, "-t", "2s", "--json", code=0)
    told = json.loads(ended.stdout, parse_constant=pytest.fail)
    assert told["verdict"] == "good"
    assert told["seconds"] == 2.0
    assert told["scans"] in (19, 20)
    assert told["hertz"] == pytest.approx(10, rel=0.02)
    assert told["samples"] == pytest.approx(3200, rel=0.02)
    assert (told["no_return"], told["lost_packets"], told["missed_scans"], told["dropped_scans"]) == (0, 0, 0, 0)
    # 84 bytes carry 40 samples of 31.25 µs, at 1 Mbaud.
    assert told["bytes_per_second"] == pytest.approx(84 / 40 * 32000, rel=0.02)
    assert told["link_load"] == pytest.approx(0.672, rel=0.02)
    assert 0 < told["jitter_ms"] < 2


@pytest.mark.long
def test_damage_is_told_with_its_cure() -> None:
    ended = invoke_driven("stats", S2 + "&fault=drop:0.1%", "-t", "1s", "--json", code=0)
    told = json.loads(ended.stdout)
    assert told["verdict"] == "damaged"
    # One of 84 bytes is missing: 1 - 0.999**84.
    assert told["damaged"] == pytest.approx(0.08, abs=0.05)
    assert "cable" in told["reason"]


def test_a_sensor_that_sees_nothing() -> None:
    told = json.loads(invoke_driven("stats", S2.replace("circle", "empty"), "-t", "1s", "--json").stdout)
    assert (told["verdict"], told["no_return"]) == ("blind", 1.0)


@pytest.mark.parametrize(
    ("what", "word"),
    [
        (measured(), "good"),
        (measured(lost_packets=2), "good"),
        (measured(lost_packets=8), "damaged"),
        (measured(missed_scans=1), "damaged"),
        (measured(dropped_scans=1), "slow"),
        (measured(discarded_bytes=1), "slow"),
        # Late reads that cost nothing are none; and what they cost was not lost on the line.
        (measured(late_reads=3), "good"),
        (measured(late_reads=1, lost_packets=8), "slow"),
        (measured(late_reads=2, lost_packets=8, skipped_stretches=2), "slow"),
        # A late read loses bytes in one place at most: elsewhere the line has lost them.
        (measured(late_reads=2, lost_packets=80, skipped_stretches=60), "damaged"),
        (measured(overruns=2), "good"),
        (measured(overruns=2, lost_packets=8), "slow"),
        (measured(overruns=2, framing_errors=1, lost_packets=8), "damaged"),
        (measured(load=0.97), "full"),
        (measured([0.09, 0.11] * 5), "uneven"),
        (measured(returns=0), "blind"),
        (Measured([(0, 0.0)], [3200], [3200], line()), "short"),
        # The line comes first: what it loses makes everything else worse.
        (measured([0.09, 0.11] * 5, lost_packets=80, returns=0), "damaged"),
    ],
)
def test_the_verdict_is_one_word_and_a_reason(what: Measured, word: str) -> None:
    told, reason = verdict(what)
    assert told == word
    assert reason


def test_what_the_driver_counted_is_the_cause() -> None:
    bad_cable = verdict(measured(lost_packets=80, framing_errors=7, breaks=1))[1]
    assert bad_cable.endswith(
        "The driver counted 7 framing errors, 1 break: the baud rate is wrong or the cable is bad"
    )
    slow = verdict(measured(lost_packets=80, overruns=7))[1]
    assert slow == (
        "9.1 % of the packets lost, with 7 overruns: this computer is too slow for the line. Close other programs"
    )


def test_a_simulated_lidar_has_no_cable() -> None:
    what = measured(lost_packets=80)
    assert "Check the cable, the plug" in verdict(what)[1]
    what.simulated = True
    assert verdict(what)[1].startswith("9.1 % of the packets damaged. Its simulated faults do that, or")


def test_a_lost_revolution_is_no_jitter() -> None:
    what = measured()
    what.stamps = [(0, 0.0), (1, 0.1), (3, 0.3), (4, 0.4)]
    assert what.periods == pytest.approx([0.1, 0.1])
    assert what.jitter == pytest.approx(0)


def test_for_people_it_fits_a_terminal() -> None:
    ended = invoke_driven("stats", S2, "-t", "500ms", code=0)
    lines = ended.stdout.splitlines()
    assert lines[-1].startswith("verdict")
    assert max(map(len, lines)) <= 80


def test_a_silent_device_is_no_data() -> None:
    invoke_driven("stats", S2 + "&fault=silent:1s", "-t", "5s", "--json", code=5)


@pytest.mark.parametrize("form", [(), ("--json",)])
def test_where_no_second_revolution_comes_it_says_so(tmp_path: Path, form: tuple[str, ...]) -> None:
    path = str(tmp_path / "one.mcap")
    assert invoke_driven("record", S2, "-n", "1", "-o", path).exit_code == 0
    for source, time in ((S2, "50ms"), (f"{path}?rate=0", "10s")):
        ended = invoke_driven("stats", source, "-t", time, *form)
        assert (ended.exit_code, ended.stdout) == (5, "")
        assert ended.stderr.startswith("nothing was measured: ")
