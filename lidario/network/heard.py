"""Whether a router passes on what is published through it.

A message that its access rules deny is dropped by the router without a word, and the publisher sees even that there
are readers. So a second client asks for what is published, and sees whether it comes.
"""

from __future__ import annotations

import asyncio
from collections.abc import Sequence
from contextlib import suppress

import anyio

from lidario.network.bus import Bus, Sample
from lidario.network.keys import parse_attachment


async def what_is_heard(router: str, keys: Sequence[str], gid: bytes, seconds: float) -> set[str]:
    """Under which keys another client, let in as this program is, hears a publisher, told by its `gid`.

    It returns as soon as something comes under the first key, and after so many seconds at most. Cancelling leaves
    nothing open.
    """
    heard, enough = set[str](), asyncio.Event()

    def take(sample: Sample) -> None:
        attachment = parse_attachment(sample.attachment)
        if attachment is not None and attachment.gid == gid:
            heard.add(sample.key)
            if sample.key == keys[0]:
                enough.set()

    bus = await Bus.open(router)
    try:
        for key in keys:
            bus.subscribe(key, take)
        with suppress(TimeoutError):
            async with asyncio.timeout(seconds):
                await enough.wait()
        return heard
    finally:
        with anyio.CancelScope(shield=True):
            await bus.close()
