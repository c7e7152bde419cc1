"""A port at whose other end is a publisher: the session above it is the one of a live device.

Raw messages are handed over with the times at which the publisher read their bytes, put on the clock of this
machine (`lidario.recording.fed`). Whole scans are handed to the session as they are. Where the stream of the
publisher is interrupted and starts anew, the session is told to start its own anew, too.

**What is missing.** Messages are numbered, so a scan that was lost on the way is a jump of `Scan.seq`, and counted.
Where two publishers send under one key, the first one is received as long as it sends; the other one is counted.

**Who is lost.** The publisher's liveliness token goes when its process or its line dies. It also goes, for us, when
the router does: then nothing is decided before the router is back and has had time to learn which tokens there are.
"""

import asyncio
import logging
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import replace
from typing import Final

from lidario.errors import DeviceLost
from lidario.network.bus import Bus, Sample
from lidario.network.device import RemoteStreams, whole_scans
from lidario.network.keys import parse_attachment
from lidario.network.messages import Entry, parse_raw_message, whole_scan
from lidario.network.raw import in_order, reads_here
from lidario.network.senders import OneSender, Senders
from lidario.network.status import Status
from lidario.port.background import begin_task
from lidario.recording.chronicle import StreamBegan, StreamEnded, ZeroOffsetSet
from lidario.recording.fed import FedPort
from lidario.recording.read import StoredStream
from lidario.revolution.together import join_reads

_log = logging.getLogger("lidario")

GONE_S: Final = 0.5  # from the end of a token to the loss: the news that the router is gone may come after it
SETTLE_S: Final = 5.0
"""From the return of the router to the loss of who has no token by then; a publisher tries every four seconds."""
SILENCE_S: Final = 5.0  # longest pause of a publisher that shows no token: a node that is not ours

MOST_TOKENS: Final = 1024
AGAIN_S: Final = 1.0  # from one warning about the lidar of a publisher to the next


