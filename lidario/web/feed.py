"""A lidar that is watched: opened, read, and read on after it was lost.

The first opening must succeed; its error is the caller's. From then on nothing ends it but a cancellation, and the
end of a recording: a viewer would rather see "lost, reconnecting" than an end. The session itself comes back
(``reconnect=True``), also at a port with another name. A recording may be played on from another place, and at
another speed. What the session does not come back from makes the feed open the same source again, and no other:
the lidar that a recording is of, or that another machine publishes, may be plugged in here.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Final, Literal
from urllib.parse import parse_qsl, urlencode

import lidario
from lidario.filters import Filter
from lidario.web.keeper import Keeper
from lidario.web.traffic import Traffic, traffic

FeedState = Literal["connecting", "scanning", "lost", "ended"]

_BACK_OFF_S: Final = (0.25, 0.5, 1.0, 2.0)
"""Pauses before each attempt to open it again; the last one is repeated."""
_LAST_S: Final = 0.5
"""Seconds before its end from which a recording still has a scan to show."""
_TRAFFIC_S: Final = 1.0
"""Time over which damage and load are measured."""


class Feed:
    """One lidar and the latest of it; `source`, `mode` and `guard` are as for `open_lidar`.

    Args:
        stays: Whether it waits behind the end of a recording, to be played again.
        folder: Where it may be recorded; None for nowhere.
        config: The file of settings; None for none. It is read at each opening.
        mount: Where it is mounted; None for what its settings say, or else the origin.
        colour: As ``#rrggbb``; empty for one that the page chooses.
    """

    def __init__(
        self,
        source: str,
        *,
        mode: str | int | None = None,
        guard: bool = False,
        stays: bool = False,
        folder: Path | None = None,
        config: str | None = None,
        mount: lidario.Mount | None = None,
        colour: str = "",
    ) -> None:
        self.source = source
        self.mode = mode
        self._guard = guard
        # ``connecting`` until the first scan, then ``scanning``, or ``lost`` while it is away; ``ended`` behind the
        # end of a recording.
        self.state: FeedState = "connecting"
        self.reason: str = ""  # why it was lost, or what the last attempt said; empty while it scans
        self.info: lidario.DeviceInfo | None = None
        self.config: lidario.LidarConfig = lidario.LidarConfig()
        self.saved: tuple[Filter, ...] = ()  # the filters of its settings
        self.drawn: list[Filter] = []  # filters that viewers have added, and have not saved
        self.removed: list[Filter] = []  # filters, among both, that viewers have taken away, and have not saved
        self.colour = colour
        self._mount = mount
        self._config = config
        self.latest: lidario.Scan | None = None  # the latest scan; it stays when the lidar is lost
        self.line: Traffic | None = None  # what the line carried in the last second
        self.scans: int = 0
        self.losses: int = 0
        self.on_scan: Callable[[Feed], object] = lambda _: None
        self.on_change: Callable[[Feed], object] = lambda _: None
        # Seconds that a recording lasts; None of a lidar, and before it was opened.
        self.length_s: float | None = None
        self.reached_s: float = 0.0  # seconds of it that have been played, with the latest scan
        options = dict(parse_qsl(source.partition("?")[2]))
        self.rate: float = _number(options.get("rate"), 1.0)
        # Records it; None where it may not be recorded, as a recording.
        self.keeper: Keeper | None = None if folder is None else Keeper(folder, lambda: self.on_change(self))
        self._stays = stays
        self._attempts = 0
        self._begin_s = _number(options.get("from"), 0.0)  # where the recording is played from
        self._moved = asyncio.Event()

    @property
    def filters(self) -> tuple[Filter, ...]:
        """What its scans pass."""
        return tuple(each for each in (*self.saved, *self.drawn) if each not in self.removed)

    @property
    def place(self) -> lidario.Mount:
        """Where it is on the robot: as the caller says, else as its settings say."""
        return self._mount or self.config.mount or lidario.Mount()

    def play_from(self, seconds: float, rate: float) -> None:
        """Play the recording on from that place, so many times as fast; anything else takes no notice."""
        if self.length_s is not None:
            self._begin_s, self.rate = min(max(seconds, 0.0), max(self.length_s - _LAST_S, 0.0)), rate
            self._moved.set()

    async def run(self) -> None:
        """Read until cancelled, or to the end of a recording; laser and motor are off when it returns.

        Raises:
            LidarError: It could not be opened, or sent no scan, at the first time.
            RecordingError: A recording holds no full revolution.
        """
        while True:
            self._moved.clear()
            try:
                await self._read(self._where())
            except lidario.LidarError as error:
                if self.latest is None:
                    raise
                self._attempts += 1
                self._lose(str(error).partition("\n")[0])
            else:
                # Nobody else can stop a stream of this session: only a recording comes to its end.
                if self.latest is None:
                    raise lidario.RecordingError(f"{self.source} holds no full revolution")
                if not self._moved.is_set():
                    self.state, self.line = "ended", None
                    self.on_change(self)
                    if not self._stays or self.length_s is None:
                        return
                    await self._moved.wait()
                continue
            await asyncio.sleep(_BACK_OFF_S[min(self._attempts, len(_BACK_OFF_S)) - 1])

    def _where(self) -> str:
        """The source; of a recording, with the place and the speed at which it is played on."""
        if self.length_s is None:
            return self.source
        path, _, query = self.source.partition("?")
        place = {"from": f"{self._begin_s:.3f}", "rate": f"{self.rate:g}"}
        return f"{path}?{urlencode(dict(parse_qsl(query)) | place)}"

    async def _read(self, source: str) -> None:
        loop = asyncio.get_running_loop()
        config = lidario.Config() if self._config is None else lidario.read_config(self._config)
        # The filters are here alone: a viewer may take away what stands in the file, too.
        opening = lidario.open_lidar(source, reconnect=True, guard=self._guard, config=_without_filters(config))
        async with opening as lidar, lidar.scans(self.mode) as scans:
            self.config = config.of(lidar.info.serial)
            self.saved = self.config.filters
            self.info, self.length_s = lidar.info, lidar.length_s
            if self.length_s is not None:
                self.keeper = None
            before, since = lidar.stats, loop.time()
            beside = [asyncio.create_task(self._watch(lidar))]
            if self.keeper is not None:
                beside.append(asyncio.create_task(self.keeper.serve(lidar)))
            try:
                async for scan in scans:
                    self.latest = scan.filtered(*self.filters)
                    self.reached_s = lidar.reached_s or 0.0
                    self.scans += 1
                    self._attempts = 0
                    if self.state != "scanning":
                        # Not from the opening on: the rotor needs its time, and nothing comes meanwhile.
                        before, since = lidar.stats, loop.time()
                        self.state, self.reason = "scanning", ""
                        self.on_change(self)
                    if loop.time() - since >= _TRAFFIC_S:
                        now = lidar.stats
                        self.line = traffic(before, now, loop.time() - since, lidar.baudrate)
                        before, since = now, loop.time()
                    self.on_scan(self)
                    if self._moved.is_set():
                        return
            finally:
                for task in beside:
                    task.cancel()
                await asyncio.wait(beside)

    async def _watch(self, lidar: lidario.Lidar) -> None:
        """Tell when the session has lost its line; the next scan tells that it is back."""
        async for change in lidar.line_changes():
            if change.state == "away":
                self._lose(change.reason.partition("\n")[0])

    def _lose(self, reason: str) -> None:
        self.losses += self.state != "lost"
        self.state, self.reason, self.line = "lost", reason, None
        self.on_change(self)


def _without_filters(config: lidario.Config) -> lidario.Config:
    others = {serial: replace(each, filters=()) for serial, each in config.lidars.items()}
    return replace(config, default=replace(config.default, filters=()), lidars=others)


def _number(text: str | None, otherwise: float) -> float:
    """A number of an option; opening the source says what is wrong with one that is none."""
    try:
        return otherwise if text is None else float(text)
    except ValueError:
        return otherwise
