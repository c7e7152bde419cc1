"""Makes the pictures of README and documentation: ``python -m benchmarks.pictures``. Chromium is needed.

The page is what ``lidario view`` serves, after some seconds of a simulated lidar. The terminal is a frame of
``lidario watch``, set by the browser, so that it looks the same wherever it is made.
"""

from __future__ import annotations

import argparse
import asyncio
import base64
import io
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from html import escape

from rich.console import Console
from rich.style import Style
from rich.text import Text

from benchmarks.browser import Browser, Page
from benchmarks.picture_of_filters import SIZE, filters_page
from benchmarks.processes import ROOT, started
from lidario.cli.watch import frame
from lidario.web.feed import Feed

FOLDER = ROOT / "docs" / "pictures"
SOURCE = "sim://rplidar-s2?via=memory&seed=4"
WIDTH, HEIGHT = 100, 30
_LETTER, _LINE = 8.43, 17
_PLAIN = "#d6d9de"


def main() -> int:
    """Make them; returns the exit code."""
    argparse.ArgumentParser(prog="python -m benchmarks.pictures", description=__doc__).parse_args()
    FOLDER.mkdir(parents=True, exist_ok=True)
    text = asyncio.run(_frame())
    with Browser() as browser:
        for name, picture in zip(("view.png", "view-dark.png"), _page(browser), strict=True):
            (FOLDER / name).write_bytes(picture)
        for name, dark in (("strip.png", False), ("strip-dark.png", True)):
            (FOLDER / name).write_bytes(_strip(browser, dark=dark))
        for name, dark in (("masks.png", False), ("masks-dark.png", True)):
            (FOLDER / name).write_bytes(_masks(browser, dark=dark))
        for name, dark in (("filters.png", False), ("filters-dark.png", True)):
            page = browser.open("about:blank", width=SIZE[0], height=SIZE[1])
            page.ask(f"document.documentElement.innerHTML = {filters_page(dark=dark)!r}")
            (FOLDER / name).write_bytes(page.picture())
            page.close()
        page = browser.open("about:blank", width=round(WIDTH * _LETTER) + 32, height=HEIGHT * _LINE + 28)
        page.ask(f"document.documentElement.innerHTML = {as_html(text)!r}")
        (FOLDER / "watch.png").write_bytes(page.picture())
    for path in sorted(FOLDER.glob("*.png")):
        print(f"{path.relative_to(ROOT)}  {path.stat().st_size / 1000:.0f} kB")
    return 0


def _page(browser: Browser) -> tuple[bytes, bytes]:
    """The live page, light and dark."""
    with _live(browser, SOURCE, width=1000, height=600, dark=False) as page:
        page.until("seen.painted > 30 && lidars[0].load !== null")
        light = page.picture()
        page.ask("dispatchEvent(new KeyboardEvent('keydown', {key: 'd'}))")
        page.until("seen.painted > 40")
        return light, page.picture()


def _strip(browser: Browser, *, dark: bool) -> bytes:
    """Three moments of the page: live, the cable is out, and it is in again."""
    moments = (
        ("live", "seen.painted > 20 && lidars[0].load !== null"),
        ("the cable is out: why, and the last scan", "lidars[0].state === 'lost' && !dirty"),
        (
            "the cable is in: it goes on by itself",
            "lidars[0].state === 'scanning' && lidars[0].load > .5 && seen.painted > 40",
        ),
    )
    found = []
    with _live(browser, SOURCE + "&fault=replug:6s", width=680, height=500, dark=dark) as page:
        page.ask("document.getElementById('bar').hidden = true, dispatchEvent(new Event('resize'))")
        for words, moment in moments:
            page.until(moment)
            page.until("!dirty")
            shown = base64.b64encode(page.picture()).decode()
            found.append(
                f"<figure><img src='data:image/png;base64,{shown}'><figcaption>{words}</figcaption></figure>"
            )
    ground, ink = ("#111316", "#edeef0") if dark else ("#fafafa", "#1c2024")
    style = (
        f"body{{margin:0;background:{ground};color:{ink};display:flex;gap:12px;font:600 17px system-ui,sans-serif}}"
        "figure{margin:0;text-align:center}img{width:492px;border:1px solid #8888;box-sizing:border-box}"
        "figcaption{padding:4px}"
    )
    page = browser.open("about:blank", width=1500, height=398)
    page.ask(f"document.documentElement.innerHTML = {'<style>' + style + '</style>' + ''.join(found)!r}")
    page.until("[...document.images].length === 3 && [...document.images].every(each => each.complete)")
    made = page.picture()
    page.close()
    return made


def _masks(browser: Browser, *, dark: bool) -> bytes:
    """The live page with what a viewer has drawn to be left out: a box, and a sector that is just being drawn."""
    with _live(browser, SOURCE, width=1000, height=600, dark=dark) as page:
        page.until("seen.painted > 10 && !$('mask').hidden")
        page.key("+")  # from now on the picture does not fit itself to what is seen
        page.key("m")
        page.drag(*page.ask("[place(.4, .5), place(-.7, -.5)]"))
        page.key("m")
        page.drag(*page.ask("[place(-1.5, .8), place(-1.5, -.3)]"))
        page.until("masks.unsaved === 2 && lidars[0].load !== null")
        page.move(5, 300)
        page.until(f"seen.painted > {page.ask('seen.painted')} + 5 && !dirty")
        return page.picture()


@contextmanager
def _live(browser: Browser, source: str, *, width: int, height: int, dark: bool) -> Iterator[Page]:
    """The page of ``lidario view``."""
    with started("lidario", "view", source, "--port", "0") as (_, url):
        page = browser.open(url, width=width, height=height, dark=dark)
        yield page
        page.close()


async def _frame() -> str:
    """One frame of the terminal, with its colours."""
    feed = Feed(SOURCE)
    enough = asyncio.Event()
    feed.on_scan = lambda each: enough.set() if each.line is not None else None
    reading = asyncio.create_task(feed.run())
    await enough.wait()
    target = Console(
        file=io.StringIO(), width=WIDTH, height=HEIGHT, force_terminal=True, color_system="truecolor", _environ={}
    )
    with target.capture() as captured:
        target.print(frame(feed, target), end="")
    reading.cancel()
    await asyncio.wait([reading])
    return captured.get()


def as_html(ansi: str) -> str:
    """A page that shows the lines of a terminal as they are there."""
    console = Console(width=WIDTH, color_system="truecolor", force_terminal=True, _environ={})
    lines = [Text.from_ansi(line) for line in ansi.splitlines()]
    body = "\n".join("".join(_span(*segment[:2]) for segment in line.render(console)) for line in lines)
    return (
        f"<body style='margin:0;background:#16181c;color:{_PLAIN}'><pre style='margin:14px 16px;"
        f"font:14px/{_LINE}px DejaVu Sans Mono,monospace'>{body}</pre></body>"
    )


def _span(text: str, style: Style | None) -> str:
    # The type may lack these characters, and others have other widths.
    cell = "<i style='display:inline-block;width:1ch;font-style:normal;text-align:center'>{}</i>"
    shown = "".join(cell.format(each) if each > "\u2500" else escape(each) for each in text.rstrip("\n"))
    if style is None or (style.color is None and not style.bold):
        return shown
    colour = style.color.get_truecolor().hex if style.color else _PLAIN
    return f"<span style='color:{colour};font-weight:{700 if style.bold else 400}'>{shown}</span>"


if __name__ == "__main__":
    sys.exit(main())
