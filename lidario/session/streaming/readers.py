"""Who reads the stream of one device, and who waits to be let in.

A reader that asks for no mode in particular is let in at once where others read already. Any other one waits until
`Starter` has compared the mode that it asks for with the one that runs. A reader that does not say
that it is the last one leaves its stream going for `LINGER_S`: single scans in a row must not restart the rotor
each time.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from typing import NamedTuple

from lidario.errors import LidarError
from lidario.session.streaming.stream import Hub, Mailbox

__all__ = ["LINGER_S", "Joining", "Readers"]

LINGER_S = 1.0
"""How long a stream goes on that nobody reads any more, where its reader did not say that it is the last. Users are
promised two seconds."""


class Joining(NamedTuple):
    """A reader that waits to be let in, and what it asked for."""

    mailbox: Mailbox
    mode: str | int | None
    force: bool


class Readers:
    """The readers of one device's stream; `deserted` is called when the last one has been gone for `LINGER_S`.

    Attributes:
        hub: Those who are in.
        joining: Those who wait, the first one first.
    """

    def __init__(self, deserted: Callable[[], None]) -> None:
        self.hub: Hub = Hub()
        self.joining: list[Joining] = []
        self._deserted = deserted
        self._loop = asyncio.get_running_loop()
        self._linger: asyncio.TimerHandle | None = None

    def __len__(self) -> int:
        return len(self.hub) + len(self.joining)

    def add(self, mailbox: Mailbox, mode: str | int | None, force: bool) -> None:
        """Let a reader in, or have it wait."""
        self.cancel_linger()
        if mode is None and len(self.hub) and not self.joining:
            self.hub.add(mailbox)
        else:
            self.joining.append(Joining(mailbox, mode, force))

    def discard(self, mailbox: Mailbox) -> None:
        """This one reads no more, nor does it wait."""
        self.hub.discard(mailbox)
        self.joining = [each for each in self.joining if each.mailbox is not mailbox]

    def end(self, error: LidarError | None) -> None:
        """End every reader, those who wait included."""
        self.cancel_linger()
        joining, self.joining = self.joining, []
        for each in joining:
            self.hub.add(each.mailbox)
        self.hub.end(error)

    def linger(self) -> None:
        """Call `deserted` a second later, unless a reader comes before."""
        if self._linger is None:
            self._linger = self._loop.call_later(LINGER_S, self._linger_over)

    def cancel_linger(self) -> None:
        """Do not call `deserted`."""
        if self._linger is not None:
            self._linger.cancel()
            self._linger = None

    def _linger_over(self) -> None:
        self._linger = None
        if not len(self):
            self._deserted()
