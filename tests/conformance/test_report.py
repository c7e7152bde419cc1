"""A report: what is in its file, for whatever device, and what its readers bear."""

from __future__ import annotations

import asyncio
import json
import logging
import threading
import time
from collections.abc import Callable
from dataclasses import replace
from itertools import takewhile
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st
from mcap.reader import make_reader

import lidario
from lidario.conformance import RULES, Outcome, Reporter, Rule, open_bench, read_report, rule_named
from lidario.conformance import kept as module_kept
from lidario.conformance.report import REPORT, report_of
from lidario.families.registry import FAMILIES
from lidario.port.background import start_thread
from lidario.recording.about import About
from lidario.recording.chronicle import Responded, event_of
from lidario.recording.decode_file import FileDecoder
from lidario.recording.export import export_mcap
from lidario.recording.mcap_records import Message, Metadata, read_records
from lidario.recording.opened import StoredFile
from lidario.recording.write import EVENTS_TOPIC, FileWriter
from tests.conformance import defects
from tests.conformance.bench import judge, make
from tests.support.loop import driven, run_driven
from tests.support.recorded import thread_takes_no_time

ONE_OF_EACH = [family.simulated[0] for family in FAMILIES]
QUICK = tuple(rule_named(name) for name in ("identity-in-time", "modes-are-listed", "modes-start"))


@pytest.fixture(autouse=True)
def quiet(caplog: pytest.LogCaptureFixture) -> None:
    caplog.set_level(logging.CRITICAL, logger="lidario")


@pytest.fixture
def path(tmp_path: Path) -> Path:
    """Where a report is written."""
    return tmp_path / "report.mcap"


@pytest.mark.long
@pytest.mark.parametrize("model", ONE_OF_EACH)
def test_a_report_is_a_recording_that_others_read(model: str, path: Path) -> None:
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
        texts = [each.metadata for each in reader.iter_metadata() if each.name == REPORT]
        topics = {channel.topic for _, channel, _ in reader.iter_messages()}
    assert topics == {"/lidar/raw", "/lidar/events"}
    assert sum("tried" in each for each in texts) == len(RULES)
    assert json.loads(next(each["modes"] for each in texts if "modes" in each))[0]["name"] == report.modes[0].name
    # And our own: each mode was read for some scans.
    summary = lidario.summarize(path)
    assert set(summary.modes) == {mode.name for mode in report.modes}
    assert summary.scans >= 8 * len(report.modes)
    assert not summary.damage
    assert summary.lost_packets == 0
    data = path.read_bytes()
    for form in {serial.encode(), serial.lower().encode()} - {b""}:
        assert form not in data


@pytest.mark.long
@pytest.mark.parametrize("model", ["rplidar-s2", "ydlidar-4ros", "hokuyo-urg04lx"])
def test_what_plays_a_report_tells_the_hash(model: str, path: Path) -> None:
    serial, report = make(lidario.simulate(model), path, QUICK)
    assert report.about.info.serial not in ("", serial)

    async def played() -> lidario.DeviceInfo:
        async with lidario.open_lidar(path) as lidar:
            await lidar.scan()
            return lidar.info

    assert run_driven(played) == report.about.info


