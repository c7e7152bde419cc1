"""Which publisher has sent a message, how many of its messages are missing before that, and whether any arrives.

Each publisher numbers its messages and names itself in the attachment. A gap in the numbers is the only trace of a
message that was lost: zenoh drops what does not fit into the buffer of a line, at the publisher or at a router, and
tells nobody.
"""

import asyncio
from collections import OrderedDict
from collections.abc import Callable, Sequence
from contextlib import suppress
from typing import Final, Literal

from lidario.network.bus import Bus, Sample
from lidario.network.keys import Attachment, parse_attachment

MOST: Final = 16384
"""Publishers that are remembered, each with its key. Each one that restarts is another one."""
RIVAL_S: Final = 2.0
"""Longest pause of a publisher before another one under its key takes its place; four revolutions of the slowest
devices."""


class Senders:
    """Follows the numbers of all publishers; those not heard for longest are forgotten first.

    `mixed` is called with each key under which two send in turn, once.
    """

    def __init__(self, mixed: Callable[[str], object] = lambda _: None) -> None:
        self._numbers: OrderedDict[tuple[str, bytes], int] = OrderedDict()
        # Who has sent last under a key, and whether that was told.
        self._latest: OrderedDict[str, tuple[bytes, bool]] = OrderedDict()
        self._mixed = mixed

    def follow(self, sample: Sample) -> tuple[Attachment | None, int]:
        """What was sent beside a message, and how many of its publisher's are missing since the one before."""
        attachment = parse_attachment(sample.attachment)
        if attachment is None:
            return None, 0
        before = self._numbers.pop((sample.key, attachment.gid), None)
        self._numbers[sample.key, attachment.gid] = attachment.number
        latest, told = self._latest.pop(sample.key, (attachment.gid, False))
        # One that starts anew is another one, and who it was does not come back.
        is_mixed = latest != attachment.gid and before is not None
        self._latest[sample.key] = attachment.gid, told or is_mixed
        if is_mixed and not told:
            self._mixed(sample.key)
        for known in (self._numbers, self._latest):
            if len(known) > MOST:
                known.popitem(last=False)
        # Whoever sends may write any number: one that goes back is a beginning.
        return attachment, 0 if before is None else max(0, attachment.number - before - 1)


class OneSender:
    """The one that is listened to, of all who send under a key: the first one, as long as it sends."""

    def __init__(self, gid: bytes, now: float) -> None:
        self._gid: bytes | None = gid or None
        self._heard = now

    def is_other(self, gid: bytes) -> bool:
        """Whether it is known, and is not this one."""
        return self._gid is not None and gid != self._gid

    def follow(self, gid: bytes, now: float, is_ours: Callable[[], bool]) -> Literal["same", "new", "rival"]:
        """Who has sent a message: the one that is listened to, a new one that is from now on, or a rival of it.

        Args:
            gid: What tells who has sent it; empty where it does not say.
            now: The time in seconds.
            is_ours: Whether the message is one that a publisher may send; nobody becomes the one by noise.
        """
        if gid == self._gid:
            self._heard = now
            return "same"
        if (self._gid is not None and now - self._heard < RIVAL_S) or not is_ours():
            return "rival"
        found: Literal["same", "new"] = "same" if self._gid is None else "new"
        self._gid, self._heard = gid, now
        return found


async def what_is_heard(router: str, keys: Sequence[str], gid: bytes, seconds: float) -> set[str]:
    """Under which keys another client, let in as this program is, hears the publisher with this `gid`.

    A router drops what its access rules deny without a word, and the publisher sees even that there are readers. It
    returns as soon as something comes under the first key, and after so many seconds at most. Cancelling leaves
    nothing open.
    """
    heard, enough = set[str](), asyncio.Event()

    def take(sample: Sample) -> None:
        attachment = parse_attachment(sample.attachment)
        if attachment is not None and attachment.gid == gid:
            heard.add(sample.key)
            if sample.key == keys[0]:
                enough.set()

    async with await Bus.open(router) as bus:
        for key in keys:
            bus.subscribe(key, take)
        with suppress(TimeoutError):
            async with asyncio.timeout(seconds):
                await enough.wait()
        return heard
