"""Who reads the stream of one device, and who waits to be let in.

A reader that asks for no mode in particular is let in at once where others read already. Any other one waits until
`Starter` has compared the mode that it asks for with the one that runs. A reader that does not say
that it is the last one leaves its stream going for `LINGER_S`: single scans in a row must not restart the rotor
each time. A device that turns as soon as it is opened is left so as long, for the first one.
"""

import asyncio
from collections.abc import Callable
from typing import Any, NamedTuple

from lidario.errors import LidarError
from lidario.scans.scan import Scan
from lidario.scans.sector import Sector
from lidario.session.streaming.stream import Mailbox
from lidario.session.talking.trouble import twin_of

LINGER_S = 1.0
"""How long a stream goes on that nobody reads any more, where its reader did not say that it is the last. Users are
promised two seconds."""


class Joining(NamedTuple):
    """A reader that waits to be let in, and what it asked for."""

    mailbox: Mailbox[Any]
    mode: str | int | None
    force: bool


class Hub:
    """The readers of one device's stream; `deserted` is called when nobody has read for `LINGER_S`.

    Every scan is handed to every mailbox for scans, and every sector to those for sectors of its size.
    """

    def __init__(self, deserted: Callable[[], None]) -> None:
        self.latest: Scan | None = None  # the last scan, or None
        # The same of a stream that goes on: what passes until its next scan is counted as missed.
        self.continued: Scan | None = None
        self.joining: list[Joining] = []  # those who wait to be let in, the first one first
        self.dropped: int = 0  # scans that slow readers missed, summed over all of them
        # The numbers of sectors that revolutions have for the readers here.
        self.parts: frozenset[int] = frozenset()
        self.on_parts: Callable[[], None] = lambda: None  # called when that has changed
        # Those who were let in, in the order in which they came: a run is repeated exactly.
        self.readers: dict[Mailbox[Any], None] = {}
        self._watchers: list[Callable[[Scan], None]] = []
        # Called each time a reader has taken a scan or has left. Where it is set, no scan is dropped.
        self.on_taken: Callable[[], None] | None = None
        self._deserted = deserted
        self._loop = asyncio.get_running_loop()
        self._linger: asyncio.TimerHandle | None = None
        # Done when all readers are ended, with the error that they get.
        self.ends: asyncio.Future[None] = self._loop.create_future()

    def __len__(self) -> int:
        return len(self.readers) + len(self.joining)

    @property
    def is_waiting(self) -> bool:
        """Whether every reader has taken all its scans."""
        return all(mailbox.is_empty for mailbox in self.readers)

    def add(self, mailbox: Mailbox[Any], mode: str | int | None, force: bool) -> None:
        """Let a reader in, or have it wait."""
        self.cancel_linger()
        if mode is None and self.readers and not self.joining:
            self.let_in(mailbox)
        else:
            self.joining.append(Joining(mailbox, mode, force))

    def let_in(self, mailbox: Mailbox[Any]) -> None:
        """Begin to hand scans to `mailbox`."""
        self.readers[mailbox] = None
        mailbox.on_taken = self.on_taken
        self._see_parts()

    def discard(self, mailbox: Mailbox[Any]) -> None:
        """This one reads no more, nor does it wait."""
        mailbox.end()
        self.readers.pop(mailbox, None)
        self.joining = [each for each in self.joining if each.mailbox is not mailbox]
        self._see_parts()
        if self.on_taken is not None:
            self.on_taken()

    def watch(self, watcher: Callable[[Scan], None]) -> None:
        """Call `watcher` with each scan, before its readers get it."""
        self._watchers.append(watcher)

    def unwatch(self, watcher: Callable[[Scan], None]) -> None:
        """Call it no more; ignored where it is not there."""
        self._watchers = [each for each in self._watchers if each != watcher]

    def publish(self, scan: Scan) -> None:
        """Hand `scan` to everybody who reads scans."""
        self.latest = self.continued = scan
        for watcher in self._watchers.copy():
            watcher(scan)
        for mailbox in tuple(self.readers):
            if not mailbox.parts:
                self.dropped += mailbox.put(scan)

    def publish_sector(self, parts: int, sector: Sector) -> None:
        """Hand `sector` to everybody who reads so many of a revolution."""
        for mailbox in tuple(self.readers):
            if mailbox.parts == parts:
                mailbox.put(sector)

    def end(self, error: LidarError | None = None) -> None:
        """End every reader, those who wait included; each gets an error of its own: tracebacks do not mix."""
        self.cancel_linger()
        for mailbox in (*self.readers, *(each.mailbox for each in self.joining)):
            mailbox.end(None if error is None else twin_of(error))
        self.readers.clear()
        self.joining = []
        if self._loop.is_closed():
            return
        ends, self.ends = self.ends, self._loop.create_future()
        if error is None:
            ends.set_result(None)
        else:
            ends.set_exception(twin_of(error))
            ends.exception()  # perhaps nobody waits for it: asyncio would log that

    def linger(self) -> None:
        """Call `deserted` a second later, unless a reader comes before."""
        if self._linger is None:
            self._linger = self._loop.call_later(LINGER_S, self._linger_over)

    def cancel_linger(self) -> None:
        """Do not call `deserted`."""
        if self._linger is not None:
            self._linger.cancel()
            self._linger = None

    def abandon(self) -> None:
        """Forget all readers, and cancel the timer."""
        self.cancel_linger()
        self.readers.clear()
        self._watchers = []

    def check_deserted(self) -> None:
        """Call `deserted` if nobody reads, and no timer is about to call it."""
        if self._linger is None and not self.readers and not self.joining:
            self._deserted()

    def _linger_over(self) -> None:
        self._linger = None
        self.check_deserted()

    def _see_parts(self) -> None:
        parts = frozenset(mailbox.parts for mailbox in self.readers if mailbox.parts)
        if parts != self.parts:
            self.parts = parts
            self.on_parts()
