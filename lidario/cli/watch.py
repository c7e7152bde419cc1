"""``lidario watch``: the picture of the latest scan in the terminal, in place, for work over SSH.

It is drawn on the terminal's second screen, so that what was there before comes back at the end. Where the terminal
is wide, the figures stand beside the picture, else below it.

It is drawn in the thread of a `Worker`. At the end laser and motor are switched off first; then the display has
`GRACE_S` to leave the second screen.
"""

import asyncio
import sys
from contextlib import ExitStack, suppress
from functools import partial
from textwrap import wrap
from typing import TYPE_CHECKING, Final

import click

from lidario.basics.words import counted
from lidario.cli.errors import Stopped
from lidario.cli.output import Worker, console, facts, progress, rendered
from lidario.cli.parameters import guard_option, mode_option, source_argument
from lidario.cli.running import nothing_logged, run
from lidario.cli.settings import config_file, config_option
from lidario.cli.stats import percent
from lidario.cli.streams import can_be_drawn_on, emit, message

if TYPE_CHECKING:
    from rich.console import Console, RenderableType

    from lidario.web.feed import Feed

FRAME_S: Final = 0.1
REDRAW_S: Final = 1.0
"""A frame is drawn at least so often, also without a scan: the terminal may have another size by then."""
ENTER: Final = "\x1b[?1049h\x1b[?25l"
LEAVE: Final = "\x1b[?25h\x1b[?1049l"
"""To the second screen of a terminal, without its cursor, and back."""
WIDE: Final = 92
BESIDE: Final = 30
MOST_BELOW: Final = 2


@click.command()
@source_argument
@config_option
@mode_option
@guard_option
def watch(source: str, mode: str | int | None, guard: bool) -> None:
    """Show live scans in the terminal, until Ctrl-C.

    A lidar that is lost is opened again as soon as it is back.
    """
    if not sys.stdout.isatty():
        raise click.UsageError(
            "watch draws on a terminal, and stdout is none; `lidario scan -n 0` prints to a pipe"
        )
    if not can_be_drawn_on(sys.stdout):
        raise click.UsageError(
            "watch needs a terminal whose cursor moves, and TERM says that this one's does not; "
            "`lidario scan -n 0` prints line by line"
        )
    from lidario.web.feed import Feed

    feed = Feed(source, mode=mode, guard=guard, config=config_file())
    writer = Worker("lidario: stdout")
    try:
        # The picture says what the log would say, and a line of the log would run through it.
        with suppress(Stopped), nothing_logged():
            run(lambda: _draw(feed, writer))
    finally:
        taken = writer.close()
    lost = f", lost {counted(feed.losses, 'time')}" if feed.losses else ""
    if taken:
        # Else the terminal takes no output, and this line would only keep the program from ending.
        message(f"{counted(feed.scans, 'scan')} of {feed.info.model if feed.info else source}{lost}")


async def _draw(feed: "Feed", writer: Worker) -> None:
    changed = asyncio.Event()
    feed.on_scan = feed.on_change = lambda _: changed.set()
    reading = asyncio.create_task(feed.run())
    reading.add_done_callback(lambda _: changed.set())
    target, entered = console(), False

    def draw() -> None:
        lines = rendered(target, frame(feed, target)).splitlines()[: target.height]
        emit("\x1b[H" + "\x1b[K\n".join(lines) + "\x1b[J")

    try:
        with ExitStack() as waiting:
            waiting.enter_context(progress(f"waiting for {feed.source} …"))
            while True:
                with suppress(TimeoutError):
                    await asyncio.wait_for(changed.wait(), REDRAW_S)
                changed.clear()
                if reading.done():
                    reading.result()
                if feed.latest is None:
                    continue
                if not entered:
                    waiting.close()
                    entered = True
                    await writer.call(partial(emit, ENTER))
                await writer.call(draw)
                await asyncio.sleep(FRAME_S)
    finally:
        reading.cancel()
        await asyncio.wait([reading])
        # Not awaited: a terminal that takes no output must not keep the program from ending.
        if entered:
            writer.put(partial(emit, LEAVE))


def frame(feed: "Feed", target: "Console") -> "RenderableType":
    """The picture of the latest scan and the figures, made for the size that the terminal has now.

    It may be drawn in another thread than the one that reads the lidar.
    """
    from rich.console import Group
    from rich.table import Table
    from rich.text import Text

    from lidario.cli.picture import picture

    assert feed.latest is not None
    width, height = target.size
    lines = figures(feed)
    wide = width >= WIDE
    below = [] if wide else _below(lines, width - 1)
    size = (width - 1 - (BESIDE if wide else 0), height - 2 - len(below))
    drawing = picture(feed.latest, target, size=size)
    if not wide:
        return Group(drawing, Text("\n".join(below), no_wrap=True, overflow="crop"))
    both = Table.grid()
    both.add_column(width=size[0], no_wrap=True)
    both.add_column(width=BESIDE)
    both.add_row(drawing, facts(lines, gap=1))
    return both


def figures(feed: "Feed") -> list[tuple[str, str]]:
    """Names and values of what stands beside the picture."""
    import numpy as np

    scan, line = feed.latest, feed.line
    assert scan is not None
    hits = int(np.count_nonzero(scan.valid))
    nearest = f"{float(np.nanmin(scan.ranges)):.2f} m" if hits else "no returns"
    state = {
        "lost": "lost, reconnecting" + (f" ({feed.reason})" if feed.reason else ""),
        "ended": "the recording has ended",
    }.get(feed.state, feed.state)
    rows = [
        ("state", state),
        ("model", feed.info.model if feed.info else ""),
        ("mode", scan.mode),
        ("rate", f"{scan.rpm / 60:.1f} Hz" if scan.rpm == scan.rpm else "not known"),
        ("samples", f"{len(scan)}, {percent(1 - hits / max(len(scan), 1))} no return"),
        ("nearest", nearest),
    ]
    if line is not None:
        rows.append(("loss", f"{percent(line.damaged)} of packets lost"))
        if line.load is not None:
            rows.append(("link", f"{percent(line.load)} of the line"))
    return rows


def _below(rows: list[tuple[str, str]], width: int) -> list[str]:
    """The figures as lines that a narrow terminal shows whole, the most important ones first."""
    told = dict(rows)
    if told["nearest"].endswith(" m"):
        told["nearest"] = f"nearest {told['nearest']}"
    # Each is one word here, so that none is divided.
    words = [value.replace(" ", "\0") for name, value in told.items() if name not in ("model", "mode", "link")]
    lines = wrap("  ".join(words), width, break_long_words=False, break_on_hyphens=False)
    return [line.replace("\0", " ") for line in lines[:MOST_BELOW]]
