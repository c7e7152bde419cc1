"""What is known of the line to one device: its port, what `Link` has found in its bytes, and the counters of both.

`Dialogue` talks on it. Whoever needs a time, a counter or a tap asks here and knows neither port nor parser.
"""

from __future__ import annotations

from lidario.model import LineErrors
from lidario.port.line import Schedule, Tap
from lidario.port.port import Port
from lidario.recording.chronicle import Chronicle
from lidario.session.delivery import Delivery
from lidario.wire.envelope import Request
from lidario.wire.link import Link, LinkStats
from lidario.wire.states import LinkState

__all__ = ["DeviceLine"]


class DeviceLine:
    """One open port, the parser of what it receives, and where the packets go.

    Attributes:
        chronicle: What happened so far, for recordings.
    """

    def __init__(self, port: Port) -> None:
        self.chronicle: Chronicle = Chronicle()
        self._port = port
        self._errors_before = port.errors
        self._link = Link()
        self._delivery = Delivery(self._link.stats)

    @property
    def stats(self) -> LinkStats:
        """Counters of everything that was received."""
        return self._link.stats

    @property
    def buffered(self) -> int:
        """Bytes received that belong to nothing complete yet."""
        return self._link.buffered

    @property
    def errors(self) -> LineErrors:
        """As `Port.errors`, without what was counted before at other speeds."""
        return self._port.errors - self._errors_before

    @property
    def baudrate(self) -> int:
        """Speed of the line in bits a second; 0 where bytes take no time."""
        return self._port.baudrate

    @property
    def port_name(self) -> str:
        """What was opened, as `Port.name`."""
        return self._port.name

    @property
    def is_open(self) -> bool:
        """Whether requests can still be written."""
        return self._port.is_open

    @property
    def is_streaming(self) -> bool:
        """Whether packets flow, as far as is known."""
        return self._link.state is LinkState.STREAMING

    @property
    def bytes_received(self) -> int:
        """All bytes that came in so far."""
        return self._link.stats.bytes_received

    @property
    def bytes_fed(self) -> int:
        """As `Link.fed`."""
        return self._link.fed

    @property
    def stream_at(self) -> int:
        """As `Link.stream_at`."""
        return self._link.stream_at

    @property
    def is_live(self) -> bool:
        """As `Port.is_live`."""
        return self._port.is_live

    @property
    def wall_offset_ns(self) -> int:
        """As `Port.wall_offset_ns`."""
        return self._port.wall_offset_ns

    def now(self) -> int:
        """As `Port.now`."""
        return self._port.now()

    def set_polling(self, latency: float, schedule: Schedule | None) -> None:
        """As `Port.set_polling`."""
        self._port.set_polling(latency, schedule)

    def set_repeat(self, request: Request | None, interval: float = 0.0) -> None:
        """As `Port.set_repeat`."""
        self._port.set_repeat(b"" if request is None else request.data, interval)

    @property
    def repeated(self) -> int:
        """As `Port.repeated`."""
        return self._port.repeated

    def poll(self) -> None:
        """As `Port.poll`."""
        self._port.poll()

    @property
    def taps(self) -> tuple[Tap, ...]:
        """As `Port.taps`."""
        return self._port.taps

    def add_tap(self, tap: Tap) -> None:
        """As `Port.add_tap`."""
        self._port.add_tap(tap)

    def remove_tap(self, tap: Tap) -> None:
        """As `Port.remove_tap`."""
        self._port.remove_tap(tap)
