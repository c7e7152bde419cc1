"""What the tests of the page look at."""

from __future__ import annotations

import subprocess
from collections.abc import Callable

from benchmarks.browser import Page
from tests.cli.processes import end

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


def end_both(process: subprocess.Popen[str], page: Page) -> None:
    """End the program as Ctrl-C does; what the browser says of a server that is gone is no complaint."""
    end(process)
    page.until("!connected")
    page.close()
    page.complaints.clear()
