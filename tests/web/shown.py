"""What the tests of the page look at."""

from __future__ import annotations

from collections.abc import Callable

from benchmarks.browser import Page

S2 = "sim://rplidar-s2?via=memory&serial=" + "AB" * 16
Open = Callable[..., Page]


def ink(page: Page) -> int:
    """How many dots of the canvas have a colour that is neither ground nor grid: all the grey ones."""
    return int(
        page.ask(
            "(d => { let n = 0; for (let i = 0; i < d.length; i += 4)"
            " if (Math.max(d[i], d[i+1], d[i+2]) - Math.min(d[i], d[i+1], d[i+2]) > 40) n++; return n; })"
            "(pen.getImageData(0, 0, canvas.width, canvas.height).data)"
        )
    )
