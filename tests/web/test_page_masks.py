"""Boxes and sectors that are left out, drawn on the page in a browser and saved."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from lidario import read_config
from lidario.filters import AngularBoundsFilter, BoxFilter
from tests.cli.processes import invoke_driven
from tests.support.messages import scans_of_file
from tests.web.shown import S2, Open


@pytest.mark.long
def test_box_and_sector_are_drawn_and_saved(viewed: Open, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "robot.toml"
    path.write_text("# mine\n")
    page = viewed(S2, "--config", str(path))
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
    page.until("view.mask === 'remove' && /shall be seen again/.test(document.body.innerText)")
    page.key("m")
    page.until("view.mask === ''")
    page.click("#keep")
    page.until("masks.unsaved === 0 && /saved in/.test(document.body.innerText)")
    kept = path.read_text()
    page.key("m")
    page.key("m")
    page.key("m")
    page.until("view.mask === 'remove'")
    middle = page.ask("place(0, -2)")
    page.drag(middle, middle)
    page.until(f"masks.unsaved === 1 && lidars[0].shapes.length === 1 && {inside} > 0")
    page.key("u")
    page.until(f"masks.unsaved === 0 && {inside} === 0")
    beside = page.ask("place(1.75, 1.25)")
    page.drag(beside, beside)
    page.until("masks.unsaved === 1 && lidars[0].shapes.length === 1")
    page.key("u")
    page.until("masks.unsaved === 0")
    assert path.read_text() == kept
    own = read_config(path).of("AB" * 16)
    box, sector = own.filters
    assert isinstance(box, BoxFilter)
    assert (box.min_x, box.max_x, box.min_y, box.max_y) == pytest.approx((-2, 2, -3.5, -0.5), abs=0.05)
    assert isinstance(sector, AngularBoundsFilter)
    assert path.read_text().startswith("# mine\n")
    check_recording(tmp_path, path, begin, finish)


def check_recording(tmp_path: Path, settings: Path, begin: float, finish: float) -> None:
    """A recording with scans has nothing in the sector that was drawn, nor in the box, read by others' programs."""
    run = tmp_path / "run.mcap"
    invoke_driven("record", S2, "-o", str(run), "-n", "3", "--scans", "--config", str(settings), code=0)
    scans = scans_of_file(run)
    assert len(scans) == 3
    for scan in scans:
        angles = np.remainder(scan.angle_min + np.arange(len(scan.ranges)) * scan.angle_increment, math.tau)
        assert np.isnan(scan.ranges[(angles > begin + 0.01) & (angles < finish - 0.01)]).all()
        x, y = scan.ranges * np.cos(angles), scan.ranges * np.sin(angles)
        assert not ((abs(x) < 1.9) & (y > -3.4) & (y < -0.6)).any()
        assert np.isfinite(scan.ranges).sum() > 1000


@pytest.mark.long
def test_the_network_may_not_write_unless_a_file_is_named(viewed: Open) -> None:
    page = viewed(S2, "--lan")
    page.until("seen.painted > 1")
    assert page.ask("$('mask').hidden && !masks.may")
