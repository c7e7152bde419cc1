"""The samples that people copy into robots, on lidars that fail: they stop, say so or go on; nothing old counts."""

import asyncio
from collections.abc import Awaitable, Callable
from itertools import cycle
from pathlib import Path
from typing import Any

import pytest

import lidario
from tests.support.loop import driven, run_driven
from tests.test_examples import load

pytestmark = pytest.mark.discards("these devices freeze, restart and protect themselves")

BEGIN_S = 2.0
"""When a fault begins; by then scans come."""
ENDING = ("silent:2s", "unplug:2s", "freeze:2s", "protect:2s")
PASSING = ("replug:2s", "reboot:2s")
DAMAGE = ("drop:0.1%", "flip:0.1%", "burst:0.01%", "duplicate:0.01%", "stall:200ms", "late:300ms")
MODELS = ("rplidar-s2", "ydlidar-4ros", "ldrobot-ld06")
SEEN_AFTER_S = 0.25 + 0.1
"""How long the sample goes by what it saw, and one round of its loop more."""


def source(model: str, fault: str) -> str:
    return f"sim://{model}?via=memory&fault={fault.replace('%', '%25')}"


def wheels(model: str, fault: str, seconds: float, monkeypatch: pytest.MonkeyPatch) -> list[tuple[float, float]]:
    """What the robot's wheels were told, and when, in seconds since the lidar was opened."""
    program, told = load("obstacle_stop"), list[tuple[float, float]]()

    async def main() -> None:
        loop = asyncio.get_running_loop()
        began = loop.time()
        monkeypatch.setattr(program, "set_wheels", lambda speed: told.append((loop.time() - began, speed)))
        monkeypatch.setattr(program, "STOP_M", 0.0)
        await program.drive(source(model, fault), seconds=seconds)

    try:
        run_driven(main)
    except* lidario.LidarError:
        pass
    return told


@pytest.mark.exhaustive("model", sample=MODELS[:1], full=MODELS)
@pytest.mark.parametrize("fault", ENDING)
def test_a_robot_stands_where_its_lidar_has_failed(model: str, fault: str, monkeypatch: pytest.MonkeyPatch) -> None:
    told = wheels(model, fault, 4.0, monkeypatch)
    assert any(speed > 0 for at, speed in told if at < BEGIN_S)
    # The session may cure it, as by a reset: then what is seen is new. In the moment behind the fault nothing is.
    until = BEGIN_S + 1.0
    assert [at for at, speed in told if speed > 0 and BEGIN_S + SEEN_AFTER_S < at < until] == []
    assert told[-1][1] == 0.0


@pytest.mark.long
@pytest.mark.parametrize("fault", PASSING)
def test_a_robot_drives_on_when_its_lidar_is_back(fault: str, monkeypatch: pytest.MonkeyPatch) -> None:
    told = wheels("rplidar-s2", fault, 10.0, monkeypatch)
    assert [at for at, speed in told if speed > 0 and BEGIN_S + SEEN_AFTER_S < at < BEGIN_S + 1.0] == []
    assert any(speed > 0 for at, speed in told if at > BEGIN_S + 3.0)
    assert told[-1][1] == 0.0


@pytest.mark.long
@pytest.mark.exhaustive("model", sample=MODELS[:1], full=MODELS)
@pytest.mark.parametrize("fault", DAMAGE)
def test_damage_keeps_no_robot_from_driving(model: str, fault: str, monkeypatch: pytest.MonkeyPatch) -> None:
    # Where every response is late, it takes long until the first scan: each is asked for until two are alike.
    told = wheels(model, fault, 12.0 if "late" in fault else 2.5, monkeypatch)
    # That all comes 0.3 s late nobody can know: the devices have no clock that is ours.
    assert sum(speed > 0 for _, speed in told) > 10
    assert told[-1][1] == 0.0


@pytest.mark.long
@driven
async def test_two_lidars_are_merged_only_where_both_are_of_one_moment(capsys: pytest.CaptureFixture[str]) -> None:
    """One of them pauses: the other one's scan, which waited meanwhile, is old by then."""
    program, found = load("two_lidars"), list[float]()
    together = program.together

    def watched(front: lidario.Scan, rear: lidario.Scan, motion: lidario.Velocity) -> lidario.Points:
        found.append(abs(front.stamp_ns - rear.stamp_ns) * 1e-9)
        cloud: lidario.Points = together(front, rear, motion)
        return cloud

    vars(program)["together"] = watched
    await program.main(source("rplidar-s2", "late:0ms"), source("rplidar-s2", "stall:400ms"), count=6)
    assert found
    assert max(found) < 0.3, found
    assert "late" in capsys.readouterr().out


EXAMPLES: dict[str, Callable[[Any, str, Path], Awaitable[object]]] = {
    "two_lidars": lambda program, told, _: program.main(told, source("ydlidar-4ros", "late:0ms"), count=25),
    "occupancy_grid": lambda program, told, _: program.main(told, count=25),
    "record_on_trigger": lambda program, told, folder: program.main(told, folder, events=3),
}

IN_TURNS = list(
    zip(cycle(EXAMPLES), [*ENDING, *PASSING, *DAMAGE, "garbage", "wrong-response:20%", *ENDING], strict=False)
)
"""Every fault for one of them, and each that ends a stream for two."""


@pytest.mark.long
@pytest.mark.exhaustive("what", sample=IN_TURNS[:5:2], full=IN_TURNS)
def test_a_sample_ends_goes_on_or_says_what_is_wrong(
    what: tuple[str, str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    name, fault = what
    program = load(name)

    async def main() -> str:
        try:
            async with asyncio.timeout(20.0):
                await EXAMPLES[name](program, source("rplidar-s2", fault), tmp_path)
        except lidario.LidarError as error:
            return str(error)
        except TimeoutError:
            # Nothing was near any more, and the sample waits for it.
            assert name == "record_on_trigger"
        return ""

    said = run_driven(main)
    if fault in ENDING and name != "record_on_trigger":
        # What can be cured, is; then it went on.
        assert said or fault.startswith(("protect", "silent", "freeze"))
    # What was recorded is whole, whatever ended it.
    for path in tmp_path.glob("*.mcap"):
        assert lidario.summarize(path).damage == ""
    capsys.readouterr()


@pytest.mark.parametrize("fault", ENDING)
@driven
async def test_a_web_application_answers_503_where_there_is_nothing_new(fault: str) -> None:
    from fastapi import FastAPI, HTTPException  # which take long

    program, app = load("web_app"), FastAPI()
    app.state.source = source("rplidar-s2", fault)
    vars(program)["app"] = app
    answered: list[int] = []
    try:
        async with program.lifespan(app):
            for _ in range(80):
                await asyncio.sleep(0.05)
                try:
                    scan = program.latest()
                    age_s = asyncio.get_running_loop().time() - scan.stamp_ns * 1e-9
                    assert age_s < 1.1
                    answered.append(200)
                except HTTPException as error:
                    answered.append(error.status_code)
    except* lidario.LidarError:
        pass
    assert 200 in answered
    assert 503 in answered[55:], answered
