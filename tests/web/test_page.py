"""The page in a real browser, used as a person uses it.

Where no Chromium is installed these tests are not run, and the summary says so: `tests/conftest.py`.
"""

from __future__ import annotations

import json

import pytest

from benchmarks.browser import Browser, Page
from tests.cli.processes import end, started
from tests.support.children import line_of, until
from tests.web.shown import S2, Open, ink

pytestmark = pytest.mark.long
EDGES = (
    "() => { const xs = [], ys = []; latest((scan, lidar) => cloud(scan, lidar, 1, (x, y) => {"
    " const [across, down] = place(x, y); xs.push(across); ys.push(down); }));"
    " for (const list of [xs, ys]) list.sort((a, b) => a - b);"
    " const cut = Math.floor(xs.length / 100);"
    " return [xs[cut], xs.at(-1 - cut), ys[cut], ys.at(-1 - cut)]; }"
)
"""Left, right, upper and lower edge of what is drawn, in dots, without the farthest hundredth."""


@pytest.fixture
def page(url: str, opened: Open) -> Page:
    """The page, which has drawn some scans."""
    made = opened(url)
    made.until("seen.painted > 1")
    return made


def test_scans_are_drawn_and_the_panel_tells_of_them(page: Page) -> None:
    assert ink(page) > 1000
    page.until("document.body.innerText.includes('link load') && lidars[0].load !== null")
    page.until("[...document.querySelectorAll('dd')].some(each => /^6\\d %$/.test(each.textContent))")
    rows = "[...document.querySelectorAll('dt')].map(each => [each.textContent, each.nextSibling.textContent])"
    told = dict(page.ask(rows))
    assert told["state"] == "scanning"
    assert told["mode"] == "DenseBoost"
    assert 3000 < int(told["samples"]) < 3400
    assert told["rate"].endswith(" Hz")
    assert told["serial"] == "AB" * 6
    assert " m at " in told["nearest"]
    assert told["packets lost"] == "0 %"


def test_the_room_is_drawn_where_it_is(page: Page) -> None:
    """The picture of the page against the scan that it was made of, in the browser's own numbers."""
    page.key(" ")
    page.until("view.paused && !dirty")
    hit = json.loads(
        page.ask(
            "(s => { let n = 0, all = 0; for (let i = 0; i < s.count; i += 20) if (s.ranges[i]) {"
            " const a = s.angles[i] * Math.PI / 32768, r = s.ranges[i] / 1000;"
            " const [x, y] = place(r * Math.cos(a), r * Math.sin(a));"
            " if (x < 1 || y < 1 || x > innerWidth - 300 || y > innerHeight - 60) continue; all++;"
            " const d = pen.getImageData(Math.floor(x), Math.floor(y), 1, 1).data;"
            " if (Math.max(d[0], d[1], d[2]) - Math.min(d[0], d[1], d[2]) > 40) n++; }"
            " return JSON.stringify([n, all]); })(scans[0].at(-1))"
        )
    )
    assert hit[1] > 100
    assert hit[0] > 0.97 * hit[1]
    # Forward is up, and left is left.
    assert page.ask("place(1, 0)[1] < place(0, 0)[1] && place(0, 1)[0] < place(0, 0)[0]")


def test_pause_stops_the_picture_and_goes_on(page: Page) -> None:
    page.click("#pause")
    page.until("document.querySelector('#words').textContent === 'paused'")
    assert page.ask("document.querySelector('#pause').getAttribute('aria-pressed')") == "true"
    before = page.ask("[scans[0].at(-1).seq, seen.scans]")
    # Scans still come, and are not shown.
    page.until(f"seen.scans > {before[1] + 3}")
    assert page.ask("scans[0].at(-1).seq") == before[0]
    # It is not the last one that came before a loss, either.
    came = page.ask("scans[0].at(-1).came.toLocaleTimeString()")
    lost = "warnings({...lidars[0], state: 'lost'}, scans[0].at(-1)).map(each => each[1])"
    assert page.ask(lost) == ["lost, reconnecting", f"The picture is of {came}."]
    page.click("#pause")
    page.until(f"scans[0].at(-1).seq > {before[0]}")


def test_zoom_and_pan_by_wheel_pointer_and_keys(page: Page) -> None:
    scale = page.ask("view.scale")
    under = page.ask("[(room().center - 200) / view.scale + view.x, (room().middle - 300) / view.scale + view.y]")
    page.wheel(300, 200, -400)
    page.until(f"view.scale > {scale * 1.3}")
    # What was under the pointer is still there.
    assert page.ask(f"place({under[0]}, {under[1]})") == pytest.approx([300, 200], abs=1.5)
    page.key("-")
    page.key("+")
    begin = page.ask("place(0, 0)")
    page.drag((400, 300), (450, 320))
    assert page.ask("place(0, 0)") == pytest.approx([begin[0] + 50, begin[1] + 20], abs=1.5)
    page.key("ArrowLeft")
    assert page.ask("place(0, 0)") == pytest.approx([begin[0] + 90, begin[1] + 20], abs=1.5)
    page.key("0")
    page.until(f"Math.abs(view.scale - {scale}) < {scale * 0.3} && view.fitted")


