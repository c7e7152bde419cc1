"""`Link`: the incremental state machine between raw bytes and typed events.

`lidario.wire.states` shows its states.

It has three verbs: `receive_data`, `events_received`, `send_request`. Time is an argument. While it streams, it
does not search for a descriptor. While it waits for a response, it accepts only the one that was requested, by type
*and* length, since ``A5 5A`` stands in scan data by chance about four times a second. No bytes raise an exception;
only misuse does: `LocalProtocolError`. (`OverflowError` would be a mistake in the parser.)

Every byte is counted in exactly one field of `LinkStats`, or is still in the buffer. The buffer is bounded: data is
fed in slices, noise leaves at once, and a response longer than the largest expected one is not waited for.
"""

from collections.abc import Sequence
from typing import Any

from lidario.errors import LocalProtocolError
from lidario.wire.arrived import ArrivedBytes, finds_packets
from lidario.wire.blocks import packet_offsets
from lidario.wire.envelope import (
    DESCRIPTOR_MAGIC,
    DESCRIPTOR_SIZE,
    Expected,
    Request,
    find_descriptor,
    find_lines,
)
from lidario.wire.events import Arrival, Descriptor, Event, Packets, Response
from lidario.wire.formats import StreamFormat
from lidario.wire.states import LinkState
from lidario.wire.stats import LinkStats

_SLICE = 64 * 1024
"""Bytes parsed at a time, by default: as many as come while a program blocks its loop for a second."""
_AWAIT_RESPONSE, _STREAMING = LinkState.AWAIT_RESPONSE, LinkState.STREAMING
"""Looking up an enum member takes 40 ns more than a global name, and this is done for every chunk."""