@pytest.mark.long
def test_a_copy_with_its_scans_has_the_verdicts_too(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    copy = path.with_name("copy.mcap")
    _, report = make(lidario.simulate("rplidar-s2"), path, QUICK)
    assert export_mcap(FileDecoder(path), copy) == lidario.summarize(path).scans
    assert read_report(copy) == replace(report, about=read_report(copy).about)
    assert read_report(copy).about == read_report(path).about
    # The index of a copy is held in memory: texts without end, as of who means harm, are not copied.
    monkeypatch.setattr("lidario.recording.read.MOST_TEXTS", 2)
    export_mcap(FileDecoder(path), copy, overwrite=True)
    with StoredFile(copy) as file:
        names = [each.name for each in read_records(file) if isinstance(each, Metadata)]
    assert names == ["lidario", REPORT, REPORT]


@pytest.mark.long
@pytest.mark.exhaustive(
    "defect",
    sample=["deaf behind STOP"],
    full=[
        pytest.param("responds late", marks=pytest.mark.discards("a response that is outstanding")),
        "deaf behind STOP",
        "tells a wrong sample time",
        "mirrored",
    ],
)
def test_a_defect_stands_in_the_file(defect: str, path: Path) -> None:
    make(defects.make(defect), path)
    told = {each.rule: each.outcome for each in read_report(path).tried}
    assert told == {each.rule.name: each.outcome for each in judge(defects.make(defect))}
    assert told[defects.DEFECTS[defect][1]] is Outcome.BROKEN


@driven
async def test_what_was_cut_off_is_written_as_far_as_it_came(path: Path) -> None:
    begun = asyncio.Event()

    def began(rule: Rule) -> None:
        if rule is RULES[4]:
            begun.set()

    async def reports() -> None:
        async with (
            await open_bench(lidario.simulate("rplidar-s2", spin_up=0)) as bench,
            Reporter(bench, path) as reporter,
        ):
            await reporter.run(RULES, on_begin=began)

    running = asyncio.ensure_future(reports())
    await begun.wait()
    running.cancel()
    await asyncio.wait([running])
    assert running.cancelled()
    report = read_report(path)
    assert not report.is_complete
    assert [each.outcome for each in report.tried[:4]] == [Outcome.HELD] * 4
    assert [each.rule for each in report.tried] == [rule.name for rule in RULES]
    assert {each.text for each in report.tried[4:]} == {"the report was ended before"}
    # The file is complete, as far as it goes.
    with path.open("rb") as file:
        assert make_reader(file, validate_crcs=True).get_summary() is not None


@driven
async def test_the_names_of_ports_and_numbers_are_in_no_text(path: Path) -> None:
    async def tells(bench: lidario.conformance.Bench) -> str:
        return f"{bench.lidar.source} is {bench.lidar.info.serial}"

    rule = replace(rule_named("identity-in-time"), check=tells)
    source = "sim://rplidar-s2?via=memory"
    async with await open_bench(source) as bench, Reporter(bench, path) as reporter:
        await reporter.run((rule,))
    report = read_report(path)
    assert report.tried[0].text == f"simulated is {report.about.info.serial}"


def test_a_device_that_protects_itself_is_reported_and_its_motor_is_left_alone(path: Path) -> None:
    device = lidario.simulate("rplidar-s2", spin_up=0)
    device.faults_cleared_by_reset = False  # type: ignore[attr-defined]
    device.protection_stop(0x8004)  # type: ignore[attr-defined]
    make(device, path)
    report = read_report(path)
    assert report.is_complete
    told = {each.rule: each for each in report.tried}
    assert told["health-in-time"].outcome is Outcome.BROKEN
    assert "code 32772" in told["health-in-time"].text
    assert told["identity-in-time"].outcome is Outcome.HELD
    assert told["modes-start"].text == "it protects itself, so its motor is not started"
    assert report.about.health.status is lidario.HealthStatus.ERROR
    assert not any("scan" in each.name for each in device.log)


def test_every_number_that_a_device_tells_is_hidden(path: Path) -> None:
    serial, report = make(defects.changes_serial(lidario.simulate("rplidar-s2", spin_up=0)), path, RULES[:3])
    second = bytes(range(16))
    assert report.tried[2].outcome is Outcome.BROKEN
    assert "and now says" in report.tried[2].text
    data = path.read_bytes()
    for number in (bytes.fromhex(serial), second):
        assert number not in data
        for text in (number.hex(), number.hex().upper()):
            assert text.encode() not in data
    # The two are told from each other all the same.
    payloads = {
        each.payload
        for each in (event_of(text) for text in texts_in(path))
        if isinstance(each, Responded) and len(each.payload) == 20
    }
    assert len(payloads) == 2


def texts_in(path: Path) -> list[str]:
    """The lines of the chronicle."""
    with path.open("rb") as file:
        found = [
            message.data
            for _, channel, message in make_reader(file).iter_messages()
            if channel.topic == EVENTS_TOPIC
        ]
    lines = [str(data[8:-1], "utf-8") for data in found]
    with StoredFile(path) as stored:
        (about,) = [
            record.texts
            for record in read_records(stored)
            if isinstance(record, Metadata) and record.name == "lidario"
        ]
    return [*about["events"].split("\n"), *lines]


@pytest.mark.long
def test_what_was_measured_is_in_a_table(path: Path) -> None:
    make(lidario.simulate("rplidar-s2", spin_up=0), path)
    figures = {each.name: each for one in read_report(path).tried for each in one.figures}
    assert figures["sample of DenseBoost"].value == pytest.approx(31.25, rel=0.01)
    assert figures["sample of DenseBoost"].unit == "us"
    assert figures["scan frequency of Standard"].value == pytest.approx(10.0, rel=0.01)
    # The simulated device boots for a second.
    assert figures["boot"].value == pytest.approx(1.0, abs=0.3)
    told, passed = (
        figures[f"revolutions {word} around a pause of 0.4 s"].value for word in ("told of", "that passed")
    )
    assert told == pytest.approx(passed, abs=0.5)
    assert str(figures["boot"]).endswith(" s")


@pytest.mark.long
def test_what_keeps_a_stream_going_is_measured(path: Path) -> None:
    rules = [rule_named("protection-keeps"), rule_named("protection-stops")]
    _, report = make(lidario.simulate("ydlidar-4ros"), path, rules)
    figures = {each.name: each.value for one in report.tried for each in one.figures}
    assert figures["requests that keep it going, in 5 s"] >= 2
    assert 2.5 < figures["stream without a request"] < 4.0


@pytest.mark.long
def test_a_file_that_is_cut_is_read_as_far_as_it_goes(path: Path) -> None:
    # Else a device that only talks fills the file while its thread begins late.
    with thread_takes_no_time():
        make(lidario.simulate("ldrobot-ld19"), path)
    whole = read_report(path)
    data = path.read_bytes()
    counts = []
    for share in (0.2, 0.6, 0.99):
        path.write_bytes(data[: int(share * len(data))])
        cut = read_report(path)
        assert [each.rule for each in cut.tried] == [rule.name for rule in RULES]
        held = cut.with_outcome(Outcome.HELD)
        assert held == whole.with_outcome(Outcome.HELD)[: len(held)]
        counts.append(len(held))
    assert counts == sorted(counts)
    assert counts[0] < counts[2]


@pytest.mark.long
def test_what_it_is_about_stands_first_on_a_slow_disk_too(monkeypatch: pytest.MonkeyPatch, path: Path) -> None:
    def late(run: Callable[[], None], name: str) -> threading.Thread:
        def slow() -> None:
            time.sleep(0.2)
            run()

        return start_thread(slow, name)

    monkeypatch.setattr("lidario.recording.record.start_thread", late)
    make(lidario.simulate("ldrobot-ld19"), path, QUICK)
    with StoredFile(path) as file:
        file.read(8)
        before = takewhile(lambda each: getattr(each, "name", "") != REPORT, read_records(file))
        assert not any(isinstance(each, Message) for each in before)


@pytest.mark.long
def test_what_is_too_much_is_counted(monkeypatch: pytest.MonkeyPatch, path: Path) -> None:
    monkeypatch.setattr(module_kept, "MOST_BYTES", 2000)
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


def test_a_file_that_is_there_is_not_replaced(path: Path) -> None:
    path.write_bytes(b"mine")
    with pytest.raises(lidario.CannotRecord, match="exists already"):
        make(lidario.simulate("ldrobot-ld19"), path, QUICK[1:2])
    assert path.read_bytes() == b"mine"


TEXTS = st.text(max_size=30) | st.sampled_from(
    ["[]", "[1]", '["a", "held", "b", 1e999]', "[[[[", '["a","held","b",NaN]']
)


@pytest.mark.long
@given(st.dictionaries(st.sampled_from(["format", "modes", "tried", "fact: a", "fact: \x1b"]), TEXTS))
def test_whatever_a_file_says_is_read(texts: dict[str, str]) -> None:
    report = report_of(About.of({}), texts)
    assert all(each.text.isprintable() and 0 <= each.seconds <= 1e6 for each in report.tried)
    assert all(name.isprintable() and text.isprintable() for name, text in report.facts.items())