def test_a_trail_and_other_colours(url: str, opened: Open) -> None:
    page = opened(url)
    page.until("scans[0] && scans[0].length > 5")
    page.key("t")
    page.until("view.trail && !dirty")
    # This scan mode tells no intensity, so it is left out.
    assert page.ask("scans[0].at(-1).light") is None
    page.key("c")
    page.until("document.querySelector('#hue').textContent === 'Colour: lidar'")
    page.until("!dirty")
    assert ink(page) > 500


def test_the_picture_is_saved(page: Page, browser: Browser) -> None:
    page.key("s")
    until(lambda: [each for each in browser.downloads.glob("lidario-*.png") if each.stat().st_size])
    (saved,) = browser.downloads.glob("lidario-*.png")
    assert saved.read_bytes().startswith(b"\x89PNG\r\n")


@pytest.mark.parametrize("dark", [False, True])
def test_light_and_dark_as_the_system_has_it_until_it_is_chosen(url: str, opened: Open, dark: bool) -> None:
    page = opened(url, dark=dark)
    page.until("seen.painted > 1 && !dirty")
    ground = "pen.getImageData(canvas.width - 1, canvas.height / 2, 1, 1).data[0]"
    assert (page.ask(ground) < 100) is dark
    page.key("d")
    page.until("!dirty")
    page.until(f"({ground} < 100) === {str(not dark).lower()}")


def test_on_a_phone_nothing_is_outside_and_nothing_hides_the_lidar(url: str, opened: Open) -> None:
    page = opened(url, width=390, height=844, phone=True)
    page.until("seen.painted > 1 && lidars.length")
    assert page.ask("document.documentElement.scrollWidth") <= 390
    boxes = page.ask(
        "[...document.querySelectorAll('button, section')].filter(each => !each.hidden)"
        ".map(each => (r => [r.left, r.top, r.right, r.bottom])(each.getBoundingClientRect()))"
    )
    middle = page.ask("place(0, 0)")
    for left, top, right, bottom in boxes:
        assert 0 <= left < right <= 390
        assert 0 <= top < bottom <= 844
        assert not (left < middle[0] < right and top < middle[1] < bottom)
    # A finger needs 44 dots, in both directions.
    shown = "[...document.querySelectorAll('button')].filter(each => !each.hidden)"
    assert min(page.ask(f"{shown}.flatMap(each => [each.offsetWidth, each.offsetHeight])")) >= 44
    # The room, which is narrower than it is deep, fills what is free of the screen.
    edges = page.ask(f"({EDGES})()")
    assert edges[0] >= 0
    assert edges[1] <= 390
    assert edges[2] >= 0
    assert edges[3] <= min(top for _, top, _, _ in boxes)
    assert edges[1] - edges[0] > 0.75 * 390


def test_every_control_is_reached_by_the_keyboard_and_has_a_name(page: Page) -> None:
    reached = set()
    for _ in range(14):
        page.key("Tab")
        reached.add(page.ask("document.activeElement.id"))
    controls = {"pause", "in", "out", "fit", "trail", "hue", "ruler", "record", "save", "full", "theme"}
    assert {"view", *controls} <= reached
    titles = page.ask("[...document.querySelectorAll('button')].map(each => each.title)")
    # Not the key alone: what it does.
    assert all(len(title.split("(")[0].split()) >= 2 for title in titles)
    names = "[...document.querySelectorAll('button')].map(b => b.getAttribute('aria-label') || b.textContent)"
    assert all(page.ask(names))


def test_the_pointer_tells_distance_and_angle_and_the_ruler_measures(page: Page) -> None:
    page.key(" ")
    page.until("view.paused && !dirty")
    # A wall to the right, told from the scan itself; the pointer is 3 dots beside it.
    wall = "(s => { let i = 0; while (!(s.ranges[i] && s.angles[i] > 49000)) i++; return i; })(scans[0].at(-1))"
    index = page.ask(wall)
    metres, turned = page.ask(
        f"[scans[0].at(-1).ranges[{index}] / 1000, scans[0].at(-1).angles[{index}] * 360 / 65536]"
    )
    across, down = page.ask(
        f"place({metres} * Math.cos({turned} * Math.PI / 180), {metres} * Math.sin({turned} * Math.PI / 180))"
    )
    page.move(across + 3, down)
    page.until("hover && !dirty")
    told = page.ask("seenFrom(under(hover))")
    distance, angle = float(told.split(" m at ")[0]), float(told.split(" m at ")[1].rstrip("°"))
    assert distance == pytest.approx(metres, abs=0.1)
    assert angle == pytest.approx(turned - 360, abs=2)
    # One metre forward from here, on free ground.
    page.key("r")
    middle = page.ask("[place(0.2, 0), place(0.7, 0)]")
    for x, y in middle:
        page.move(x, y)
        page.drag((x, y), (x, y))
    page.until("marks.length === 2 && !dirty")
    assert page.ask("Math.hypot(marks[0][0] - marks[1][0], marks[0][1] - marks[1][1])") == pytest.approx(
        0.5, abs=0.02
    )
    page.key("r")
    assert page.ask("marks.length") == 0