class Link:
    """The host's end of the line, sans-IO.

    Args:
        slice_size: Bytes of a long read that are parsed at a time; the buffer holds at most twice as many.
    """

    def __init__(self, slice_size: int = _SLICE) -> None:
        self.state: LinkState = LinkState.IDLE  # what arriving bytes mean at the moment
        self.stats: LinkStats = LinkStats()  # running totals
        self._slice_size = slice_size
        # Replaced, and never resized: a profiler or hook that keeps frames may hold views of it.
        self._buffer = bytearray()
        self._events: list[Event] = []
        self._pending: Request | None = None
        self._format: StreamFormat | None = None
        self._abandoned = False
        self._unasked = False
        self._noise = 0
        self.fed: int = 0  # bytes fed so far: all that were received, without those of `discard_data`
        self._arrivals = ArrivedBytes()
        # Where the packets of the latest stream begin, behind its descriptor, counted in bytes fed.
        self.stream_at: int = 0
        self._heard, self._heard_packets = b"", 0

    @property
    def buffered(self) -> int:
        """Bytes received and not yet parsed."""
        return len(self._buffer)

    def receive_data(
        self, data: bytes | bytearray | memoryview, now: int, arrivals: Sequence[Arrival] = ()
    ) -> None:
        """Take bytes; get their events by `events_received`.

        Args:
            data: The bytes, of one read or of several.
            now: Arrival of the last byte, in nanoseconds.
            arrivals: Needed if `data` was collected from several reads: pairs ``(bytes, at_ns)``, the first `bytes`
                bytes of `data` had arrived by `at_ns`; ascending, without the last read, which is `now`. A packet
                has arrived with the read that completed it.
        """
        self.stats.bytes_received += len(data)
        if arrivals:
            self._arrivals += [(self.fed + size, at_ns) for size, at_ns in arrivals]
        view = memoryview(data)
        for start in range(0, len(view), self._slice_size):
            piece = view[start : start + self._slice_size]
            self.fed += len(piece)
            if len(self._buffer) + len(piece) > 2 * self._slice_size:
                # A mistake in the parser shows here, and not as growing memory.
                raise OverflowError(f"{len(piece)} bytes do not fit behind {self.buffered} that nobody took")
            self._buffer = self._buffer + piece
            if self.state is _AWAIT_RESPONSE:
                self._await_response()
            if self.state is _STREAMING:
                self._stream(now)
            elif self.state is not _AWAIT_RESPONSE:
                if self.state is LinkState.DRAINING or self._unasked:
                    self.stats.drained_bytes += len(self._buffer)
                else:
                    self.stats.stray_bytes += len(self._buffer)
                self._buffer = bytearray()
        if self._format is not None and len(self._buffer) >= self._format.shortest:
            # Behind damage, the next bytes decide whether these are a packet; it then came now, before those.
            self._arrivals.keep(self.fed - len(self._buffer), self.fed, now)
        else:
            # All bytes are parsed, or too few are left for a packet.
            self._arrivals.clear()

    def discard_data(self, size: int, *, shown: bool = False) -> None:
        """Count `size` bytes that were received and are thrown away unparsed, because the host was too slow.

        The bytes before and after them are parsed as usual: a packet that is cut short is damage like any other.
        With `shown`, the discarded bytes count as fed, since recordings contain them.
        """
        self.fed += size if shown else 0
        self.stats.bytes_received += size
        self.stats.discarded_bytes += size

    def events_received(self) -> list[Event]:
        """The events since the last call, oldest first."""
        events, self._events = self._events, []
        return events

    def send_request(self, request: Request) -> None:
        """A request is about to be written: expect its response.

        Raises:
            LocalProtocolError: Another response is pending (also an abandoned one), or packets flow and this
                request is not one that may be sent meanwhile.
        """
        if request.ends_stream:
            if self.state is LinkState.AWAIT_RESPONSE and self._format is None:
                self.abandon()  # the device is busy with the pending request, and may not have heard this one
            else:
                self._drain()
            if not request.data and request.dtr is None:
                self._unasked = True
                self.state = LinkState.IDLE
        elif self.state is LinkState.STREAMING and not request.in_stream:
            raise LocalProtocolError(f"{request.name} may not be sent while packets flow: stop the stream first")
        elif self.state is LinkState.AWAIT_RESPONSE:
            raise LocalProtocolError(f"{request.name} may not be sent while a response is pending: wait for it")
        elif request.expects is not None and not request.in_stream:
            self._pending = request
            self._format = request.stream if request.packets else None
            self.state = LinkState.AWAIT_RESPONSE
        elif request.stream is not None:
            self.enter_stream(request.stream)
            self.stream_at = self.fed

    def forget(self) -> None:
        """Stop waiting for the pending response; if it still comes, its bytes are stray."""
        if self.state is LinkState.AWAIT_RESPONSE:
            self._stray(self.buffered)
            self._end_waiting()

    def abandon(self) -> None:
        """Nobody waits for the pending response any more, but the device is still busy with the request.

        The link goes on waiting. If the response comes, it is counted in `LinkStats.late_responses`, without an
        event. If the request started a stream, its packets are drained until a STOP has ended them.
        """
        self._abandoned = self.state is LinkState.AWAIT_RESPONSE

    def enter_stream(self, stream_format: StreamFormat) -> None:
        """From now on all bytes are a measurement stream that was announced before, for example in a file."""
        self._drain()
        self._format = stream_format
        self.state = LinkState.STREAMING

    def drained(self) -> None:
        """The line has fallen quiet after a STOP: from now on, unexpected bytes are stray."""
        if self.state is LinkState.DRAINING:
            self.state = LinkState.IDLE

    def _await_response(self) -> None:
        """Search for the response to the pending request: packets, lines, or a descriptor and what it announces."""
        request = self._pending
        if request is None or request.expects is None:
            return
        if self._format is not None:
            self._await_packets(request, self._format)
            return
        if request.expects.lines:
            self._await_lines(request, request.expects)
            return
        while True:
            stray, descriptor = find_descriptor(self._buffer, request)
            if stray:
                self._stray(stray)
            buffer = self._buffer
            if descriptor is None:
                return
            if descriptor.continuous:
                self._enter_stream(request, descriptor, DESCRIPTOR_SIZE)
                return
            if len(buffer) < DESCRIPTOR_SIZE + descriptor.size:
                return
            payload = bytes(buffer[DESCRIPTOR_SIZE : DESCRIPTOR_SIZE + descriptor.size])
            if payload.startswith(request.expects.prefix):
                self._take_response(Response(payload), DESCRIPTOR_SIZE + descriptor.size)
                return
            # This response belongs to an earlier request.
            self.stats.late_responses += 1
            self._stray(len(DESCRIPTOR_MAGIC))

    def _await_lines(self, request: Request, expected: Expected) -> None:
        stray, size, payload = find_lines(self._buffer, expected)
        self._stray(stray)
        if expected.continuous and payload == expected.accepted:
            self._enter_stream(request, Descriptor(expected.type, 0, continuous=True), size)
        elif payload is not None:
            self._take_response(Response(payload), size)

    def _await_packets(self, request: Request, wire: StreamFormat) -> None:
        """Wait until `Request.packets` packets have come; noise between them is no part of the response."""
        data, at = self._buffer, 0
        while len(data) - at >= wire.shortest:
            blocks, middle, end = wire.next_stretch(data, at)
            if end == at:
                break
            if blocks:
                self._heard += bytes(data[at:middle])
                self._heard_packets += sum(packets for _, packets in blocks)
                if self._heard_packets >= request.packets:
                    self._buffer = self._buffer[at:]
                    self._unasked = True
                    self._take_response(Response(self._heard), middle - at)
                    return
                self.stats.response_bytes += middle - at
            self.stats.stray_bytes += end - middle
            at = end
        self._buffer = self._buffer[at:]

    def _take_response(self, event: Response | Descriptor, size: int) -> None:
        """The first `size` bytes of the buffer are the response, or announce the stream that was asked for."""
        if self._abandoned:
            self.stats.late_responses += 1
        else:
            self._events.append(event)
        self._buffer = self._buffer[size:]
        self.stats.response_bytes += size
        self._end_waiting()

    def _enter_stream(self, request: Request, descriptor: Descriptor, size: int) -> None:
        """A stream was announced by the first `size` bytes of the buffer."""
        is_abandoned = self._abandoned
        self._take_response(descriptor, size)
        self.stream_at = self.fed - len(self._buffer)
        if is_abandoned:
            self._drain()
        else:
            self._format = request.announced_by(descriptor) or request.stream
            self.state = LinkState.STREAMING

    def _end_waiting(self) -> None:
        self._pending = self._format = None
        self._heard, self._heard_packets = b"", 0
        self._abandoned = False
        self.state = LinkState.IDLE

    def _drain(self) -> None:
        self._end_waiting()
        self.stats.drained_bytes += len(self._buffer)
        self._buffer = bytearray()
        self._noise = 0
        self.state = LinkState.DRAINING

    def _stream(self, now: int) -> None:
        """Parse the buffer into runs of packets and stretches of noise, as far as the bytes so far decide it."""
        wire, data, at = self._format, self._buffer, 0
        if wire is None:
            return
        shortest, size, arrivals = wire.shortest, len(data), self._arrivals
        # `before`: the fields of the format when a search behind damage began; `begin`: the place of that.
        before: dict[str, Any] = {}
        begin = 0
        while size - at >= shortest:
            if arrivals and not before:
                # Only the fields are copied: a search is hardly ever repeated, and copying a format once a
                # revolution takes 40 us.
                before, begin = vars(wire).copy(), at
            blocks, middle, end = wire.next_stretch(data, at)
            if end == at:
                break
            if blocks:
                skipped, self._noise = self._noise, 0
                stats = self.stats
                if skipped:
                    stats.skipped_stretches += 1
                count = blocks[0][1] if len(blocks) == 1 else sum([packets for _, packets in blocks])
                came: tuple[Arrival, ...] = ((count, now),)
                apart = False
                if arrivals:
                    fed = self.fed - size
                    came = arrivals.of(packet_offsets(blocks), fed + at, now)
                    if skipped and came[0][1] < now:
                        shown = data[begin : arrivals.last_until(came[0][1]) - fed]
                        apart = not finds_packets(wire, before, shown)
                stats.packets += count
                stats.packet_bytes += middle - at
                skips = ((0, skipped),) if skipped else ()
                with memoryview(data) as view:
                    self._events.append(Packets(bytes(view[at:middle]), blocks, came, skips, apart))
                before = {}
            if end > middle:
                self._skip(wire, data, middle, end)
            at = end
        if at:
            self._buffer = data[at:]

    def _skip(self, wire: StreamFormat, data: bytearray, start: int, end: int) -> None:
        if (wire.self_evident or not self._noise) and wire.other_record(data, start) == end - start:
            self.stats.records += 1
            self.stats.record_bytes += end - start
            return
        self._noise += end - start
        self.stats.skipped_bytes += end - start

    def _stray(self, size: int) -> None:
        self.stats.stray_bytes += size
        self._buffer = self._buffer[size:]
