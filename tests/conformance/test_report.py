"""A report: what is in its file, for whatever device, and what its readers bear."""

from __future__ import annotations

import asyncio
import json
import logging
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st
from mcap.reader import make_reader

import lidario
from lidario.conformance import (
    RULES,
    Outcome,
    Report,
    Reporter,
    Rule,
    open_bench,
    read_report,
    rule_named,
)
from lidario.conformance import kept as module_kept
from lidario.conformance.report import REPORT, _report_of
from lidario.families.registry import FAMILIES
from lidario.recording.about import About
from lidario.recording.write import FileWriter
from tests.conformance import defects
from tests.conformance.bench import judge
from tests.support.loop import DrivenLoop, run_driven

ONE_OF_EACH = [family.simulated[0] for family in FAMILIES]
QUICK = tuple(rule_named(name) for name in ("identity-in-time", "modes-are-listed", "modes-start"))


@pytest.fixture(autouse=True)
def quiet(caplog: pytest.LogCaptureFixture) -> None:
    caplog.set_level(logging.CRITICAL, logger="lidario")


def make(device: lidario.SimulatedDevice, path: Path, rules: Sequence[Rule] = RULES) -> tuple[str, Report]:
    """The serial number of a device, and its report, written to `path`."""

    async def main() -> tuple[str, Reporter]:
        loop = asyncio.get_running_loop()
        assert isinstance(loop, DrivenLoop)
        async with await open_bench(device) as bench:
            bench.pause = loop.block
            reporter = Reporter(bench, {"adapter": "CP2102"})
            await reporter.run(rules)
            return bench.lidar.info.serial, reporter

    serial, reporter = run_driven(main)
    return serial, reporter.write(path)


@pytest.mark.parametrize("model", ONE_OF_EACH)
def test_a_report_is_a_recording_that_others_read(model: str, tmp_path: Path) -> None:
    path = tmp_path / "report.mcap"
    serial, report = make(lidario.simulate(model), path)
    assert report.is_simulated
    assert report.is_complete
    assert [each.rule for each in report.tried] == [rule.name for rule in RULES]
    assert not report.with_outcome(Outcome.BROKEN)
    assert read_report(path) == replace(report, about=read_report(path).about)
    assert read_report(path).about.info == report.about.info
    # The reader of the package, which checks every sum.
    with path.open("rb") as file:
        reader = make_reader(file, validate_crcs=True)
        texts = {each.name: each.metadata for each in reader.iter_metadata()}
        topics = {channel.topic for _, channel, _ in reader.iter_messages()}
    assert topics == {"/lidar/raw", "/lidar/events"}
    assert len(texts[REPORT]["tried"].splitlines()) == len(RULES)
    assert json.loads(texts[REPORT]["modes"])[0]["name"] == report.modes[0].name
    # And our own: each mode was read for some scans.
    summary = lidario.summarize(path)
    assert set(summary.modes) == {mode.name for mode in report.modes}
    assert summary.scans >= 8 * len(report.modes)
    assert not summary.damage
    assert summary.lost_packets == 0
    data = path.read_bytes()
    for form in {serial.encode(), serial.lower().encode()} - {b""}:
        assert form not in data


@pytest.mark.parametrize("model", ["rplidar-s2", "ydlidar-4ros", "hokuyo-urg04lx"])
def test_what_plays_a_report_tells_the_hash(model: str, tmp_path: Path) -> None:
    path = tmp_path / "report.mcap"
    serial, report = make(lidario.simulate(model), path, QUICK)
    assert report.about.info.serial not in ("", serial)

    async def played() -> lidario.DeviceInfo:
        async with lidario.open_lidar(path) as lidar:
            await lidar.scan()
            return lidar.info

    assert asyncio.run(played()) == report.about.info


