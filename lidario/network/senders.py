"""Who has sent a message, and how many of his are missing before it.

Each publisher numbers its messages and names itself in the attachment. A gap in the numbers is the only trace of a
message that was lost: zenoh drops what does not fit into the buffer of a line, at the publisher or at a router, and
tells nobody.
"""

from __future__ import annotations

from collections import OrderedDict
from typing import Final, Generic, TypeVar

from lidario.network.bus import Sample
from lidario.network.keys import Attachment, parse_attachment

__all__ = ["Known", "Senders"]

T = TypeVar("T")

MOST: Final = 65536
"""Publishers that are remembered. Each one that restarts is another one."""


class Known(OrderedDict[tuple[str, bytes], T], Generic[T]):
    """What is known of each publisher; those not heard for longest are forgotten first.

    Args:
        most: How many are remembered.
    """

    def __init__(self, most: int = MOST) -> None:
        super().__init__()
        self._most = most

    def put(self, key: str, gid: bytes, value: T) -> None:
        """Remember `value`."""
        self[key, gid] = value
        self.move_to_end((key, gid))
        if len(self) > self._most:
            self.popitem(last=False)


class Senders:
    """Follows the numbers of all publishers."""

    def __init__(self) -> None:
        self._numbers: Known[int] = Known()

    def follow(self, sample: Sample) -> tuple[Attachment | None, int]:
        """What was sent beside a message, and how many of its publisher's are missing since the one before."""
        attachment = parse_attachment(sample.attachment)
        if attachment is None:
            return None, 0
        before = self._numbers.get((sample.key, attachment.gid))
        self._numbers.put(sample.key, attachment.gid, attachment.number)
        # Whoever sends may write any number: one that goes back is a beginning.
        return attachment, 0 if before is None else max(0, attachment.number - before - 1)
