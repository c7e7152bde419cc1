"""The live page: its weight, what a viewer costs the server, and how late the picture is.

A separate process plays an S2 on a pseudo-terminal. ``lidario view`` reads it as a process of its own, whose time
on the processor is read from ``/proc`` (all threads, in nanoseconds), with no viewer, one, and three. Viewers are
connections of this process that confirm each scan at once; beside them stands `benchmarks.reader`, which only
scans. The time until a scan is painted is measured in Chromium, where one is installed: from the end of the
revolution to the end of the drawing, by the one clock of this machine.
"""

from __future__ import annotations

import asyncio
import struct
import subprocess
import threading
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from typing import Any, Final

import numpy as np
from websockets.asyncio.client import connect as connect_async
from websockets.exceptions import WebSocketException
from websockets.sync.client import connect
from websockets.typing import Origin

from benchmarks.browser import Browser, find_browser
from benchmarks.contest import Entry, read_live
from benchmarks.processes import Failed, Player, started
from benchmarks.report import Result, Setting, Table, median, percentile, spread
from benchmarks.usage import resident_mb, share_of
from lidario import Scan
from lidario.testing import make_scan
from lidario.web.feed import Feed
from lidario.web.server import LiveServer

RATE: Final = "S2 DenseBoost"
_NOTE_PAINTED: Final = (
    "confirmed = (was => () => {"
    " if (unconfirmed) seen.all.push(now() - Math.max(...scans.map(kept => kept.at(-1).ended)));"
    " was(); })(confirmed)"
)
"""The page confirms a scan when it has drawn it."""
_SCANS_A_SECOND: Final = 300
_TEN_MINUTES: Final = 6000
"""Scans of ten minutes at 10 Hz."""


def run(setting: Setting) -> Result:
    """Everything once; what a viewer costs, several times in turn."""
    rounds, window_s = (1, 0.5) if setting.quick else (3, 4.0)
    data: dict[str, Any] = {"page_bytes": asyncio.run(_page_bytes()), "cpu": {}, "paint_ms": [], "arrival_ms": []}
    with Player(RATE) as player:
        for number in range(rounds):
            setting.say(f"view: round {number + 1} of {rounds}")
            _one_round(setting, player, window_s, data)
        player.report()
        if find_browser() is not None:
            setting.say("view: in the browser")
            data["paint_ms"] = _painted(player.paths[0], window_s)
        player.report()
        data["stalled"] = _beside_a_stalled_one(player.paths[0], window_s)
    setting.say("view: ten minutes' scans")
    data["growth_kb"] = asyncio.run(grown(200 if setting.quick else _TEN_MINUTES))
    return Result("view", [table_of(data)], data)


def _one_round(setting: Setting, player: Player, window_s: float, data: dict[str, Any]) -> None:
    def note(name: str, value: float) -> None:
        data["cpu"].setdefault(name, []).append(100 * value)

    with suppress(Failed):
        entry = Entry("lidario", latency=0.005)
        note("scanning alone", read_live(setting, entry, RATE, player, settle_s=0.5, window_s=window_s)[0]["cpu"])
    with _viewing(player.paths[0]) as (process, url):
        for viewers in (0, 1, 3):
            with ExitStack() as stack:
                watching = [stack.enter_context(_viewer(url)) for _ in range(viewers)]
                time.sleep(0.5)
                note(f"viewers: {viewers}", share_of(process.pid, window_s))
            data["arrival_ms"] += [late for each in watching for late in each]


@contextmanager
def _viewing(path: str) -> Iterator[tuple[subprocess.Popen[str], str]]:
    """``lidario view`` as a process, and its address."""
    with started("lidario", "view", f"serial://{path}?baud=1000000&family=rplidar", "--port", "0") as viewing:
        yield viewing


@contextmanager
def _viewer(url: str, *, confirms: bool = True) -> Iterator[list[float]]:
    """A connection that confirms as the page does, two at once, or not at all; lists how late scans came, in ms."""
    late: list[float] = []
    address = "ws" + url.removeprefix("http") + "live"
    with connect(address, origin=Origin(url.rstrip("/")), compression=None, proxy=None) as socket:
        if not confirms:
            yield late
            return

        def read() -> None:
            with suppress(WebSocketException):
                for message in socket:
                    if isinstance(message, bytes):
                        late.append(time.time() * 1000 - struct.unpack_from("<d", message, 8)[0])
                        if len(late) % 2 == 0:
                            socket.send("a")
                            socket.send("a")

        thread = threading.Thread(target=read)
        thread.start()
        yield late
        socket.close()
        thread.join()


