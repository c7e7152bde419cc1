"""A lidar on the network without ROS: whole scans, or the bytes of the device. ``zenoh:KEY`` reads both.

Raw bytes are collected until a scan is complete, or for a short while, and sent together with the time of each read
and with what the session learned beside them. A reader that comes later asks for the status, which holds what the
device has responded so far and the stream that runs.
"""

import asyncio
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Any, Final, cast

from lidario.basics.arguments import yes_or_no
from lidario.errors import Unsupported
from lidario.network.bus import DEFAULT_ROUTER, Bus
from lidario.network.keys import Sender, check_key
from lidario.network.messages import MOST_RAW_BYTES, Entry, encode_raw_message, encode_scan
from lidario.recording.about import About
from lidario.recording.chronicle import EventState, event_of
from lidario.ros.broadcast import Broadcast
from lidario.ros.names import gid_of
from lidario.scans.scan import Scan
from lidario.session.lidar import Lidar

COLLECT_S: Final = 0.05  # longest time for which bytes wait to be sent; half a revolution
COLLECT_BYTES: Final = 16384
COLLECT_ENTRIES: Final = 1024
MOST_READ_BYTES: Final = MOST_RAW_BYTES // 2
"""Of one read; beside it there is room for what is collected already. A program that blocked its loop for some
seconds reads so much at once."""


class Share(Broadcast):
    """One lidar on the network; used as an asynchronous context manager, as `Publisher` is.

    ::

        async with lidario.open_lidar() as lidar, Share(lidar, "robots/r7/scan") as share:
            await share.run()

    Args:
        lidar: An open lidar.
        key: Where its scans go.
        raw: Whether the bytes of the device are sent, which is a quarter of the size.
        router: Address of the zenoh router.
        robot: Name of this robot, for the list of a fleet; None for the name of this machine.

    Raises:
        InvalidValue: The key cannot be one.
        Unsupported: Raw bytes are to be sent of a lidar that arrives as whole scans.
    """

    def __init__(
        self, lidar: Lidar, key: str, *, raw: bool = False, router: str = DEFAULT_ROUTER, robot: str | None = None
    ) -> None:
        super().__init__(lidar, router, robot)
        raw = yes_or_no(raw, "raw")
        self.form = "raw" if raw else "scan"
        self.key: str = check_key(key)
        self._outlet: Sender | None = None
        self._raw = RawFeed(lidar, self._send_raw, partial(self._count, True)) if raw else None

    def publish(self, scan: Scan) -> None:
        """Publish a scan. Of a raw share nothing is to be done: its bytes have been sent already."""
        if self._outlet is None:
            self._count(False)
        elif self._raw is None:
            self._count(self._outlet.send(encode_scan(scan)))

    def _declare(self, bus: Bus) -> bytes:
        gid = gid_of(f"{bus.id}/{self.key}")
        self._outlet = bus.sender(self.key, gid)
        self._watch_readers(bus, self._outlet)
        if self._raw is not None:
            self._raw.begin()
        return gid

    def _leave(self) -> None:
        if self._raw is not None:
            self._raw.end()

    def _about(self) -> About:
        about = super()._about()
        return about if self._raw is None else self._raw.added_to(about)

    def _send_raw(self, entries: list[Entry]) -> None:
        if self._outlet is not None:
            self._outlet.send(encode_raw_message(entries))


class RawFeed:
    """Takes what a recording would take (`lidario.recording.record.Recorded`) and has it sent.

    A scan that is complete is counted before its last bytes are sent.
    """

    def __init__(self, lidar: Lidar, send: Callable[[list[Entry]], None], count_scan: Callable[[], None]) -> None:
        # Not public: users record to files only.
        self._session = lidar._recorded  # noqa: SLF001
        if not self._session.sends_bytes:
            raise Unsupported("this lidar arrives as whole scans, so there are no raw bytes to publish: send scans")
        self._send, self._count_scan = send, count_scan
        self._clock_offset_ns = 0
        self._state = EventState()
        self._entries: list[Entry] = []
        self._size = 0
        self._timer: asyncio.TimerHandle | None = None

    def added_to(self, about: About) -> About:
        """The same with what the device has responded, and the stream that runs."""
        return replace(about, clock_offset_ns=self._clock_offset_ns, events=self._state.events)

    def begin(self) -> None:
        """See everything from now on."""
        begun = self._session.begin_recording(cast("Any", self))
        self._clock_offset_ns = begun.clock_offset_ns
        self._state = EventState(begun.events)

    def end(self) -> None:
        """See nothing any more, and send what is collected."""
        self._session.end_recording(cast("Any", self))
        self._flush()

    async def close(self) -> None:
        """The session is over."""
        self.end()

    def see_chunk(self, direction: str, data: bytes, now: int) -> None:
        """A chunk passed the port."""
        if direction == "in":
            # What was read at once is dated by its last byte, so it is in one message; yet none may be too large.
            for at in range(0, len(data), MOST_READ_BYTES):
                self._add(Entry(False, now, data[at : at + MOST_READ_BYTES]))

    def see_event(self, text: str, now: int) -> None:
        """Something was added to the chronicle."""
        self._state.follow(event_of(text))
        self._add(Entry(True, now, text.encode()))

    def see_scan(self, scan: Scan) -> None:  # noqa: ARG002
        """A scan is complete, with what was seen last: readers shall have it at once."""
        self._count_scan()
        self._flush()

    def _add(self, entry: Entry) -> None:
        self._entries.append(entry)
        self._size += len(entry.data)
        if self._size >= COLLECT_BYTES or len(self._entries) >= COLLECT_ENTRIES:
            self._flush()
        elif self._timer is None:
            self._timer = asyncio.get_running_loop().call_later(COLLECT_S, self._flush)

    def _flush(self) -> None:
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None
        if self._entries:
            entries, self._entries, self._size = self._entries, [], 0
            self._send(entries)
