"""``lidario watch``: one frame in all sizes. On a terminal: test_stopped_terminal.py."""

import io
import re

import numpy as np
import pytest
from rich.console import Console

from lidario import DeviceInfo, Stats
from lidario.cli.watch import frame
from lidario.testing import make_scan
from lidario.web.feed import Feed
from lidario.web.traffic import traffic
from tests.cli.test_picture import FULL_TURN


def feed(ranges: float = 2.0, **changes: object) -> Feed:
    made = Feed("x")
    made.latest = make_scan(FULL_TURN, np.full(3600, ranges))
    made.info = DeviceInfo("family", "Model X1", 1, "1.0", 1, "AB")
    made.state = "scanning"
    for name, value in changes.items():
        setattr(made, name, value)
    return made


def drawn(what: Feed, width: int, height: int) -> list[str]:
    target = Console(file=io.StringIO(), width=width, height=height, force_terminal=True, color_system=None)
    return ["".join(part.text for part in line) for line in target.render_lines(frame(what, target), pad=False)]


@pytest.mark.parametrize(("width", "height"), [(40, 12), (80, 24), (100, 30), (200, 60), (20, 6)])
def test_a_frame_fits_its_terminal(width: int, height: int) -> None:
    lines = drawn(feed(), width, height)
    assert len(lines) <= height
    assert max(len(line.rstrip()) for line in lines) <= width
    assert sum("⠀" < character <= "⣿" for line in lines for character in line) > 10


def test_the_figures_stand_beside_or_below() -> None:
    beside = drawn(feed(), 110, 30)
    assert any(re.search(r"nearest\s+2\.00 m", line) for line in beside[:10])
    below = drawn(feed(), 80, 24)
    assert "nearest 2.00 m" in below[-1]


@pytest.mark.parametrize(("width", "least"), [(60, 5), (44, 5)])
def test_a_narrow_terminal_shows_each_figure_whole(width: int, least: int) -> None:
    line = traffic(Stats(), Stats(packets=97, lost_packets=3), 1.0, 0)
    lines = drawn(feed(line=line), width, 20)
    told = "  ".join(each.strip() for each in lines[-2:])
    shown = ("scanning", "10.0 Hz", "3600, 0 % no return", "nearest 2.00 m", "3.0 % of packets lost")
    assert sum(each in told for each in shown) >= least, told
    # No figure is cut where the line ends, and the picture does not go for it.
    assert not any("…" in each for each in lines)
    assert sum("⠀" < character <= "⣿" for each in lines[:-2] for character in each) > 10


def test_states_are_said_in_words() -> None:
    assert "no returns" in " ".join(drawn(feed(np.nan), 110, 30))
    lost = " ".join(" ".join(drawn(feed(state="lost", reason="it is gone"), 110, 30)).split())
    assert "lost, reconnecting" in lost
    lossy = feed(line=traffic(Stats(), Stats(packets=97, lost_packets=3), 1.0, 0))
    assert "3.0 % of packets lost" in " ".join(drawn(lossy, 110, 30))


def test_a_picture_that_is_drawn_again_stays_where_it_is() -> None:
    """A few millimetres more do not change the scale, and so not one cell of the rest."""
    assert drawn(feed(2.0), 80, 24)[-2] == drawn(feed(2.02), 80, 24)[-2]