def test_the_title_names_the_lidar_and_the_screen_is_filled(url: str, opened: Open) -> None:
    page = opened(url)
    page.until("document.title === 'RPLIDAR S2M1 – lidario'")
    page.key("f")
    page.until("document.fullscreenElement !== null")
    page.key("f")
    page.until("document.fullscreenElement === null")


def test_an_empty_scan_and_damage_are_said_in_words(opened: Open) -> None:
    empty = "sim://rplidar-s2?via=memory&world=empty"
    with started("view", empty, "sim://ydlidar-4ros?via=memory&fault=drop:0.05%", "--port", "0") as process:
        page = opened(line_of(process.stdout).strip())
        page.until("document.body.innerText.includes('no returns in any direction')")
        page.until("/[\\d.]+ % of the packets lost/.test(document.body.innerText)")
        end(process)
        page.until("document.body.innerText.includes('no connection to lidario, trying again')")
        assert "scanning" not in page.text()
        # The refused attempts to connect are the browser's complaints, not the page's; a closed one makes no more.
        page.close()
        page.complaints.clear()


def test_two_lidars_stand_where_they_are_mounted(viewed: Open) -> None:
    places = ["--mount", "0.5,0,0", "--mount=-1,0.8,90", "--colour", "#ff0000", "--colour", "#00ff00"]
    page = viewed(S2, "sim://ydlidar-4ros?via=memory", *places)
    page.until("scans.filter(Boolean).length === 2 && lidars.length === 2")
    assert page.ask("lidars.map(each => [each.x, each.y, each.yaw])") == [[0.5, 0, 0], [-1, 0.8, 90]]
    page.until("!dirty")
    for number, colour in enumerate(([255, 0, 0], [0, 255, 0])):
        spot = f"place(lidars[{number}].x, lidars[{number}].y)"
        drawn = page.ask(f"[...pen.getImageData(...{spot}.map(Math.round), 1, 1).data].slice(0, 3)")
        assert drawn == colour


ROW = "[...document.querySelectorAll('dt')].find(each => each.textContent === '%s').nextSibling.textContent"
STRONGEST = (
    "(d => { let most = 0; for (let i = 0; i < d.length; i += 12) {"
    " const x = i / 4 % canvas.width - place(0, 0)[0], y = Math.floor(i / 4 / canvas.width) - place(0, 0)[1],"
    " all = [d[i], d[i + 1], d[i + 2]];"
    # Without the arrow and the legend, which are never pale.
    " if (x * x + y * y > 400 && Math.floor(i / 4 / canvas.width) > 60)"
    " most = Math.max(most, Math.max(...all) - Math.min(...all));"
    " } return most; })(pen.getImageData(0, 0, canvas.width, canvas.height).data)"
)
"""The strongest colour of the picture, by every third dot."""


def test_after_unplugging_it_says_so_and_comes_back(viewed: Open) -> None:
    page = viewed(S2 + "&fault=replug:3s")
    page.until("document.body.innerText.includes('lost, reconnecting')")
    # The last scan is still there, paler, with its time; what is no more so is not told.
    last = page.ask("scans[0].at(-1).seq")
    came = page.ask("scans[0].at(-1).came.toLocaleTimeString()")
    page.until(f"document.body.innerText.includes('The picture is of {came}.')")
    # However long the reason is, with a source that has no place to break in.
    boxes = "[...document.querySelectorAll('section, dd, p')].map(each => each.getBoundingClientRect())"
    right = f"Math.max(...{boxes}.map(each => each.right))"
    assert page.ask(f"{right} <= innerWidth && $('side').scrollWidth <= $('side').clientWidth")
    assert [page.ask(ROW % name) for name in ("state", "rate", "latency")] == ["lost", "not known", "not known"]
    page.until("!dirty")
    assert ink(page) > 300
    pale = page.ask(STRONGEST)
    page.until(f"lidars[0].state === 'scanning' && scans[0].at(-1).seq !== {last}")
    page.until("!document.body.innerText.includes('lost, reconnecting')")
    page.until("seen.painted > 0 && !isOld(lidars[0]) && !dirty")
    assert page.ask(STRONGEST) > pale + 60
    assert page.ask(ROW % "rate").endswith(" Hz")
