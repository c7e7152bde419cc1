"""`Link`: the incremental state machine between raw bytes and typed events.

::

    IDLE ──request with answer──> AWAIT_RESPONSE ──answer──> IDLE
                                        └──stream descriptor──> STREAMING ──STOP──> DRAINING ──drained()──> IDLE

Four verbs: `receive_data`, `events_received`, `send_request`, `data_to_send`. Time is an argument, and `hold` says
until when bytes of a stream may lie, so that they are cut together and not a few at a time. While it streams it
never looks for a descriptor, and while it waits for an answer it accepts only the one that was asked for, by type
*and* length, since ``A5 5A`` stands in scan data by chance about four times a second.
Whatever fits nowhere is counted in `LinkStats`; bytes never raise. Misuse does: `LocalProtocolError`.

The buffer is bounded: data is fed in slices, noise leaves at once, and no claimed length beyond the largest
expected answer is waited for.
"""

from __future__ import annotations

from bisect import bisect_right
from dataclasses import dataclass
from enum import Enum

from lidario.errors import LocalProtocolError
from lidario.wire.buffer import ReceiveBuffer
from lidario.wire.envelope import DESCRIPTOR_MAGIC, DESCRIPTOR_SIZE, Expected, Request, parse_descriptor
from lidario.wire.events import Descriptor, Event, Packets, Response, Skipped
from lidario.wire.formats import StreamFormat

__all__ = ["Link", "LinkState", "LinkStats"]

_SLICE = 32 * 1024
_LIMIT = 2 * _SLICE


class LinkState(Enum):
    """What the link makes of arriving bytes."""

    IDLE = "idle"
    AWAIT_RESPONSE = "await response"
    STREAMING = "streaming"
    DRAINING = "draining"


_AWAIT_RESPONSE, _STREAMING = LinkState.AWAIT_RESPONSE, LinkState.STREAMING
"""Looking a member up in its class is dear where it is done for every chunk."""


@dataclass(slots=True)
class LinkStats:
    """Running totals since the link was made; they only grow.

    Attributes:
        bytes_received: All bytes that came in.
        packets: Intact measurement packets.
        skipped_bytes: Bytes of a stream that belong to no packet.
        skipped_stretches: Stretches of such bytes.
        records: Known records between packets that carry no measurement.
        stray_bytes: Bytes outside a stream that are no answer.
        drained_bytes: Leftovers thrown away after a STOP.
        late_answers: Answers that match the request in type and size, but not in what they answer.
    """

    bytes_received: int = 0
    packets: int = 0
    skipped_bytes: int = 0
    skipped_stretches: int = 0
    records: int = 0
    stray_bytes: int = 0
    drained_bytes: int = 0
    late_answers: int = 0


