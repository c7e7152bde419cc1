"""The examples run as they stand there, on simulated lidars in memory, and are short and typed."""

from __future__ import annotations

import ast
import asyncio
import importlib.util
import json
import math
import shutil
import signal
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path
from types import ModuleType
from typing import Any

import httpx
import numpy as np
import pytest

import lidario
from lidario.testing import Body, SimulatedLidar, make_scan, make_sector, room
from tests.support.children import line_of
from tests.support.example import run_example, running
from tests.support.inner import ASYNCIO_INI, run_pytest
from tests.support.loop import run_driven
from tests.support.pages import blocks
from tests.support.recorded import thread_takes_no_time

FOLDER = Path(__file__).parent.parent / "examples"
FILES = sorted(FOLDER.glob("*.py"))
NOTEBOOK = FOLDER / "first_look.ipynb"
LINES = 80
FOR_OTHER_PROGRAMS = {"foxglove_live", "rerun_live", "dds_publish", "day_to_parquet"}
LINES_FOR_OTHERS = 40


def load(name: str) -> ModuleType:
    spec = importlib.util.spec_from_file_location(f"example_{name}", FOLDER / f"{name}.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_every_example_has_a_test() -> None:
    text = "".join(path.read_text(encoding="utf-8") for path in Path(__file__).parent.glob("test_example*.py"))
    assert len(FILES) >= 10
    for path in FILES:
        name = path.stem.removeprefix("test_")
        assert f'"{name}"' in text or f"test_{name}" in text, path


@pytest.mark.parametrize("path", [*FILES, NOTEBOOK], ids=lambda path: path.name)
def test_it_is_short_and_says_what_it_is(path: Path) -> None:
    if path.suffix == ".py":
        text = path.read_text(encoding="utf-8")
        assert ast.get_docstring(ast.parse(text))
        assert len(text.splitlines()) < (LINES_FOR_OTHERS if path.stem in FOR_OTHER_PROGRAMS else LINES)
    else:
        assert sum(len(cell["source"]) for cell in cells() if cell["cell_type"] == "code") < LINES


@pytest.mark.long
@pytest.mark.parametrize(("name", "given"), [("two_lidars", 0), ("two_lidars", 3), ("day_to_parquet", 1)])
def test_an_example_that_needs_two_arguments_says_which(name: str, given: int) -> None:
    done = run_example(name, *["sim://rplidar-s2"] * given)
    assert done.returncode == 1
    assert done.stderr.strip() == (ast.get_docstring(ast.parse((FOLDER / f"{name}.py").read_text("utf-8"))) or "")


@pytest.mark.long
def test_obstacle_stop_and_its_own_test(tmp_path: Path) -> None:
    """The robot's unit test, run as its developer runs it: in its folder, with pytest."""
    (tmp_path / "pytest.ini").write_text(ASYNCIO_INI, encoding="utf-8")
    for name in ("obstacle_stop.py", "test_obstacle_stop.py"):
        shutil.copy(FOLDER / name, tmp_path)
    assert run_pytest(tmp_path, "-p", "no:anyio").outcomes == {"passed": 3}


class ScriptedLidar:
    """Sectors of 45 degrees at 10 Hz in an empty room: of the first revolution all, then only some."""

    def __init__(self, later: list[int], ranges: float = math.inf) -> None:
        self._later, self._ranges = later, ranges

    async def sectors(self, degrees: float) -> AsyncIterator[lidario.Sector]:
        assert degrees == 45
        for turn in range(30):
            for index in range(8):
                await asyncio.sleep(1 / 80)
                if turn and index not in self._later:
                    continue
                angles = -np.radians(np.arange(45.0 * index, 45.0 * index + 45))
                now = round(asyncio.get_running_loop().time() * 1e9) - 12_500_000
                yield make_sector(angles, self._ranges, stamp_ns=now, seq=turn, index=index)


def eyes_of(lidar: ScriptedLidar, where: str) -> list[float | None]:
    """What is ahead, as the program sees it: 10 times within a second."""
    program: dict[str, Any] = vars(load("obstacle_stop")) if where == "example" else {}
    if where == "page":
        text = (FOLDER.parent / "docs" / "control-loop.md").read_text(encoding="utf-8")
        exec(next(block.text for block in blocks(text) if block.title == "guard.py"), program)

    async def main() -> list[float | None]:
        eyes, seen = program["Eyes"](), list[float | None]()
        watching = asyncio.create_task(eyes.watch(lidar))
        for _ in range(10):
            seen.append(eyes.ahead())
            await asyncio.sleep(0.1)
        watching.cancel()
        await asyncio.wait([watching])
        return seen

    return run_driven(main)


@pytest.mark.parametrize("where", ["example", "page"])
def test_what_is_not_seen_any_more_is_not_free(where: str) -> None:
    everything = eyes_of(ScriptedLidar(list(range(8))), where)
    assert everything[0] is None
    assert everything[2:] == [math.inf] * 8
    # What is at the sides and behind comes all the time; what is ahead, or half of it, came once.
    for later in ([1, 2, 3, 4, 5, 6], [0, 1, 2, 3, 4, 5, 6], [7], []):
        seen = eyes_of(ScriptedLidar(later), where)
        assert seen[2] == math.inf
        assert seen[6:] == [None] * 4, later
    assert eyes_of(ScriptedLidar(list(range(8)), 0.4), where)[2:] == [pytest.approx(0.4)] * 8


async def test_two_lidars() -> None:
    front, rear = SimulatedLidar(walls=room(4, 6), seed=1), SimulatedLidar(walls=room(4, 6), seed=2)
    cloud = await load("two_lidars").main(front, rear, count=2)
    assert set(cloud.source.tolist()) == {0, 1}
    # The lidars are 0.4 m apart and look away from each other; each sees its own wall 3 m in front of itself.
    assert cloud.xy[:, 0].max() == pytest.approx(3.2, abs=0.01)
    assert cloud.xy[:, 0].min() == pytest.approx(-3.2, abs=0.01)
    assert np.ptp(cloud.times_ns) < 0.25e9
    assert front.is_still
    assert rear.is_still


@pytest.mark.long
async def test_occupancy_grid(capsys: pytest.CaptureFixture[str]) -> None:
    grid = await load("occupancy_grid").main(SimulatedLidar(walls=room(6, 4), noise=0.002), count=3)
    cells, middle = grid.cells, grid.cells.shape[0] // 2
    assert cells[middle + 20, middle] > 0  # the wall, 2.0 m ahead
    assert cells[middle, middle + 30] > 0  # the wall at the left, 3.0 m
    assert (cells[middle - 15 : middle + 15, middle - 15 : middle + 15] < 0).all()
    assert (cells[:5] == 0).all()
    picture = capsys.readouterr().out.splitlines()
    assert len(picture) == 48
    # Forward is up.
    grid = load("occupancy_grid").Grid()
    grid.add(make_scan([0.0, 0.0], [3.0, 3.0]))
    rows = str(grid).splitlines()
    assert any("#" in row for row in rows[: len(rows) // 2])
    assert not any("#" in row for row in rows[len(rows) // 2 :])


@pytest.mark.long
async def test_a_recording_that_ends_early_is_drawn_all_the_same(tmp_path: Path) -> None:
    path = tmp_path / "short.mcap"
    async with lidario.open_lidar(SimulatedLidar()) as lidar, lidar.record(path) as recording:
        async for _ in lidar.scans():
            if recording.scans >= 3:
                break
    grid = await load("occupancy_grid").main(f"{path}?rate=0")
    assert (grid.cells > 0).any()


@asynccontextmanager
async def served(lidar: Any) -> AsyncIterator[tuple[Any, httpx.AsyncClient]]:
    app = load("web_app").app
    app.state.source = lidar
    asgi = httpx.ASGITransport(app)
    async with (
        app.router.lifespan_context(app),
        httpx.AsyncClient(transport=asgi, base_url="http://robot") as client,
    ):
        yield app, client


async def until(client: httpx.AsyncClient, status: int) -> Any:
    """What is answered as soon as that is the status."""
    async with asyncio.timeout(30):
        while (answer := await client.get("/nearest")).status_code != status:
            await asyncio.sleep(0.05)
    return answer.json()


@pytest.mark.long
async def test_web_app() -> None:
    lidar = SimulatedLidar(walls=[((2.0, -1.0), (2.0, 1.0))])
    async with served(lidar) as (app, client):
        assert (await client.get("/nearest")).status_code == 503
        assert (await until(client, 200))["range"] == pytest.approx(2.0, abs=0.01)
        told = (await client.get("/scan")).json()
        assert len(told["angles"]) == len(told["ranges"]) == len(app.state.scan)
        assert None in told["ranges"]
        assert told["units"]["ranges"] == "m"
        assert 'fetch("nearest")' in (await client.get("/")).text
    assert lidar.is_still


@pytest.mark.long
async def test_web_app_serves_no_old_scan() -> None:
    lidar = SimulatedLidar()
    async with served(lidar) as (_, client):
        await until(client, 200)
        lidar.fail("unplug:0.1s")
        assert await until(client, 503) == {"detail": "no scan lately: is the lidar connected?"}
        lidar.fail()
        await until(client, 200)


async def test_web_app_says_what_has_ended_its_reading(monkeypatch: pytest.MonkeyPatch) -> None:
    class Failing:
        async def __aenter__(self) -> Failing:
            return self

        async def __aexit__(self, *error: object) -> None:
            pass

        async def scans(self) -> AsyncIterator[lidario.Scan]:
            yield make_scan([0.0], [2.0], stamp_ns=round(asyncio.get_running_loop().time() * 1e9))
            raise lidario.StreamFailed("the rotor is held")

    monkeypatch.setattr(lidario, "open_lidar", lambda source, reconnect: Failing())
    with pytest.raises(lidario.StreamFailed, match="held"):
        async with served("auto") as (_, client):
            while "yet" in (detail := (await until(client, 503))["detail"]):
                await asyncio.sleep(0)
            assert detail == "the lidar is gone: the rotor is held"


@pytest.mark.long
async def test_record_on_trigger(tmp_path: Path) -> None:
    lidar = SimulatedLidar(bodies=[Body([(0, 3, 0), (2, 3, 0), (2.1, 0.5, 0), (2.6, 0.5, 0), (2.7, 3, 0)], 0.2)])
    with thread_takes_no_time():  # else much may happen while a slow disk makes the file
        files = await load("record_on_trigger").main(lidar, tmp_path)
    assert [path.name for path in files] == ["event-0.mcap"]
    scans = list(lidario.decode_file(files[0]))
    assert 8 < len(scans) < 30
    nearest = [found.range for scan in scans if (found := scan.nearest())]
    assert min(nearest) < 0.4
    assert nearest[-1] > 1.0
    assert lidar.is_still


def cells() -> list[dict[str, Any]]:
    found: list[dict[str, Any]] = json.loads(NOTEBOOK.read_text(encoding="utf-8"))["cells"]
    return found


@pytest.mark.long
def test_ctrl_c_ends_record_on_trigger(tmp_path: Path) -> None:
    program = f"""
import os, runpy, sys
os.chdir({str(tmp_path)!r})
sys.argv[1:] = ["sim://rplidar-s2?via=memory"]
runpy.run_module("record_on_trigger", run_name="__main__")
"""
    with running(program, PYTHONUNBUFFERED="1") as process:
        assert line_of(process.stdout).startswith("something is near")
        process.send_signal(signal.SIGINT)
        assert process.wait(30.0) == 0


@pytest.mark.long
def test_the_notebook_runs_from_top_to_bottom(capsys: pytest.CaptureFixture[str]) -> None:
    """Each cell in one namespace, and the value of its last line drawn, as a notebook does."""
    names: dict[str, Any] = {}
    shown = []
    for cell in cells():
        if cell["cell_type"] == "code":
            assert cell["outputs"] == []
            body = ast.parse("".join(cell["source"])).body
            last = body.pop() if isinstance(body[-1], ast.Expr) else None
            exec(compile(ast.Module(body, []), "cell", "exec"), names)
            if isinstance(last, ast.Expr):
                shown.append(eval(compile(ast.Expression(last.value), "cell", "eval"), names))
    assert [type(value).__name__ for value in shown] == ["DeviceInfo", "Scan", "Picture", "NoneType"]
    assert shown[2]._repr_svg_().count("<circle") > 1000
    assert capsys.readouterr().out.count(" m\n") == 8
