"""The collection of reports: each is decoded as it was when it came, and what is made of them is up to date."""

import shutil
from pathlib import Path

import numpy as np
import pytest

import lidario
from lidario.conformance import Outcome, read_report, rule_named, seen_reports
from lidario.scans.measured import changed
from tests.conformance.bench import make
from tests.support import reports

COLLECTION = sorted(reports.REPORTS.glob("*.mcap.xz"))
QUICK = [rule_named("identity-in-time"), rule_named("modes-start")]


def expected_of(path: Path) -> str:
    return path.with_suffix("").with_suffix(".txt").read_text(encoding="utf-8")


@pytest.mark.parametrize("path", COLLECTION, ids=lambda path: path.name)
def test_a_report_is_decoded_as_when_it_came(path: Path) -> None:
    expected = expected_of(path)
    who = expected.splitlines()[0].removeprefix("who ")
    with reports.unpacked(path) as file:
        assert reports.text_of(file, who) == expected
        assert read_report(file).is_complete


def test_what_is_made_of_the_collection_is_up_to_date(tmp_path: Path) -> None:
    page, seen = tmp_path / "devices.md", tmp_path / "seen.json"
    shutil.copy(reports.DEVICES, page)
    reports.write_all(devices=page, seen_file=seen)
    assert page.read_text(encoding="utf-8") == reports.DEVICES.read_text(encoding="utf-8")
    assert seen.read_text(encoding="utf-8") == reports.SEEN.read_text(encoding="utf-8")
    assert len(seen_reports()) == len(reports.real_ones(reports.REPORTS))


@pytest.fixture
def report(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """One that says it is of a real device."""
    monkeypatch.setattr("lidario.conformance.report.SIMULATED", "serial")
    path = tmp_path / "report.mcap"
    make(lidario.simulate("rplidar-a1"), path, QUICK)
    monkeypatch.undo()
    return path


@pytest.mark.long
def test_one_is_added(report: Path, tmp_path: Path) -> None:
    folder = tmp_path / "reports"
    folder.mkdir()
    page, seen_file = tmp_path / "devices.md", tmp_path / "seen.json"
    page.write_text(f"before\n{reports.BEGIN}{reports.END}behind\n", encoding="utf-8")
    reports.write_all(folder, page, seen_file)
    assert page.read_text(encoding="utf-8") == f"before\n{reports.BEGIN}{reports.NONE}{reports.END}behind\n"

    target = reports.add(report, "somebody", folder)
    assert reports.real_ones(folder) == [target]
    reports.write_all(folder, page, seen_file)
    assert "| RPLIDAR A1M8 | 1.29 | Linux " in page.read_text(encoding="utf-8")
    assert " | CP2102 | somebody | 20" in page.read_text(encoding="utf-8")
    (seen,) = [reports.seen_of(path) for path in reports.real_ones(folder)]
    assert [mode.name for mode in seen.modes] == [mode.name for mode in read_report(report).modes]
    expected = expected_of(target)
    assert expected.startswith("who somebody\ndevice RPLIDAR A1M8, firmware 1.29")
    assert expected.count("\nscan ") >= 8
    with pytest.raises(ValueError, match="there already"):
        reports.add(report, "somebody", folder)


@pytest.mark.long
def test_a_change_of_what_is_decoded_shows(report: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    before = reports.text_of(report, "somebody")
    decode_file = lidario.decode_file

    def off_by_a_millimetre(path: Path) -> list[lidario.Scan]:
        scans = list(decode_file(path))
        distances = scans[3].device_distances.copy()
        distances[np.flatnonzero(scans[3].valid)[0]] += 1.0
        scans[3] = changed(scans[3], device_distances=distances)
        return scans

    monkeypatch.setattr(lidario, "decode_file", off_by_a_millimetre)
    after = reports.text_of(report, "somebody")
    differ = [a for a, b in zip(before.splitlines(), after.splitlines(), strict=True) if a != b]
    assert len(differ) == 1


def test_one_that_was_ended_before_is_not_taken(tmp_path: Path) -> None:
    path = tmp_path / "report.mcap"
    _, made = make(lidario.simulate("ldrobot-ld19"), path, ())
    assert not made.with_outcome(Outcome.HELD)
    with pytest.raises(ValueError, match="ended before"):
        reports.add(path, "somebody", tmp_path)
