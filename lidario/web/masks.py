"""What a viewer draws to be left out of the scans: boxes in the robot's frame, and sectors around one lidar.

What is drawn holds at once for what the page shows. Only when a viewer asks for it, it is written into the file of
settings, where every other program finds it. A box is for all lidars: the robot's body is in the way of each.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Sequence
from os import PathLike
from typing import Any, Final

from lidario import InvalidValue, LidarError, Mount, read_config, save_config
from lidario.filters import AngularBoundsFilter, BoxFilter, Filter
from lidario.web.feed import Feed

__all__ = ["Masks"]

MOST: Final = 50
"""Drawn ones that are not saved; each costs some microseconds a scan."""
_NUMBER: Final = r"(-?\d{1,3}(?:\.\d{1,3})?)"
_BOX: Final = re.compile(rf"b{_NUMBER} {_NUMBER} {_NUMBER} {_NUMBER}", re.ASCII)
_SECTOR: Final = re.compile(rf"s(\d{{1,2}}) {_NUMBER} {_NUMBER}", re.ASCII)


class Masks:
    """The drawn filters of a page.

    Args:
        feeds: What is shown.
        places: Where each lidar is shown, for those whose settings do not say it.
        path: The file of settings to write; None where a viewer may not.

    Attributes:
        said: What became of the last wish to save; empty before one.
    """

    def __init__(
        self, feeds: Sequence[Feed], places: Callable[[Feed], Mount], path: str | PathLike[str] | None
    ) -> None:
        self.said: str = ""
        self._feeds = tuple(feeds)
        self._place_of = places
        self._path = path
        self._drawn: list[list[tuple[Feed, Filter]]] = []

    def receive(self, message: str) -> bool:
        """Take in a viewer's message; False where it is none of these."""
        if self._path is None:
            return False
        if box := _BOX.fullmatch(message):
            x1, x2, y1, y2 = map(float, box.groups())
            sides = min(x1, x2), max(x1, x2), min(y1, y2), max(y1, y2)
            self._add([(feed, BoxFilter(*sides, mount=self._place_of(feed))) for feed in self._feeds])
        elif (sector := _SECTOR.fullmatch(message)) and int(sector[1]) < len(self._feeds):
            begin, end = math.radians(float(sector[2])), math.radians(float(sector[3]))
            if not 0.0 < end - begin <= math.tau:
                return False
            self._add([(self._feeds[int(sector[1])], AngularBoundsFilter([(begin, end)], invert=True))])
        elif message == "undo":
            for feed, drawn in self._drawn.pop() if self._drawn else ():
                feed.drawn.remove(drawn)
        elif message == "save":
            self._save()
        else:
            return False
        return True

    def state(self) -> dict[str, Any]:
        """What viewers are told."""
        return {"may": self._path is not None, "unsaved": len(self._drawn), "said": self.said}

    def _add(self, made: list[tuple[Feed, Filter]]) -> None:
        if len(self._drawn) < MOST:
            self._drawn.append(made)
            for feed, drawn in made:
                feed.drawn.append(drawn)

    def _save(self) -> None:
        assert self._path is not None
        try:
            for feed in self._feeds:
                own = [drawn for group in self._drawn for of, drawn in group if of is feed]
                if own and feed.info is not None:
                    if not feed.info.serial and len(self._feeds) > 1:
                        raise InvalidValue(
                            f"{feed.source} tells no serial number: settings cannot tell it from others"
                        )
                    # Boxes were drawn from where the lidar is shown; without that place they would be elsewhere.
                    save_config(self._path, feed.info.serial, mount=self._place_of(feed), filters=own)
            read_config(self._path)
        except LidarError as error:
            self.said = str(error).partition("\n")[0]
        else:
            self._drawn.clear()
            self.said = f"saved in {self._path}"
