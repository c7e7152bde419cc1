"""A port at whose other end is a publisher: the session above it is the one of a live device.

As a port that plays a recording does, it waits for the request `PLAY` and sends the descriptor of the stream that
runs. Raw messages are then handed over read by read, with the times at which the publisher read them, put on the
clock of this machine. Whole scans are handed to the session as they are.

Nobody else than the publisher drives the device: what is written here goes nowhere. Where its stream is interrupted
and starts anew, the session is told to start its own anew, too.

**What is missing.** Messages are numbered, so a scan that was lost on the way is a jump of `Scan.seq`, and counted.
Where two publishers send under one key, the first one is received as long as it sends; the other one is counted.

**Who is lost.** The publisher's liveliness token goes when its process or its line dies. It also goes, for us, when
the router does: then nothing is decided before the router is back and has had time to learn which tokens there are.
"""

from __future__ import annotations

import asyncio
import logging
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import Any, Final, Protocol, TypeAlias

from lidario.errors import DeviceLost
from lidario.laserscan import LaserScan
from lidario.network.bus import Bus, Sample
from lidario.network.device import SCAN_TYPE, RemoteStreams
from lidario.network.foreign import scan_of_laserscan
from lidario.network.keys import parse_attachment
from lidario.network.messages import Entry, parse_raw_message, parse_scan
from lidario.network.raw import joined, time_here
from lidario.network.senders import OneSender, Senders
from lidario.network.status import Status
from lidario.port.line import Line, Schedule
from lidario.port.port import Port
from lidario.recording.chronicle import StreamBegan, StreamEnded, event_of
from lidario.recording.device import PLAY, mode_type
from lidario.scan import Scan
from lidario.wire.envelope import encode_descriptor
from lidario.wire.events import Descriptor

__all__ = ["Audience", "RemotePort"]

_log = logging.getLogger("lidario")

GONE_S: Final = 0.5
"""From the end of a token to the loss: the news that the router is gone may come after it."""
SETTLE_S: Final = 5.0
"""From the return of the router to the loss of who has no token by then; a publisher tries every four seconds."""
SILENCE_S: Final = 5.0
"""Longest pause of a publisher that shows no token: a node that is not ours."""

MOST_TOKENS: Final = 1024
Take: TypeAlias = Callable[[Sample], Iterable[None] | None]
AGAIN_S: Final = 1.0  # from one warning about the lidar of a publisher to the next


class Audience(Protocol):
    """The session, as far as this port needs it."""

    def restart(self) -> None:
        """The stream was interrupted here: start it again."""
        ...

    def deliver(self, scan: Scan, missed: int) -> None:
        """A scan that came whole; so many are missing since the one before."""
        ...


class RemotePort(Port):
    """A port with a publisher at its other end.

    Args:
        bus: The connection to the router; closed with the port.
        key: The key of the lidar.
        form: ``raw``, ``scan`` or ``ros``.
        streams: What is known of it.
        sender: The 16 bytes that tell its publisher from others; empty where they are not known.
    """

    def __init__(self, bus: Bus, key: str, form: str, streams: RemoteStreams, sender: bytes) -> None:
        super().__init__(f"zenoh:{key}", streams.stream.began.baudrate if form == "raw" else 0)
        self._fixed_offset_ns = time.time_ns() - round(self._loop.time() * 1e9)
        self._remote = _RemoteLine(self, bus, form, streams, sender)
        self.connection_made(self._remote)

    @property
    def is_live(self) -> bool:
        """As `Port.is_live`: whether the device is there is watched here, by its publisher's token."""
        return False

    @property
    def wall_offset_ns(self) -> int:
        """As `Port.wall_offset_ns`; it stays as it was when the port was opened."""
        return self._fixed_offset_ns

    @property
    def bad_messages(self) -> int:
        """Messages that were none of ours, or came from a second publisher under the same key."""
        return self._remote.bad

    def follow(self, audience: Any) -> None:
        """Name the session (an `Audience`) that it receives for."""
        self._remote.audience = audience

    def receive(self, sample: Sample) -> Iterable[None] | None:
        """Take what was published under the key of the lidar; what is returned is work, in steps."""
        return self._remote.receive(sample)

    def learn(self, sample: Sample) -> None:
        """Take a status."""
        self._remote.learn(sample)

    def token_changed(self, token: str, alive: bool) -> None:
        """A token of the lidar came or went."""
        self._remote.token_changed(token, alive)