class Link:
    """The host's end of the line, sans-IO.

    Attributes:
        state: What arriving bytes mean at the moment.
        stats: Running totals.
    """

    def __init__(self) -> None:
        self.state = LinkState.IDLE
        self.stats = LinkStats()
        self._buffer = ReceiveBuffer(_LIMIT)
        self._events: list[Event] = []
        self._outgoing = bytearray()
        self._pending: Request | None = None
        self._format: StreamFormat | None = None
        self._noise = 0
        self._held_until = 0
        self._arrivals: list[tuple[int, int]] = []

    @property
    def buffered(self) -> int:
        """Bytes received and not yet understood."""
        return len(self._buffer)

    def receive_data(self, data: bytes | bytearray | memoryview, now: int) -> None:
        """Take bytes that arrived at `now` (nanoseconds); collect what they mean by `events_received`."""
        self.stats.bytes_received += len(data)
        if len(data) <= _SLICE:
            self._feed(data, now)
            return
        view = memoryview(data)
        for start in range(0, len(view), _SLICE):
            self._feed(view[start : start + _SLICE], now)

    def events_received(self) -> list[Event]:
        """The events since the last call, oldest first."""
        events, self._events = self._events, []
        return events

    def send_request(self, request: Request) -> None:
        """Queue a request for `data_to_send` and expect its answer.

        Raises:
            LocalProtocolError: Another answer is pending, or packets flow and this request would stop them
                unannounced.
        """
        if request.ends_stream:
            self._leave_stream()
            self._pending = None
            self.state = LinkState.DRAINING
        elif self.state is LinkState.STREAMING and not request.in_stream:
            raise LocalProtocolError(f"{request.name} may not be sent while packets flow: stop the stream first")
        elif self.state is LinkState.AWAIT_RESPONSE:
            raise LocalProtocolError(f"{request.name} may not be sent while an answer is pending: wait for it")
        elif request.expects is not None and not request.in_stream:
            self._pending = request
            self.state = LinkState.AWAIT_RESPONSE
        self._outgoing += request.data

    def data_to_send(self) -> bytes:
        """The bytes to write to the port now."""
        data = bytes(self._outgoing)
        self._outgoing.clear()
        return data

    def give_up(self) -> None:
        """Stop waiting for the pending answer; should it still come, it is thrown away and counted."""
        if self.state is LinkState.AWAIT_RESPONSE:
            self.stats.stray_bytes += self._buffer.clear()
            self._pending = None
            self.state = LinkState.IDLE

    def hold(self, until: int) -> None:
        """Let what comes of the stream before `until` (nanoseconds) lie, and cut it all at once after that.

        For whoever knows that nothing in it matters before: the events are the same, only later, and fewer. What
        has gathered is cut earlier when it fills half the buffer.
        """
        self._held_until = until

    def drained(self) -> None:
        """The line has fallen quiet after a STOP: from now on a byte that nobody asked for is stray."""
        if self.state is LinkState.DRAINING:
            self.state = LinkState.IDLE

    def _feed(self, data: bytes | bytearray | memoryview, now: int) -> None:
        self._buffer.append(data)
        state = self.state
        if state is _AWAIT_RESPONSE:
            self._await_response(now)
            state = self.state
        if state is _STREAMING:
            if now < self._held_until and len(self._buffer) < _SLICE:
                self._arrivals.append((len(self._buffer), now))
            else:
                self._stream(now)
        elif state is LinkState.DRAINING:
            self.stats.drained_bytes += self._buffer.clear()
        elif state is LinkState.IDLE:
            self.stats.stray_bytes += self._buffer.clear()

    def _await_response(self, now: int) -> None:
        """Hunt for the one descriptor that answers the pending request."""
        request, buffer = self._pending, self._buffer
        if request is None or request.expects is None:
            return
        while True:
            place = buffer.find(DESCRIPTOR_MAGIC)
            if place < 0:
                # The last byte may be the first of the two.
                self._stray(len(buffer) - buffer.data.endswith(DESCRIPTOR_MAGIC[:1]))
                return
            self._stray(place)
            if len(buffer) < DESCRIPTOR_SIZE:
                return
            descriptor = parse_descriptor(buffer.peek(DESCRIPTOR_SIZE))
            if descriptor is None or not request.expects.admits(descriptor):
                self._stray(1)
            elif descriptor.continuous:
                buffer.skip(DESCRIPTOR_SIZE)
                self._enter_stream(request, descriptor)
                return
            elif len(buffer) < DESCRIPTOR_SIZE + descriptor.size or self._answer(request.expects, descriptor, now):
                return

    def _answer(self, expected: Expected, descriptor: Descriptor, now: int) -> bool:
        payload = self._buffer.peek(descriptor.size, DESCRIPTOR_SIZE)
        if not payload.startswith(expected.prefix):
            self.stats.late_answers += 1
            self._stray(1)
            return False
        self._buffer.skip(DESCRIPTOR_SIZE + descriptor.size)
        self._pending = None
        self.state = LinkState.IDLE
        self._events.append(Response(descriptor.type, payload, now))
        return True

    def _enter_stream(self, request: Request, descriptor: Descriptor) -> None:
        self._pending = None
        self._events.append(descriptor)
        self._format = request.stream
        self.state = LinkState.STREAMING

    def _leave_stream(self) -> None:
        self.stats.drained_bytes += self._buffer.clear()
        self._format = None
        self._noise = 0
        self._held_until = 0
        self._arrivals.clear()

    def _stream(self, now: int) -> None:
        """Cut the buffer into runs of packets and stretches of noise, as far as the bytes at hand decide it."""
        wire, buffer, at = self._format, self._buffer, 0
        if wire is None or len(buffer) < wire.shortest:
            return
        data = buffer.data
        while len(data) - at >= wire.shortest:
            run, noise, count = wire.cut(data, at)
            if noise == at:
                break
            if count:
                self._end_noise()
                self.stats.packets += count
                with memoryview(data) as view:
                    packets = bytes(view[at:run])
                received, earlier = self._came(wire, packets, at, now) if self._arrivals else (now, ())
                self._events.append(Packets(packets, count, received, earlier))
            if noise > run:
                self._skip(wire, data, run, noise)
            at = noise
        if at:
            buffer.skip(at)
        self._arrivals.clear()

    def _came(
        self, wire: StreamFormat, packets: bytes, start: int, now: int
    ) -> tuple[int, tuple[tuple[int, int], ...]]:
        """When these packets, which lay in the buffer from `start`, were complete, and some of them before that."""
        offsets = wire.offsets(packets)
        earlier: list[tuple[int, int]] = []
        done = 0
        for received, at_ns in self._arrivals:
            if received >= start + len(packets):
                return at_ns, tuple(earlier)
            complete = bisect_right(offsets, received - start) - 1
            if complete > done:
                earlier.append((complete, at_ns))
                done = complete
        return now, tuple(earlier)

    def _skip(self, wire: StreamFormat, data: bytearray, start: int, end: int) -> None:
        if not self._noise and wire.aside(data, start) == end - start:
            self.stats.records += 1
            return
        self._noise += end - start
        self.stats.skipped_bytes += end - start

    def _end_noise(self) -> None:
        if self._noise:
            self.stats.skipped_stretches += 1
            self._events.append(Skipped(self._noise))
            self._noise = 0

    def _stray(self, size: int) -> None:
        if size:
            self.stats.stray_bytes += size
            self._buffer.skip(size)
