"""What is new in a report: against the simulated devices, and against earlier reports."""

from __future__ import annotations

import asyncio
from dataclasses import replace
from pathlib import Path

import pytest

import lidario
from lidario.conformance import Outcome, Report, Seen, Tried, news_of, rule_named, seen_reports
from lidario.conformance.news import known_of
from lidario.families.registry import FAMILIES
from tests.conformance.bench import make
from tests.support.loop import run_driven


@pytest.fixture(scope="module")
def known() -> tuple[Seen, ...]:
    return run_driven(lambda: known_of("rplidar"))


@pytest.fixture
def report(tmp_path: Path) -> Report:
    return make(lidario.simulate("rplidar-s2"), tmp_path / "report.mcap", [rule_named("modes-are-listed")])[1]


@pytest.mark.long
def test_nothing_is_new_of_a_simulated_device(report: Report, known: tuple[Seen, ...]) -> None:
    assert news_of(report, known) == []


@pytest.mark.long
def test_a_model_that_nobody_knows(report: Report, known: tuple[Seen, ...]) -> None:
    info = replace(report.about.info, model="RPLIDAR S9", model_id=0x91)
    news = news_of(replace(report, about=replace(report.about, info=info)), known)
    assert news[0] == "model RPLIDAR S9 (number 145): nobody has reported or simulated one"
    assert news[1:] == ["mode Standard: not known of this model", "mode DenseBoost: not known of this model"]


def test_a_family_that_this_version_does_not_know(report: Report) -> None:
    """A report comes from any version, so it is read all the same."""
    info = replace(report.about.info, family="newvendor", model="NEW N1", model_id=1)
    tried = (Tried("sample-time", Outcome.BROKEN, "twice of it", 1.0),)
    newer = replace(report, about=replace(report.about, info=info), tried=tried)
    assert run_driven(lambda: known_of("newvendor")) == seen_reports()
    assert news_of(newer, seen_reports()) == [
        "model NEW N1 (number 1): nobody has reported or simulated one",
        "mode Standard: its format 0x81 is not known to lidario",
        "mode DenseBoost: its format 0x85 is not known to lidario",
        "not held: sample-time: twice of it",
    ]


def test_another_firmware_and_a_report_of_it(report: Report, known: tuple[Seen, ...]) -> None:
    info = replace(report.about.info, firmware="1.31")
    newer = replace(report, about=replace(report.about, info=info))
    assert news_of(newer, known) == ["firmware 1.31: known of this model are 1.02, 1.29"]
    seen = Seen(info.model, "1.31", report.modes, "somebody", "2026-11-24")
    assert news_of(newer, (*known, seen)) == []


def test_modes_that_differ(report: Report, known: tuple[Seen, ...]) -> None:
    standard, dense = report.modes
    modes = (
        replace(standard, sample_us=55.0, response_type=0x83),
        replace(dense, max_distance=dense.max_distance * 2),
        replace(dense, name="Odd", response_type=0x8E),
        replace(dense, name="More"),
    )
    assert news_of(replace(report, modes=modes), known) == [
        "mode Standard: format 0x83, known is 0x81",
        "mode Standard: a sample takes 55.00 us, known: 62, 62.5, 125",
        f"mode DenseBoost: it sees {2 * dense.max_distance:g} m far, known: {dense.max_distance:g}",
        "mode Odd: its format 0x8E is not known to lidario",
        "mode More: not known of this model",
    ]


@pytest.mark.long
def test_what_is_not_held(report: Report, known: tuple[Seen, ...]) -> None:
    tried = (Tried("sample-time", Outcome.BROKEN, "twice of it", 1.0), Tried("reset-boots", Outcome.HELD, "", 1.0))
    assert news_of(replace(report, tried=tried), known) == ["not held: sample-time: twice of it"]


@pytest.mark.long
def test_each_family_is_known_in_real_time_too() -> None:
    for family in FAMILIES:
        found = asyncio.run(known_of(family.name))
        assert len(found) == len(family.simulated) + len(seen_reports())
        assert all(each.model and each.modes for each in found)
