"""Who sees every chunk that passes a port, in either direction: recordings, probing, and programs that ask."""

from __future__ import annotations

import logging

from lidario.port.line import Tap

__all__ = ["Tapped"]

_log = logging.getLogger("lidario")


class Tapped:
    """The base of `Port`: its taps.

    Args:
        name: What was opened, for messages.

    Attributes:
        name: What was opened, for messages.
    """

    def __init__(self, name: str) -> None:
        self.name: str = name
        self._taps: tuple[Tap, ...] = ()

    @property
    def is_tapped(self) -> bool:
        """Whether there are taps."""
        return bool(self._taps)

    @property
    def taps(self) -> tuple[Tap, ...]:
        """Who sees the chunks, in the order in which they were added."""
        return self._taps

    def add_tap(self, tap: Tap) -> None:
        """Have `tap` called with every chunk in either direction, after the taps that are there.

        It must be quick. A tap that raises is removed and logged at WARNING.
        """
        self._taps = (*self._taps, tap)

    def remove_tap(self, tap: Tap) -> None:
        """Stop calling `tap`; ignored where it is not there."""
        taps = list(self._taps)
        if tap in taps:
            taps.remove(tap)
            self._taps = tuple(taps)

    def show(self, direction: str, data: bytes, now: int) -> None:
        """Show a chunk to the taps. A tap that raises is removed, and has no other effect."""
        for tap in self._taps:
            try:
                tap(direction, data, now)
            except Exception:
                self.remove_tap(tap)
                _log.warning("the tap %r of %s raised an exception and was removed", tap, self.name, exc_info=True)