class RemotePort(FedPort):
    """A port with a publisher at its other end; needs a running event loop.

    It closes the bus with itself. `sender` tells its publisher from others, and is empty where that is not known.
    """

    def __init__(self, bus: Bus, key: str, streams: RemoteStreams, sender: bytes) -> None:
        super().__init__(f"zenoh:{key}", streams.stream.began.baudrate)
        self._began_offset_ns = super().wall_offset_ns
        self._bus = bus
        self._streams = streams
        self._raw = streams.raw
        self._take: Callable[[Sample], Iterable[None] | None] = self._take_raw if self._raw else self._take_scan
        self._flows = True
        self._senders = Senders()
        self._sender = OneSender(sender, self._loop.time())
        self._told_of_rival = self._told_of_silence = False
        self._away, self._told_away_at = "", -AGAIN_S
        self._gap = 0
        self._seq: int | None = None
        self._tokens: set[str] = set()
        self._has_token = False
        self._timer: asyncio.TimerHandle | None = None
        self._closer: asyncio.Task[None] | None = None
        self._heard = self._loop.time()
        bus.on_change = self._router_changed
        self._watch_in(SILENCE_S)

    @property
    def stream(self) -> StoredStream:
        """The stream that runs at its publisher."""
        return self._streams.stream

    @property
    def wall_offset_ns(self) -> int:
        """As `Port.wall_offset_ns`; of raw bytes, as it was when their stream began, or was first heard of."""
        return self._began_offset_ns if self._raw else super().wall_offset_ns

    def want(self, on: bool) -> None:
        """Hand over what comes from now on, or nothing; silence counts from now on."""
        super().want(on)
        self._heard = self._loop.time()
        if on:
            # When the session is done with this start.
            self._loop.call_soon(self._follow)

    def end_without_loop(self) -> None:
        """As `end`, after the event loop was closed."""
        super().end_without_loop()
        self._bus.close_soon()

    # ------------------------------------------------------------------------------------------ receiving

    def receive(self, sample: Sample) -> Iterable[None] | None:
        """Take what was published under the key of the lidar; what is returned is work, in steps."""
        self._heard = self._loop.time()
        if not self.is_open:
            return None
        attachment, gap = self._senders.follow(sample)
        gid = b"" if attachment is None else attachment.gid
        who = self._sender.follow(gid, self._loop.time(), lambda: _is_ours(sample, self._raw))
        if who == "rival":
            if attachment is not None and not self._told_of_rival:
                self._told_of_rival = True
                text = "%s: two publishers send under this key; the second one is ignored. Give each its own key"
                _log.warning(text, self.name)
            return None
        if who == "new":
            # What its bytes mean it tells itself.
            self._flows, self._gap, self._seq = not self._raw, 0, None
        self._gap += gap
        return self._take(sample)

    def learn(self, sample: Sample) -> None:
        """Take a status."""
        status, attachment = Status.of(sample.payload), parse_attachment(sample.attachment)
        gid = b"" if attachment is None else attachment.gid
        if status is None or not self.is_open or self._sender.is_other(gid):
            return
        if status.lost != self._away and (now := self._loop.time()) - self._told_away_at >= AGAIN_S:
            self._away, self._told_away_at = status.lost, now
            _log.warning("%s: %s", self.name, status.lost or "the lidar is back at its publisher")
        self._streams.about, self._streams.modes = status.about, status.modes
        if not self._raw and status.mode is not None:
            # Each scan names its mode; what that is stands here alone.
            self._begin(whole_scans(status.mode))
        for event in status.about.events:
            if self._raw and isinstance(event, StreamBegan):
                self._begin(event)
            else:
                self._streams.learn(event)

    def _take_scan(self, sample: Sample) -> None:
        scan = whole_scan(sample, self.wall_offset_ns)
        if scan is None:
            return
        before, self._seq = self._seq, scan.seq
        if before is not None and scan.seq > before:
            # What its publisher itself has missed is in it, too. A LaserScan has no number.
            self._gap = scan.seq - before - 1
        missed, self._gap = self._gap, 0
        if self.is_wanted:
            self.audience.deliver(scan, missed)

    def _take_raw(self, sample: Sample) -> Iterator[None]:
        for each in in_order(parse_raw_message(sample.payload) or ()):
            if isinstance(each, list):
                self._hand_over(each)
                continue
            if isinstance(each, StreamBegan):
                self._begin(each)
            elif isinstance(each, ZeroOffsetSet):
                self._begin(replace(self.stream.began, zero_offset_deg=each.zero_offset_deg), behind=each.behind)
            elif isinstance(each, StreamEnded):
                self._flows = False
            elif each is not None:
                self._streams.learn(each)
            yield

    def _hand_over(self, entries: Sequence[Entry]) -> None:
        """Hand over what was read, as one piece: a message may have thousands of reads."""
        if self.is_wanted and self._flows:
            reads = reads_here(entries, self.stream.began, self.wall_offset_ns)
            if reads:
                self.data_received(*join_reads(reads))

    def _begin(self, began: StreamBegan, *, behind: bool = False) -> None:
        before = self.stream.began
        if began == before and self._flows:
            return
        if self._flows and before == replace(began, zero_offset_deg=before.zero_offset_deg):
            # The same stream goes on.
            self._streams.turn(began.zero_offset_deg)
            if self.is_wanted:
                self.audience.set_zero_offset(self.offset_of(began.zero_offset_deg), behind=behind)
            return
        if self._raw and self.stream.family.stream_in(began.mode) is None:
            return
        self._streams.begin(began)
        self._flows, self._began_offset_ns = True, super().wall_offset_ns
        self._follow()

    def _follow(self) -> None:
        """Have the session open the stream that runs, where it takes another one."""
        if self._streams.opened is not self.stream.began and self.is_wanted:
            self.audience.restart()

    # ------------------------------------------------------------------------------------------ who is there

    def token_changed(self, token: str, alive: bool) -> None:
        """A token of the lidar came or went."""
        if alive:
            if len(self._tokens) < MOST_TOKENS:
                self._tokens.add(token)
            self._has_token = True
        else:
            self._tokens.discard(token)
            self._watch_in(GONE_S)

    def _router_changed(self, connected: bool) -> None:
        if connected:
            _log.warning("%s: the zenoh router is back", self.name)
            self._watch_in(SETTLE_S)
        else:
            _log.warning("%s: the zenoh router at %s is lost, waiting for it", self.name, self._bus.router)

    def _watch_in(self, seconds: float) -> None:
        if self._timer is not None:
            self._timer.cancel()
        self._timer = self._loop.call_later(seconds, self._watch)

    def _watch(self) -> None:
        if not self.is_open or not self._bus.is_connected:
            return
        silent_s = self._loop.time() - self._heard
        if self._has_token and not self._tokens:
            self.end(DeviceLost(f"{self.name} is gone: its publisher has ended or cannot be reached"))
        elif not self._has_token and silent_s >= SILENCE_S:
            self.end(DeviceLost(f"{self.name} is gone: nothing was published for {silent_s:.0f} s"))
        else:
            silent = self.is_wanted and silent_s >= SILENCE_S
            if silent and not self._told_of_silence and not self._away:
                text = "%s: nothing has come for %.0f s, although its publisher is there. Does its lidar scan?"
                _log.warning(text, self.name, silent_s)
            self._told_of_silence = silent
            self._watch_in(SILENCE_S)

    def let_go(self, error: DeviceLost | None) -> None:
        """Close the bus; readers are told before that where the publisher is lost."""
        if self._timer is not None:
            self._timer.cancel()
        self._closer = begin_task(self._loop, self._close(error), "lidario: close zenoh")

    async def wait_closed(self) -> None:
        """As `Port.wait_closed`; zenoh takes two seconds at most, also where the publisher was lost."""
        await super().wait_closed()
        if self._closer is not None and not self.is_forked:
            await asyncio.wait([self._closer])

    async def _close(self, error: DeviceLost | None) -> None:
        try:
            if error is not None:
                # Readers are told first: closing takes a while.
                self.connection_lost(error)
        finally:
            await self._bus.close()
            if error is None:
                self.connection_lost(None)


def _is_ours(sample: Sample, raw: bool) -> bool:
    return (parse_raw_message(sample.payload) if raw else whole_scan(sample, 0)) is not None
