"""The device's end of a serial line: bytes leave one after the other, and requests are remembered.

The device pushes whole responses and whole *bursts* of equally spaced packets. How many bytes of a burst have left
by a moment is a closed formula in integers, so a tenth of a second of stream is one `push` and one `take` whatever
the number of packets in it, and an idle device costs nothing. A burst may be pushed ahead of time: packets that are
not made yet stay, and `withdraw` takes them back when the stream ends early.
"""

from collections import deque
from dataclasses import dataclass

from lidario.sim.device import Received

LOGGED = 4096  # requests that a device remembers
_NS = 1_000_000_000
_BITS_A_BYTE = 10  # start bit, eight data bits, stop bit


@dataclass(slots=True)
class _Burst:
    """Bytes queued together: packets of `size` bytes, of which the k-th is there at `ready + k * period`."""

    data: bytes
    ready: int
    size: int
    period: int
    start: int
    sent: int = 0


class TransmitQueue:
    """First in, first out, at the speed of the line: a byte takes ten bits."""

    def __init__(self, baudrate: int) -> None:
        self.baudrate = baudrate
        self._bursts: deque[_Burst] = deque()
        self._left = b""  # what left before a `cut` and was not fetched yet
        self.free_at: int = 0  # when the last byte queued so far will have left, or has left

    def airtime(self, count: int) -> int:
        """Nanoseconds that `count` bytes need on the line, rounded up."""
        return -(-count * _BITS_A_BYTE * _NS // self.baudrate)

    def push(self, data: bytes, ready: int, *, size: int = 0, period: int = 0) -> None:
        """Queue bytes that may begin to leave at `ready`, behind everything queued before.

        With a `size` they are packets, back to back, each made `period` nanoseconds behind the one before.

        Raises:
            ValueError: `data` is not a whole number of packets.
        """
        if not data:
            return
        size = size or len(data)
        if len(data) % size:
            raise ValueError(f"{len(data)} bytes are not a whole number of packets of {size}")
        burst = _Burst(data, ready, size, period, max(ready, self.free_at))
        self._bursts.append(burst)
        self.free_at = self._end(burst)

    def take(self, now: int) -> bytes:
        """Hand out the bytes whose last bit has left by `now`, and forget them."""
        parts = [self._left]
        self._left = b""
        while self._bursts:
            burst = self._bursts[0]
            gone = self._gone(burst, now)
            parts.append(burst.data[burst.sent : gone])
            if gone < len(burst.data):
                burst.sent = gone
                break
            self._bursts.popleft()
        return b"".join(parts)

    def wakeup(self, now: int) -> int | None:
        """When the response or packet that leaves next will have left completely; None with nothing queued."""
        if self._left:
            return now
        if not self._bursts:
            return None
        burst = self._bursts[0]
        index = burst.sent // burst.size
        made = burst.ready + index * burst.period
        end = (index + 1) * burst.size
        return max(now, made + self.airtime(burst.size), burst.start + self.airtime(end))

    def withdraw(self, now: int) -> None:
        """Take back the packets that are not made by `now`; what is made still leaves, to its last byte.

        Only bursts pushed with a `period` are taken back; a response is always sent, however late.
        """
        while self._bursts and self._bursts[-1].period:
            burst = self._bursts[-1]
            made = max(0, (now - burst.ready) // burst.period + 1)
            burst.data = burst.data[: made * burst.size]
            if burst.data:
                break
            self._bursts.pop()
        self.free_at = self._end(self._bursts[-1]) if self._bursts else min(self.free_at, now)

    def cut(self, now: int) -> None:
        """Lose every byte that has not left by `now`, in the middle of a packet if need be (a reboot)."""
        self._left = self.take(now)
        self._bursts.clear()
        self.free_at = now

    def _end(self, burst: _Burst) -> int:
        """When the last byte of `burst` will have left."""
        last_made = burst.ready + (len(burst.data) // burst.size - 1) * burst.period
        return max(last_made + self.airtime(burst.size), burst.start + self.airtime(len(burst.data)))

    def _gone(self, burst: _Burst, now: int) -> int:
        """How many bytes of `burst` have left by `now`: as many as were made, as many as the line carried."""
        if now < burst.start:
            return burst.sent
        carried = (now - burst.start) * self.baudrate // (_BITS_A_BYTE * _NS)
        offered = len(burst.data)
        if burst.period:
            packets, since = divmod(now - burst.ready, burst.period)
            under_way = since * self.baudrate // (_BITS_A_BYTE * _NS)
            offered = packets * burst.size + min(burst.size, under_way)
        return max(burst.sent, min(carried, offered, len(burst.data)))


class RequestLog(list[Received]):
    """The requests a simulated device saw, oldest first; beyond `LOGGED` the oldest go."""

    def add(self, at_ns: int, name: str, data: bytes, why: str = "", *, remark: str = "") -> None:
        """Remember one request; `why` says why it was discarded and is empty when it was obeyed."""
        self.append(Received(at_ns, name, data, obeyed=not why, why=why, remark=remark))
        del self[:-LOGGED]