class _RemoteLine(Line):
    """Receives for the port."""

    def __init__(self, port: RemotePort, bus: Bus, form: str, streams: RemoteStreams, sender: bytes) -> None:
        self.audience: Audience | None = None
        self.bad = 0
        self._loop = asyncio.get_running_loop()
        self._port = port
        self._bus = bus
        self._streams = streams
        self._take: Take = {"raw": self._take_raw, "scan": self._take_scan}.get(form, self._take_laserscan)
        self._raw = form == "raw"
        self._closing = False
        self._wanted = False
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

    # ------------------------------------------------------------------------------------------ as a line

    def is_closing(self) -> bool:
        return self._closing

    def write(self, data: bytes) -> None:
        if data == PLAY and not self._closing:
            stream = self._streams.stream
            self._port.baudrate = stream.began.baudrate if self._raw else 0
            kind, size = (mode_type(stream), stream.began.packet_size) if self._raw else (SCAN_TYPE, 1)
            self._loop.call_soon(self._announce, encode_descriptor(Descriptor(kind, size, continuous=True)))

    def set_polling(self, latency: float, schedule: Schedule | None) -> None:  # noqa: ARG002
        # The session takes packets from now on, or no more.
        self._wanted = schedule is not None
        self._heard = self._loop.time()

    def close(self) -> None:
        self._end(None)

    def abort(self) -> None:
        self._end(None)

    def write_without_loop(self, data: bytes) -> None:
        """Nobody takes it."""

    def close_without_loop(self) -> None:
        self._closing = True
        self._bus.close_soon()

    # ------------------------------------------------------------------------------------------ receiving

    def receive(self, sample: Sample) -> Iterable[None] | None:
        self._heard = self._loop.time()
        if self._closing or self._port.is_forked:
            return None
        attachment, gap = self._senders.follow(sample)
        gid = b"" if attachment is None else attachment.gid
        who = self._sender.follow(gid, self._loop.time(), lambda: _is_ours(sample, self._raw))
        if who == "rival":
            self.bad += 1
            if attachment is not None and not self._told_of_rival:
                self._told_of_rival = True
                text = "%s: two publishers send under this key; the second one is ignored. Give each its own key"
                _log.warning(text, self._port.name)
            return None
        if who == "new":
            # What its bytes mean it tells itself.
            self._flows, self._gap, self._seq = not self._raw, 0, None
        self._gap += gap
        return self._take(sample)

    def learn(self, sample: Sample) -> None:
        status, attachment = Status.of(sample.payload), parse_attachment(sample.attachment)
        if status is None or self._closing or self._sender.is_other(b"" if attachment is None else attachment.gid):
            return
        if status.lost != self._away and (now := self._loop.time()) - self._told_away_at >= AGAIN_S:
            self._away, self._told_away_at = status.lost, now
            _log.warning("%s: %s", self._port.name, status.lost or "the lidar is back at its publisher")
        self._streams.about = status.about
        for event in status.about.events:
            if self._raw and isinstance(event, StreamBegan):
                self._begin(event)
            else:
                self._streams.learn(event)

    def _take_scan(self, sample: Sample) -> None:
        scan = parse_scan(sample.payload, self._port.wall_offset_ns)
        if scan is not None:
            before, self._seq = self._seq, scan.seq
            if before is not None and scan.seq > before:
                # What its publisher itself has missed is in it, too.
                self._gap = scan.seq - before - 1
        self._deliver(scan)

    def _take_laserscan(self, sample: Sample) -> None:
        laser = LaserScan.from_cdr(sample.payload)
        self._deliver(None if laser is None else scan_of_laserscan(laser, 0, self._port.wall_offset_ns))

    def _deliver(self, scan: Scan | None) -> None:
        if scan is None:
            self.bad += 1
            return
        missed, self._gap = self._gap, 0
        if self._wanted and self.audience is not None:
            self.audience.deliver(scan, missed)

    def _take_raw(self, sample: Sample) -> Iterator[None]:
        entries = parse_raw_message(sample.payload)
        if entries is None:
            self.bad += 1
            return
        reads: list[tuple[bytes, int]] = []
        for entry in entries:
            if entry.is_event:
                self._hand_over(reads)
                reads = []
                self._take_event(entry)
                yield
            elif self._wanted and self._flows:
                at_ns = time_here(entry.at_ns, self._streams.stream.began, self._port.wall_offset_ns)
                if at_ns is None:
                    self.bad += 1
                    break
                self._port.show("in", entry.data, at_ns)
                reads.append((entry.data, at_ns))
        self._hand_over(reads)

    def _hand_over(self, reads: Sequence[tuple[bytes, int]]) -> None:
        """Hand over what was read at those times, as one piece: a message may have thousands of reads."""
        if reads:
            data, now, arrivals = joined(reads)
            self._port.hand_over(data, now, arrivals)

    def _take_event(self, entry: Entry) -> None:
        event = event_of(entry.data.decode("utf-8", "replace"))
        if isinstance(event, StreamBegan):
            self._begin(event)
        elif isinstance(event, StreamEnded):
            self._flows = False
        elif event is not None:
            self._streams.learn(event)

    def _begin(self, began: StreamBegan) -> None:
        if began == self._streams.stream.began and self._flows:
            return
        if self._streams.stream.family.stream_in(began.mode) is None:
            self.bad += 1
            return
        self._streams.begin(began)
        self._flows = True
        if self._wanted and self.audience is not None:
            self._wanted = False
            self.audience.restart()

    def _announce(self, descriptor: bytes) -> None:
        if not self._closing:  # Shown, too: recordings count what was received.
            self._port.data_received(descriptor)

    # ------------------------------------------------------------------------------------------ who is there

    def token_changed(self, token: str, alive: bool) -> None:
        if alive:
            if len(self._tokens) < MOST_TOKENS:
                self._tokens.add(token)
            self._has_token = True
        else:
            self._tokens.discard(token)
            self._watch_in(GONE_S)

    def _router_changed(self, connected: bool) -> None:
        if connected:
            _log.warning("%s: the zenoh router is back", self._port.name)
            self._watch_in(SETTLE_S)
        else:
            _log.warning("%s: the zenoh router at %s is lost, waiting for it", self._port.name, self._bus.router)

    def _watch_in(self, seconds: float) -> None:
        if self._timer is not None:
            self._timer.cancel()
        self._timer = self._loop.call_later(seconds, self._watch)

    def _watch(self) -> None:
        if self._closing or not self._bus.is_connected:
            return
        silent_s = self._loop.time() - self._heard
        if self._has_token and not self._tokens:
            self._end(DeviceLost(f"{self._port.name} is gone: its publisher has ended or cannot be reached"))
        elif not self._has_token and silent_s >= SILENCE_S:
            self._end(DeviceLost(f"{self._port.name} is gone: nothing was published for {silent_s:.0f} s"))
        else:
            silent = self._wanted and silent_s >= SILENCE_S
            if silent and not self._told_of_silence and not self._away:
                text = "%s: nothing has come for %.0f s, although its publisher is there. Does its lidar scan?"
                _log.warning(text, self._port.name, silent_s)
            self._told_of_silence = silent
            self._watch_in(SILENCE_S)

    def _end(self, error: DeviceLost | None) -> None:
        if self._closing:
            return
        self._closing = True
        self._wanted = False
        if self._timer is not None:
            self._timer.cancel()
        self._closer = self._loop.create_task(self._close(error), name="lidario: close zenoh")

    async def _close(self, error: DeviceLost | None) -> None:
        try:
            if error is not None:
                # Readers are told first: closing takes a while.
                self._port.connection_lost(error)
        finally:
            await self._bus.close()
            if error is None:
                self._port.connection_lost(None)


def _is_ours(sample: Sample, raw: bool) -> bool:
    if raw:
        return parse_raw_message(sample.payload) is not None
    return parse_scan(sample.payload, 0) is not None or LaserScan.from_cdr(sample.payload) is not None
