"""A lidar that is watched: opened, read, and read on after it was lost.

The first opening must succeed; its error is the caller's. From then on nothing ends it but a cancellation, and the
end of a recording: a viewer would rather see "lost, reconnecting" than an end. The session itself comes back
(``reconnect=True``). What it does not come back from, such as a fault that a reset does not cure, makes the feed
open the lidar again, at every second attempt by its serial number.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from typing import Final, Literal

from lidario import DeviceInfo, Lidar, LidarError, RecordingError, Scan, Stats, open_lidar
from lidario.web.traffic import Traffic, traffic

__all__ = ["Feed", "FeedState"]

FeedState = Literal["connecting", "scanning", "lost", "ended"]

_BACK_OFF_S: Final = (0.25, 0.5, 1.0, 2.0)
"""Pauses before each attempt to open it again; the last one is repeated."""
_TRAFFIC_S: Final = 1.0
"""Time over which damage and load are measured."""


class Feed:
    """One lidar and the latest of it; `guard` as for `open_lidar`.

    Attributes:
        source: Where it was asked for.
        mode: Scan mode that was asked for; None for the typical one.
        state: ``connecting`` until the first scan, then ``scanning``, or ``lost`` while it is away; ``ended``
            behind the end of a recording.
        reason: Why it was lost, or what the last attempt said; empty while it scans.
        info: What the device says it is; None before it was opened.
        latest: The latest scan; it stays when the lidar is lost. None before the first.
        line: What the line carried in the last second; None before the first second is over.
        scans: Scans so far.
        losses: Times it was lost.
        on_scan: Called with this feed for each scan.
        on_change: Called with this feed for each change of state.
    """

    def __init__(self, source: str, *, mode: str | int | None = None, guard: bool = False) -> None:
        self.source = source
        self.mode = mode
        self._guard = guard
        self.state: FeedState = "connecting"
        self.reason: str = ""
        self.info: DeviceInfo | None = None
        self.latest: Scan | None = None
        self.line: Traffic | None = None
        self.scans: int = 0
        self.losses: int = 0
        self.on_scan: Callable[[Feed], object] = lambda _: None
        self.on_change: Callable[[Feed], object] = lambda _: None
        self._attempts = 0

    async def run(self) -> None:
        """Read until cancelled, or to the end of a recording; laser and motor are off when it returns.

        Raises:
            LidarError: It could not be opened, or sent no scan, at the first time.
            RecordingError: A recording holds no full revolution.
        """
        while True:
            try:
                await self._read(self._where())
            except LidarError as error:
                if self.latest is None:
                    raise
                self._attempts += 1
                self._lose(str(error).partition("\n")[0])
            else:
                # Nobody else can stop a stream of this session: only a recording comes to its end.
                if self.latest is None:
                    raise RecordingError(f"{self.source} holds no full revolution")
                self.state, self.line = "ended", None
                self.on_change(self)
                return
            await asyncio.sleep(_BACK_OFF_S[min(self._attempts, len(_BACK_OFF_S)) - 1])

    def _where(self) -> str:
        """The source; at every second attempt to open it again, its serial number: a port may change its name."""
        is_port = self.source == "auto" or "://" not in self.source or self.source.startswith("serial:")
        if self._attempts % 2 and is_port and self.info is not None:
            return f"id:{self.info.serial}"
        return self.source

    async def _read(self, source: str) -> None:
        loop = asyncio.get_running_loop()
        async with open_lidar(source, reconnect=True, guard=self._guard) as lidar, lidar.scans(self.mode) as scans:
            self.info = lidar.info
            before, since = lidar.stats, loop.time()
            watching = asyncio.create_task(self._watch(lidar))
            try:
                async for scan in scans:
                    self.latest = scan
                    self.scans += 1
                    self._attempts = 0
                    if self.state != "scanning":
                        # Not from the opening on: the rotor needs its time, and nothing comes meanwhile.
                        before, since = lidar.stats, loop.time()
                        self.state, self.reason = "scanning", ""
                        self.on_change(self)
                    if loop.time() - since >= _TRAFFIC_S:
                        before, since = self._measure(lidar.stats, before, loop.time() - since, lidar.baudrate)
                    self.on_scan(self)
            finally:
                watching.cancel()
                await asyncio.wait([watching])

    async def _watch(self, lidar: Lidar) -> None:
        """Tell when the session has lost its line; the next scan tells that it is back."""
        async for change in lidar.line_changes():
            if change.state == "away":
                self._lose(change.reason.partition("\n")[0])

    def _measure(self, now: Stats, before: Stats, seconds: float, baudrate: int) -> tuple[Stats, float]:
        self.line = traffic(before, now, seconds, baudrate)
        return now, asyncio.get_running_loop().time()

    def _lose(self, reason: str) -> None:
        self.losses += self.state != "lost"
        self.state, self.reason, self.line = "lost", reason, None
        self.on_change(self)
