"""The tools of the page in a real browser: scale and legend, recording and playing.

Where no Chromium is installed these tests are not run, and the summary says so: `tests/conftest.py`.
"""

from __future__ import annotations

from pathlib import Path

import pytest

import lidario
from tests.support.recorded import record
from tests.web.shown import S2, Open, ink

pytestmark = pytest.mark.long


def test_the_colours_keep_their_scale_and_the_legend_tells_it(url: str, opened: Open) -> None:
    page = opened(url)
    page.until("seen.painted > 3")
    far = page.ask("view.far")
    assert far >= page.ask("scans[0].at(-1).far") > 0.6 * far
    # Nothing far is left: the scale stays. Fit begins it anew.
    page.ask("view.paused = true, scans[0].at(-1).ranges.fill(1500), measure(scans[0].at(-1)), dirty = true")
    page.until("!dirty")
    assert page.ask("view.far") == far
    page.key("0")
    page.until("!dirty")
    assert page.ask("view.far") == 2
    first, last = page.ask("[14, 12 + 24 * 7 - 2].map(x => [...pen.getImageData(x, 15, 1, 1).data].slice(0, 3))")
    assert [first, last] == page.ask(
        "[RAMP[0], RAMP[6]].map(c => [1, 3, 5].map(i => parseInt(c.slice(i, i + 2), 16)))"
    )


def test_intensity_is_shown_where_there_is_one(viewed: Open) -> None:
    page = viewed(S2, "--mode", "Standard")
    page.until("seen.painted > 1")
    page.key("c")
    page.until("document.querySelector('#hue').textContent === 'Colour: intensity' && !dirty")
    assert ink(page) > 300


def test_what_is_shown_is_recorded(viewed: Open, tmp_path: Path) -> None:
    page = viewed(S2, "--record", str(tmp_path))
    page.until("seen.painted > 1 && !$('record').hidden")
    page.click("#record")
    page.until("lidars[0].record.on && lidars[0].record.scans > 5")
    page.until("/recording rplidar-s2m1-ababab-.*mcap/.test(document.body.innerText)")
    assert page.ask("$('record').getAttribute('aria-pressed')") == "true"
    page.click("#record")
    page.until("!lidars[0].record.on && /recorded rplidar/.test(document.body.innerText)")
    # It is whole while the page goes on.
    (path,) = tmp_path.glob("*.mcap")
    assert len(list(lidario.decode_file(path))) >= 5
    assert lidario.summarize(path).damage == ""


def test_a_recording_is_moved_through_and_played_at_another_speed(viewed: Open, tmp_path: Path) -> None:
    path = record(tmp_path / "a.mcap", "sim://rplidar-s2", 60).path
    page = viewed(str(path))
    page.until("seen.painted > 1 && !$('play').hidden")
    assert page.ask("$('record').hidden")
    length = page.ask("lidars[0].play.length")
    assert length == pytest.approx(6, abs=0.5)
    # Dragged, the slider tells of a hundred places in a row. The server hears of the last, and closes nothing.
    page.ask("socket.first = true")
    page.ask(
        "for (let k = 1; k <= 100; k++) { $('at').value = k / 25; $('at').dispatchEvent(new Event('input')); }"
    )
    page.until("lidars[0].play.at > 4.2")
    assert page.ask("connected && socket.first")
    page.until("lidars[0].state === 'ended'")
    assert "the recording has ended" in page.text()
    # Behind its end it is played again, as slow as is wanted.
    page.ask("$('at').value = 1, $('rate').value = '0.5', play()")
    page.until("lidars[0].state === 'scanning' && lidars[0].play.rate === 0.5 && lidars[0].play.at > 1.2")
    assert page.ask("lidars[0].play.at") < 4
