"""Trying rules: bounded in time, safe to cancel, and what becomes of them when the line is lost."""

from __future__ import annotations

import asyncio
from typing import Any

import pytest

import lidario
from lidario.conformance import RULES, Bench, Origin, Outcome, Rule, open_bench, rule_named, rules_in, streaming
from lidario.testing import SimulatedLidar
from tests.conformance.bench import broken, judge
from tests.conformance.wrapped import HeldBack, ReadLate
from tests.support.loop import driven


async def scans_for_ever(bench: Bench) -> str:
    async with bench.lidar.scans() as scans:
        async for _ in scans:
            pass
    return "never"


ENDLESS = Rule("endless", "It ends.", Origin.PROMISE, "nowhere", scans_for_ever, limit_s=2.0)


def test_a_rule_that_does_not_end_is_ended() -> None:
    device = lidario.simulate(spin_up=0)
    verdicts = judge(device, [ENDLESS, rule_named("silent-at-rest")])
    assert [each.outcome for each in verdicts] == [Outcome.BROKEN, Outcome.HELD]
    assert verdicts[0].text == "nothing was decided within 2 s"
    assert 2.0 <= verdicts[0].seconds < 2.5


@pytest.mark.parametrize("model", ["rplidar-s2", "ydlidar-x2", "ydlidar-4ros"])
def test_bytes_that_are_held_back_are_no_stream_that_goes_on(model: str) -> None:
    rules = [rule for rule in RULES if rule.name in ("silent-at-rest", "stop-while-asking", "stands-at-the-end")]
    for rule in rules:
        device: Any = HeldBack(lidario.simulate(model, spin_up=0))
        (verdict,) = judge(device, [rule])
        assert verdict.outcome is not Outcome.BROKEN, verdict


@pytest.mark.parametrize(
    "model",
    ["rplidar-a1", "rplidar-s2", "ydlidar-x4", "ldrobot-ld06", "neato-xv11", "hokuyo-urg04lx", "hokuyo-ust10lx"],
)
def test_no_rule_about_streams_depends_on_when_bytes_are_read(model: str) -> None:
    device: Any = ReadLate(lidario.simulate(model))
    assert broken(judge(device, rules_in(streaming))) == {}


@pytest.mark.long
@pytest.mark.parametrize("after_s", [0.2, 0.4, 1.0, 4.0, 7.9, 13.0])
@driven
async def test_a_cancelled_bench_leaves_the_device_still(after_s: float) -> None:
    device = lidario.simulate(spin_up=0)

    async def main() -> None:
        async with await open_bench(device) as bench:
            await bench.judge((rule_named("modes-start"), *RULES))

    task = asyncio.ensure_future(main())
    await asyncio.sleep(after_s)
    task.cancel()
    with pytest.raises(asyncio.CancelledError):
        await task
    assert not device.scanning
    assert not device.motor_on


@driven
async def test_what_comes_behind_a_lost_line_is_not_tried() -> None:
    lidar = SimulatedLidar(pace=1)
    begun, told = list[str](), list[str]()
    async with await open_bench(lidar) as bench:
        lidar.fail("unplug:0.2s")
        verdicts = await bench.judge(
            RULES, on_begin=lambda rule: begun.append(rule.name), on_verdict=lambda each: told.append(str(each))
        )
    assert begun == [rule.name for rule in RULES]
    assert told == [str(each) for each in verdicts]
    lost = [each for each in verdicts if each.text == "the line to the device is lost"]
    assert len(lost) > 20
    assert all(each.outcome is Outcome.NOT_TRIED for each in lost)
    first = verdicts[verdicts.index(lost[0]) - 1]
    assert first.outcome is Outcome.BROKEN
    assert "lost" in first.text.lower()  # by what the session has raised, or by the bench where nothing was asked


@pytest.mark.parametrize("source", ["corridor.mcap", "zenoh:lidar"])
async def test_what_is_no_line_to_a_device(source: str) -> None:
    with pytest.raises(lidario.InvalidValue, match="rules are tried on a device"):
        await open_bench(source)


def test_rules_have_names_and_sentences() -> None:
    assert len({rule.name for rule in RULES}) == len(RULES) >= 20
    for rule in RULES:
        assert rule_named(rule.name) is rule
        assert rule.sentence.endswith(".")
        assert rule.known_from
    with pytest.raises(lidario.InvalidValue, match="no rule is called 'sample_time'"):
        rule_named("sample_time")
