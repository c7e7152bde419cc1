"""What a viewer draws: at once in what is shown, and saved for every program."""

from __future__ import annotations

import math
from pathlib import Path

import pytest

from lidario import Mount, read_config
from lidario.filters import AngularBoundsFilter, BoxFilter
from lidario.model import DeviceInfo
from lidario.web.feed import Feed
from lidario.web.masks import Masks
from tests.cli.processes import invoke, line_of, started
from tests.web.shown import S2, Open, end


def feeds(count: int) -> list[Feed]:
    made = [Feed(f"lidar {number}") for number in range(count)]
    for number, feed in enumerate(made):
        feed.info = DeviceInfo("f", "m", 1, "1.0", 1, f"S{number}")
    return made


def test_boxes_are_for_all_and_sectors_for_one(tmp_path: Path) -> None:
    shown, path = feeds(2), tmp_path / "a.toml"
    masks = Masks(shown, lambda feed: Mount(1.0 if feed is shown[1] else 0.0), path)
    assert masks.receive("b0.5 -0.5 -1.000 1.25")
    assert masks.receive("s1 10.00 30.00")
    box, sector = (-0.5, 0.5, -1.0, 1.25), AngularBoundsFilter([(math.radians(10), math.radians(30))], invert=True)
    assert shown[0].drawn == [BoxFilter(*box)]
    assert shown[1].drawn == [BoxFilter(*box, mount=Mount(1.0)), sector]
    assert masks.state() == {"may": True, "unsaved": 2, "said": ""}
    assert masks.receive("undo")
    assert len(shown[1].drawn) == 1
    assert masks.receive("save")
    assert masks.state() == {"may": True, "unsaved": 0, "said": f"saved in {path}"}
    assert read_config(path).of("s1").filters == (BoxFilter(*box, mount=Mount(1.0)),)
    assert masks.receive("undo")  # harmless


@pytest.mark.parametrize(
    "message", ["b1 2 3", "b1 2 3 4 5", "s9 1 2", "s0 30 10", "s0 0 400", "b1e9 2 3 4", "bnan 1 1 1", "saved", ""]
)
def test_strange_messages_are_refused(tmp_path: Path, message: str) -> None:
    assert not Masks(feeds(1), lambda _: Mount(), tmp_path / "a.toml").receive(message)
    assert not Masks(feeds(1), lambda _: Mount(), None).receive("b1 2 3 4")


def test_a_lidar_that_tells_no_serial_number(tmp_path: Path) -> None:
    path = tmp_path / "a.toml"
    for count, said in ((1, f"saved in {path}"), (2, "lidar 0 tells no serial number")):
        shown = feeds(count)
        shown[0].info = DeviceInfo("f", "m", 1, "1.0", 1, "")
        masks = Masks(shown, lambda _: Mount(), path)
        masks.receive("b0 1 0 1")
        masks.receive("save")
        assert masks.said.startswith(said)
    assert len(read_config(path).default.filters) == 1


def test_no_more_than_fifty_and_a_file_that_cannot_be_written(tmp_path: Path) -> None:
    shown = feeds(1)
    masks = Masks(shown, lambda _: Mount(), tmp_path / "none" / "a.toml")
    for _ in range(60):
        assert masks.receive("b0 1 0 1")
    assert len(shown[0].drawn) == 50
    masks.receive("save")
    assert "cannot be written" in masks.said
    assert masks.state()["unsaved"] == 50


def test_a_box_and_a_sector_are_drawn_and_saved(
    opened: Open, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "robot.toml"
    path.write_text("# mine\n")
    with started("view", S2, "--port", "0", "--config", str(path)) as process:
        page = opened(line_of(process.stdout).strip())
        page.until("seen.painted > 1 && !$('mask').hidden")
        assert page.ask("$('keep').hidden")
        page.key("m")
        page.until("view.mask === 'box' && /Drag a box/.test(document.body.innerText)")
        start, stop = page.ask("[place(2, -3.5), place(-2, -0.5)]")
        page.drag(start, stop)
        page.until("masks.unsaved === 1 && lidars[0].shapes.length === 1")
        inside = (
            "(() => { let n = 0; cloud(scans[0].at(-1), lidars[0], 1, (x, y) => {"
            " n += Math.abs(x) < 1.9 && y < -0.6 && y > -3.4; }); return n; })()"
        )
        page.until(f"{inside} === 0")
        page.key("m")
        page.until("view.mask === 'sector'")
        start, stop = page.ask("[place(2, 0.5), place(1.5, 2)]")
        page.drag(start, stop)
        page.until("masks.unsaved === 2")
        page.key("u")
        page.until("masks.unsaved === 1")
        page.drag(start, stop)
        page.until("masks.unsaved === 2")
        begin, finish = page.ask("lidars[0].shapes[1]")
        assert begin == pytest.approx(math.atan2(0.5, 2), abs=0.03)
        assert finish == pytest.approx(math.atan2(2, 1.5), abs=0.03)
        page.key("m")
        page.click("#keep")
        page.until("masks.unsaved === 0 && /saved in/.test(document.body.innerText)")
        end(process, page)
    own = read_config(path).of("AB" * 16)
    box, sector = own.filters
    assert isinstance(box, BoxFilter)
    assert (box.min_x, box.max_x, box.min_y, box.max_y) == pytest.approx((-2, 2, -3.5, -0.5), abs=0.05)
    assert isinstance(sector, AngularBoundsFilter)
    assert path.read_text().startswith("# mine\n")
    done = invoke("scan", S2, "--json", "--config", str(path))
    assert done.exit_code == 0, done.stderr


def test_the_network_may_not_write_unless_a_file_is_named(opened: Open) -> None:
    with started("view", S2, "--port", "0", "--lan") as process:
        url = line_of(process.stdout).strip()
        page = opened(url.replace(url.split("/")[2].split(":")[0], "127.0.0.1"))
        page.until("seen.painted > 1")
        assert page.ask("$('mask').hidden && !masks.may")
        end(process, page)