@pytest.mark.parametrize(
    "defect",
    [
        pytest.param("responds late", marks=pytest.mark.discards("a response that is outstanding")),
        "deaf behind STOP",
        "tells a wrong sample time",
        "mirrored",
    ],
)
def test_a_defect_stands_in_the_file(defect: str, tmp_path: Path) -> None:
    path = tmp_path / "report.mcap"
    make(defects.make(defect), path)
    told = {each.rule: each.outcome for each in read_report(path).tried}
    assert told == {each.rule.name: each.outcome for each in judge(defects.make(defect))}
    assert told[defects.DEFECTS[defect][1]] is Outcome.BROKEN


async def test_what_was_cut_off_is_written_as_far_as_it_came(tmp_path: Path) -> None:
    path = tmp_path / "report.mcap"
    async with await open_bench(lidario.simulate("rplidar-s2", spin_up=0)) as bench:
        reporter = Reporter(bench, {})
        begun = asyncio.Event()

        def began(rule: Rule) -> None:
            if rule is RULES[4]:
                begun.set()

        running = asyncio.ensure_future(reporter.run(RULES, on_begin=began))
        await begun.wait()
        running.cancel()
        await asyncio.wait([running])
    report = reporter.write(path)
    assert not report.is_complete
    assert [each.outcome for each in report.tried[:4]] == [Outcome.HELD] * 4
    assert {each.text for each in read_report(path).tried[4:]} == {"the report was ended before"}


async def test_the_names_of_ports_and_numbers_are_in_no_text(tmp_path: Path) -> None:
    async def tells(bench: lidario.conformance.Bench) -> str:
        return f"{bench.lidar.source} is {bench.lidar.info.serial}"

    rule = replace(rule_named("identity-in-time"), check=tells)
    source = "sim://rplidar-s2?via=memory"
    async with await open_bench(source) as bench:
        reporter = Reporter(bench, {})
        await reporter.run((rule,))
    report = reporter.report()
    assert report.tried[0].text == f"simulated is {report.about.info.serial}"


def test_what_is_too_much_is_counted(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(module_kept, "MOST_BYTES", 2000)
    path = tmp_path / "report.mcap"
    _, report = make(lidario.simulate("ldrobot-ld19"), path, QUICK)
    assert report.facts["left out"].endswith("because there were too many")
    assert path.stat().st_size < 20_000
    assert read_report(path).facts == report.facts


def test_what_is_no_report_says_so(tmp_path: Path) -> None:
    for name, data in (("empty.mcap", b""), ("bytes.bin", bytes(1000))):
        (tmp_path / name).write_bytes(data)
        with pytest.raises(lidario.RecordingError, match="is no report"):
            read_report(tmp_path / name)
    recording = tmp_path / "recording.mcap"
    FileWriter(recording, About(lidario.DeviceInfo("rplidar", "S2", 1, "", 0, ""))).close()
    with pytest.raises(lidario.RecordingError, match="is no report"):
        read_report(recording)
    with pytest.raises(lidario.RecordingError):
        read_report(tmp_path / "missing.mcap")


def test_a_file_that_is_there_is_not_replaced(tmp_path: Path) -> None:
    path = tmp_path / "report.mcap"
    path.write_bytes(b"mine")
    with pytest.raises(lidario.CannotRecord, match="exists already"):
        make(lidario.simulate("ldrobot-ld19"), path, QUICK[1:2])
    assert path.read_bytes() == b"mine"


TEXTS = st.text(max_size=30) | st.sampled_from(
    ["[]", "[1]", '["a", "held", "b", 1e999]', "[[[[", '["a","held","b",NaN]']
)


@given(st.dictionaries(st.sampled_from(["format", "modes", "tried", "fact: a", "fact: \x1b"]), TEXTS))
def test_whatever_a_file_says_is_read(texts: dict[str, str]) -> None:
    report = _report_of(About.of({}), texts)
    assert all(each.text.isprintable() and 0 <= each.seconds <= 1e6 for each in report.tried)
    assert all(name.isprintable() and text.isprintable() for name, text in report.facts.items())
