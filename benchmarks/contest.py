"""One reader on one played device, whoever it is: lidario at some latency, or another driver in its environment."""

from __future__ import annotations

import sys
from bisect import bisect_left, bisect_right
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Self

from benchmarks.peers import package_of
from benchmarks.processes import Failed, Player, run_json
from benchmarks.report import Setting
from benchmarks.streams import RATES

_MARGIN_S = 15.0
_FORMS = {"S2 DenseBoost": "dense", "S2 Standard": "nodes", "4ROS": "points"}
RIVALS = {
    "S2 DenseBoost": ("pyrplidar",),
    "S2 Standard": ("pyrplidar", "rplidar-roboticia", "rplidar", "adafruit-circuitpython-rplidar", "rplidarc1",
                    "lds2d"),
    "4ROS": ("lds2d-4ros", "PyLidar3"),
}  # fmt: skip
"""The other drivers that read a device, in Python."""


@dataclass(frozen=True, slots=True)
class Entry:
    """One that takes part.

    Attributes:
        name: For tables.
        contestant: Which adapter of another driver; empty for lidario.
        latency: lidario's setting in seconds.
        degrees: Width of the sectors that lidario reads; 0 for scans.
    """

    name: str
    contestant: str = ""
    latency: float = 0.0
    degrees: float = 0.0

    @classmethod
    def of(cls, contestant: str) -> Self:
        """Another driver, by what it is called on PyPI."""
        return cls(package_of(contestant), contestant)


def entries(rate: str, *, rivals: bool) -> list[Entry]:
    """Who reads that device: the baseline first."""
    found = [Entry(f"lidario, {latency:g} ms", latency=latency / 1000) for latency in (5, 10, 0)]
    found.append(Entry("lidario, 5 ms, sectors of 45 degrees", latency=0.005, degrees=45.0))
    if rivals:
        if rate != "4ROS":
            found.append(Entry("pyrplidarsdk (C++)", "pyrplidarsdk"))
        found.append(Entry("plain pyserial-asyncio", "plain"))
        found += map(Entry.of, RIVALS[rate])
    return found


def read_live(
    setting: Setting, entry: Entry, rate: str, player: Player, *, settle_s: float, window_s: float, **more: Any
) -> tuple[dict[str, Any], dict[str, Any]]:
    """Have `entry` read what `player` plays; what it reported, and what the player did.

    Raises:
        Failed: It is absent, or it did not get through; the text says why.
    """
    kind = RATES[rate].kind
    task: dict[str, Any] = {"paths": player.paths, "baudrate": RATES[rate].baudrate}
    task |= {"settle_s": settle_s, "window_s": window_s, **more}
    timeout = settle_s + window_s + _MARGIN_S + len(player.paths) / 4
    try:
        if not entry.contestant:
            task |= {"family": kind.family, "latency": entry.latency, "degrees": entry.degrees}
            got = run_json([sys.executable, "-m", "benchmarks.reader"], timeout=timeout, given=task)
        else:
            task |= {"mode": 0 if kind.mode.response_type == 0x81 else kind.mode.id, "form": _FORMS.get(rate, "")}
            got = setting.ask_peer(entry.contestant, "live", task, timeout=timeout)
    finally:
        report = player.report()
    return got, report


def compete(
    setting: Setting,
    what: str,
    rate: str,
    player: Player,
    taking_part: Sequence[Entry],
    rounds: int,
    figures: Callable[[str, dict[str, Any], dict[str, Any]], dict[str, Any]],
    absent: dict[str, str],
    *,
    settle_s: float,
    window_s: float,
) -> dict[str, list[dict[str, Any]]]:
    """Everybody reads, one after the other, and again; by their names, what `figures` makes of each time.

    Who is absent, or fails, is noted in `absent` and not tried again.
    """
    found: dict[str, list[dict[str, Any]]] = {}
    for number in range(rounds):
        setting.say(f"{what}: {rate}, round {number + 1} of {rounds}")
        for entry in taking_part:
            who = f"{entry.name}, {rate}"
            if who in absent:
                continue
            try:
                both = read_live(setting, entry, rate, player, settle_s=settle_s, window_s=window_s)
            except Failed as failed:
                absent[who] = str(failed)
            else:
                found.setdefault(entry.name, []).append(figures(rate, *both))
    return found


def lost_scans(arrivals: list[int], turns: list[int]) -> int:
    """Turns played between the first and the last scan that did not come; an even delay does not matter."""
    if len(arrivals) < 2:
        return 0
    played = bisect_right(turns, arrivals[-1]) - bisect_right(turns, arrivals[0])
    return max(0, played - (len(arrivals) - 1))


def late_by(arrivals: list[int], turns: list[int]) -> list[float]:
    """For each scan the milliseconds since the latest turn's end; more than a turn is not told from less."""
    return [(at - turns[place - 1]) / 1e6 for at in arrivals if (place := bisect_left(turns, at))]
