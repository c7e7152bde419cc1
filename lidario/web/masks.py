"""What a viewer draws to be left out of the scans: boxes in the robot's frame, and sectors around one lidar.

What is drawn holds at once for what the page shows, and what is taken away does no longer, whether it was drawn or
stands in the file. Only when a viewer asks for it, that is written into the file of settings, where every other
program finds it. A box is for all lidars: the robot's body is in the way of each.
"""

import math
import re
from collections.abc import Sequence
from os import PathLike
from typing import Any, Final

from lidario import InvalidValue, LidarError, read_config, save_config
from lidario.filters import AngularBoundsFilter, BoxFilter, Filter
from lidario.web.feed import Feed

MOST: Final = 50
"""Changes that are not saved; each drawn filter costs some microseconds a scan."""
ROUNDED_M: Final = 0.0006
ROUNDED: Final = math.radians(0.006)
"""A viewer names the shape that it takes away by figures that it has rounded."""
FARTHEST_M: Final = 1e6
"""As for the sides of a `BoxFilter`: those of the file are named when they are taken away."""
_NUMBER: Final = r"(-?\d{1,7}(?:\.\d{1,3})?)"
_BOX: Final = re.compile(rf"(b|x){_NUMBER} {_NUMBER} {_NUMBER} {_NUMBER}", re.ASCII)
_SECTOR: Final = re.compile(rf"(s|x)(\d{{1,2}}) {_NUMBER} {_NUMBER}", re.ASCII)
_Change = tuple[list[Filter], Filter]
_Unsaved = tuple[str, Feed, list[Filter], list[Filter]]


class Masks:
    """What viewers add to the filters of what is shown, and take away; what became of the last save is `said`.

    The file of settings is written where a `path` names it.
    """

    def __init__(self, feeds: Sequence[Feed], path: str | PathLike[str] | None) -> None:
        self.said: str = ""
        self._feeds = tuple(feeds)
        self._path = path
        self._changes: list[list[_Change]] = []

    def receive(self, message: str) -> bool:
        """Take in a viewer's message; False where it is none of these."""
        if self._path is None:
            return False
        if box := _BOX.fullmatch(message):
            return self._take_box(box)
        if sector := _SECTOR.fullmatch(message):
            return self._take_sector(sector)
        if message == "undo":
            for changed, made in self._changes.pop() if self._changes else ():
                changed.remove(made)
        elif message == "save":
            self._save()
        else:
            return False
        return True

    def _take_box(self, box: re.Match[str]) -> bool:
        x1, x2, y1, y2 = map(float, box.groups()[1:])
        sides = min(x1, x2), max(x1, x2), min(y1, y2), max(y1, y2)
        if max(map(abs, sides)) > FARTHEST_M:
            return False
        if box[1] == "b":
            self._add([(feed.drawn, BoxFilter(*sides, mount=feed.place)) for feed in self._feeds])
        else:
            every = [(feed, each) for feed in self._feeds for each in feed.filters]
            self._add([(feed.removed, each) for feed, each in every if _is_box(each, sides)])
        return True

    def _take_sector(self, sector: re.Match[str]) -> bool:
        number, begin, end = int(sector[2]), math.radians(float(sector[3])), math.radians(float(sector[4]))
        if number >= len(self._feeds) or not 0.0 < end - begin <= math.tau:
            return False
        # Of a lidar that is turned on the robot, the page may count on beyond a turn.
        turns = math.tau * round(begin / math.tau)
        turns += math.tau * (end - turns > math.tau)
        feed, window = self._feeds[number], (begin - turns, end - turns)
        if sector[1] == "s":
            self._add([(feed.drawn, AngularBoundsFilter([window], invert=True))])
        else:
            self._add(_without_sector(feed, window))
        return True

    def state(self) -> dict[str, Any]:
        """What viewers are told."""
        return {"may": self._path is not None, "unsaved": len(self._changes), "said": self.said}

    def _add(self, changes: list[_Change]) -> None:
        if changes and len(self._changes) < MOST:
            self._changes.append(changes)
            for changed, made in changes:
                changed.append(made)

    def _unsaved(self) -> list[_Unsaved]:
        """What is to be saved of which lidar; all are checked before the first one is written."""
        found: list[_Unsaved] = []
        for feed in self._feeds:
            drawn = [each for each in feed.drawn if each not in feed.removed]
            gone = [each for each in feed.removed if each in feed.saved]
            if feed.info is None or not (drawn or gone):
                continue
            serial = feed.info.serial
            if not serial and len(self._feeds) > 1:
                raise InvalidValue(f"{feed.source} tells no serial number: settings cannot tell it from others")
            if any(serial.casefold() == other.casefold() for other, *_ in found):
                raise InvalidValue(f"several lidars tell the serial number {serial}: settings cannot hold both")
            found.append((serial, feed, drawn, gone))
        return found

    def _save(self) -> None:
        assert self._path is not None
        try:
            for serial, feed, drawn, gone in self._unsaved():
                # Boxes were drawn from where the lidar is shown; without that place they would be elsewhere.
                save_config(self._path, serial, mount=feed.place, filters=drawn, without=gone)
                # At once: the file may not take what is drawn for the next lidar, and is then saved again.
                self._is_saved(feed)
            for feed in self._feeds:
                self._is_saved(feed)
        except LidarError as error:
            self.said = str(error).partition("\n")[0]
        else:
            self.said = f"saved in {self._path}"

    def _is_saved(self, feed: Feed) -> None:
        """Nothing is unsaved any more of this lidar, and what the file has is shown."""
        assert self._path is not None
        serial = "" if feed.info is None else feed.info.serial
        feed.saved = read_config(self._path).of(serial).filters
        for changed in (feed.drawn, feed.removed):
            changed.clear()
            kept = [[each for each in change if each[0] is not changed] for change in self._changes]
            self._changes = [change for change in kept if change]


def _is_box(each: Filter, sides: tuple[float, ...]) -> bool:
    if not isinstance(each, BoxFilter) or each.invert:
        return False
    own = each.min_x, each.max_x, each.min_y, each.max_y
    return all(abs(one - other) < ROUNDED_M for one, other in zip(own, sides, strict=True))


def _without_sector(feed: Feed, window: tuple[float, float]) -> list[_Change]:
    """What takes this sector away; a filter of several keeps the others."""
    changes: list[_Change] = []
    for each in feed.filters:
        if not isinstance(each, AngularBoundsFilter) or not each.invert:
            continue
        left = [own for own in each.windows if not _is_window(own, window)]
        if len(left) < len(tuple(each.windows)):
            changes.append((feed.removed, each))
            if left:
                changes.append((feed.drawn, AngularBoundsFilter(left, invert=True)))
    return changes


def _is_window(one: tuple[float, float], other: tuple[float, float]) -> bool:
    return all(abs(math.remainder(a - b, math.tau)) < ROUNDED for a, b in zip(one, other, strict=True))