def _painted(path: str, window_s: float) -> list[float]:
    """Milliseconds from the end of each revolution to the end of its drawing."""
    found: list[float] = []
    with _viewing(path) as (_, url), Browser() as browser:
        page = browser.open(url)
        # One machine has one clock; the page would estimate the difference.
        page.until("seen.painted > 3")
        page.ask("clock = 0, best = -1e9, seen.all = []")
        page.ask(_NOTE_PAINTED)
        time.sleep(max(window_s, 1.0))
        found = page.ask("seen.all")
        page.close()
    return found


def _beside_a_stalled_one(path: str, window_s: float) -> dict[str, float]:
    """Scans a second that a viewer gets alone, and beside three that have stopped reading."""
    found = {}
    with _viewing(path) as (process, url):
        for name, count in (("alone", 0), ("beside three that stopped reading", 3)):
            with ExitStack() as stack:
                for _ in range(count):
                    stack.enter_context(_viewer(url, confirms=False))
                late = stack.enter_context(_viewer(url))
                time.sleep(0.5)
                before = len(late)
                found[f"{name}, CPU"] = 100 * share_of(process.pid, window_s)
                found[name] = (len(late) - before) / window_s
    return found


async def grown(scans: int) -> float:
    """How much more memory is resident after so many scans, in kB, while one viewer reads and one does not."""
    feed = Feed("x")
    async with LiveServer([feed], host="127.0.0.1", port=0) as server:
        host = f"http://localhost:{server.port}"
        address = f"ws://localhost:{server.port}/live"
        options: dict[str, Any] = {"origin": Origin(host), "compression": None, "proxy": None}
        async with connect_async(address, **options) as reading, connect_async(address, **options):
            begun = 0.0
            for number in range(-50, scans):
                if number == 0:
                    begun = resident_mb()
                feed.latest = _scan(number + 50)
                server.publish_scan(feed)
                while isinstance(await reading.recv(), str):
                    pass
                await reading.send("a")
                # Slower than the server lets a viewer talk.
                await asyncio.sleep(1 / _SCANS_A_SECOND)
            return (resident_mb() - begun) * 1024


def _scan(number: int) -> Scan:
    return make_scan(-np.radians(np.arange(3200) * 360 / 3200), 1.0 + number % 100 / 1000, seq=number)


async def _page_bytes() -> int:
    """What a browser is sent."""
    async with LiveServer([], host="127.0.0.1", port=0) as server:
        reader, writer = await asyncio.open_connection("127.0.0.1", server.port)
        writer.write(f"GET / HTTP/1.1\r\nHost: localhost:{server.port}\r\n\r\n".encode())
        _, _, body = (await reader.read()).partition(b"\r\n\r\n")
        writer.close()
    return len(body)


def table_of(data: dict[str, Any]) -> Table:
    """For people."""
    table = Table("view: the live page, S2 at 32 kS/s", ["what", "found", "aim"])
    cpu = data["cpu"]
    alone = cpu.get("viewers: 0", [])
    table.add("page", f"{data['page_bytes'] / 1000:.1f} kB", "under 25 kB")
    aims = {"viewers: 1": "0.5 % more", "viewers: 3": "0.8 % more"}
    for name, values in cpu.items():
        more = [value - base for value, base in zip(values, alone, strict=False)]
        text = f"{spread(values, 2)} %" + (f", {median(more):+.2f} %" if name in aims else "")
        table.add(f"CPU of the server, {name}, % of a core", text, aims.get(name, ""))
    late, paint = data["arrival_ms"], data["paint_ms"]
    arrived = f"{median(late):.1f} ms, 95 %: {percentile(late, 95):.1f}"
    table.add("end of revolution to viewer", arrived, "")
    painted = f"{median(paint):.1f} ms, 95 %: {percentile(paint, 95):.1f}" if paint else "not run: no Chromium"
    table.add("end of revolution to picture", painted, "")
    stalled = data["stalled"]
    for name in ("alone", "beside three that stopped reading"):
        text = f"{stalled[name]:.1f} scans/s, server {stalled[f'{name}, CPU']:.2f} % of a core"
        table.add(f"a viewer {name}", text, "" if name == "alone" else "as alone")
    table.add("memory after the scans of ten minutes", f"{data['growth_kb']:+.0f} kB", "no growth")
    table.notes.append("the picture is drawn by Chromium without a graphics processor, on the same cores")
    return table
