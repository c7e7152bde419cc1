"""``lidario watch``: the picture of the latest scan in the terminal, in place, for work over SSH.

It is drawn on the terminal's second screen, so that what was there before comes back at the end. Where the terminal
is wide, the figures stand beside the picture, else below it.

A frame is one text, written by `Writer` in a thread: a terminal that takes nothing (Ctrl-S, a slow line) then holds
up the drawing, and neither the lidar nor a signal. `rich.Live`, which draws in place too, is not used for that
reason: it writes where it is told to refresh. On the event loop that would hold up the reading of the lidar, and a
Ctrl-C would wait until the terminal takes bytes again. In its own thread it holds a lock while it writes, and
leaving it waits for that thread.
"""

from __future__ import annotations

import asyncio
import logging
import sys
from contextlib import ExitStack, suppress
from typing import TYPE_CHECKING, Final

import click

from lidario.cli.errors import ExitCode, Stopped
from lidario.cli.output import Writer, console, message, progress, rendered
from lidario.cli.parameters import complete_source

if TYPE_CHECKING:
    from rich.console import Console, RenderableType

    from lidario.web.feed import Feed

__all__ = ["figures", "frame", "watch"]

FRAME_S: Final = 0.1
REDRAW_S: Final = 1.0
"""A frame is drawn at least so often, also without a scan: the terminal may have another size by then."""
WIDE: Final = 92
BESIDE: Final = 30
_ENTER, _LEAVE = "\x1b[?1049h\x1b[?25l", "\x1b[?25h\x1b[?1049l"
_HOME, _TO_END_OF_LINE, _TO_END = "\x1b[H", "\x1b[K", "\x1b[J"


@click.command()
@click.argument("source", default="auto", shell_complete=complete_source)
@click.option("--mode", metavar="MODE", help="Scan mode by name or id, as `lidario info` lists them.")
def watch(source: str, mode: str | None) -> int:
    """Show live scans in the terminal, until Ctrl-C.

    A lidar that is lost is opened again as soon as it is back.
    """
    if not sys.stdout.isatty():
        raise click.UsageError(
            "watch draws on a terminal, and stdout is none; `lidario scan -n 0` prints to a pipe",
            click.get_current_context(),
        )
    from lidario.cli.running import run
    from lidario.web.feed import Feed

    feed = Feed(source, mode=int(mode) if mode is not None and mode.isdecimal() else mode)
    writer = Writer()
    # The picture says what the log would say, and a line of the log would run through it.
    quiet = logging.NullHandler()
    logging.getLogger("lidario").addHandler(quiet)
    try:
        with suppress(Stopped):
            run(lambda: _draw(feed, writer))
    finally:
        writer.close()
        logging.getLogger("lidario").removeHandler(quiet)
    lost = f", lost {feed.losses} time{'s' if feed.losses > 1 else ''}" if feed.losses else ""
    message(f"{feed.scans} scans of {feed.info.model if feed.info else source}{lost}")
    return ExitCode.OK


async def _draw(feed: Feed, writer: Writer) -> None:
    changed = asyncio.Event()
    feed.on_scan = feed.on_change = lambda _: changed.set()
    reading = asyncio.create_task(feed.run())
    reading.add_done_callback(lambda _: changed.set())
    entered = False
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
                    await writer.write(_ENTER)
                    entered = True
                await writer.write(_in_place(frame(feed, console())))
                await asyncio.sleep(FRAME_S)
    finally:
        reading.cancel()
        await asyncio.wait([reading])
        if entered:
            # Not awaited: a terminal that takes no output must not keep the program from ending.
            writer.put(_LEAVE)


def frame(feed: Feed, target: Console) -> str:
    """The lines of one frame, at most as many and as long as `target` has."""
    from rich.table import Table

    from lidario.cli.picture import picture

    assert feed.latest is not None
    # Asked for once: the terminal may get another size while this frame is drawn.
    target.size = target.size
    width, height = target.size
    lines = figures(feed)
    wide = width >= WIDE
    below = [] if wide else [f"{_line(lines)}"]
    size = (width - 1 - (BESIDE if wide else 0), height - 2 - len(below))
    drawing: RenderableType = picture(feed.latest, target, size=size)
    if wide:
        panel = Table.grid(padding=(0, 1))
        panel.add_column(style="bold")
        panel.add_column(overflow="fold")
        for name, value in lines:
            panel.add_row(name, value)
        both = Table.grid()
        both.add_column(width=size[0], no_wrap=True)
        both.add_column(width=BESIDE)
        both.add_row(drawing, panel)
        drawing = both
    text = rendered(target, drawing, *[line[:width] for line in below])
    return "\n".join(text.splitlines()[:height])


def figures(feed: Feed) -> list[tuple[str, str]]:
    """Names and values of what stands beside the picture."""
    import numpy as np

    from lidario.cli.stats import percent

    scan = feed.latest
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
        ("points", f"{len(scan)}, {percent(1 - hits / max(len(scan), 1))} no return"),
        ("nearest", nearest),
    ]
    if feed.line is not None:
        rows.append(("damage", f"{percent(feed.line.damaged)} damaged"))
        if feed.line.load is not None:
            rows.append(("link", f"{percent(feed.line.load)} of the line"))
    return rows


def _line(rows: list[tuple[str, str]]) -> str:
    return "  ".join(value for name, value in rows if name not in ("model", "mode", "link"))


def _in_place(text: str) -> str:
    """Written over the frame before, without a blank screen between the two."""
    return _HOME + text.replace("\n", _TO_END_OF_LINE + "\n") + _TO_END_OF_LINE + _TO_END
