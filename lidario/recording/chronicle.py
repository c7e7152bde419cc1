"""What a session knows and its bytes alone do not tell: when each stream began and ended, and the responses.

The session keeps one `Chronicle` from its first request on. So a recording that begins later still knows what the
device responded when it was opened. A recording writes down all that is known when it begins, and then each thing
that is added. With that a replay plays exactly the bytes that a live stream was made of.

Places in the stream are counted in received bytes since the port was opened (`Link.fed`). A recording that goes on
over another line goes on counting, too.
"""

import json
from collections.abc import Callable, Iterable
from dataclasses import asdict, dataclass, fields, replace
from typing import Any, Final, Self, TypeVar

from lidario.basics.arguments import printable
from lidario.basics.model import ScanMode
from lidario.families.stream import Stream

MOST_NS = 1 << 62
"""Bound of all times and places in a file: the year 2116. Sums of two still fit in 64 bits with a sign."""
MOST_TURN_S = 3600.0
MOST_BAUD = 100_000_000
MOST_METRES = 1e6
SHORTEST_SAMPLE_US, LONGEST_SAMPLE_US = 0.01, 1e5
"""Far beyond every device. Figures outside are no figures of a device, and later steps could not bear them."""
MOST_RATES = 8
MOST_RESPONSES = 512
"""Different requests whose responses are kept; devices have a few dozen."""
LONGEST_EVENT = 1 << 16  # letters of one event in a file; ours have some hundred


@dataclass(frozen=True, slots=True)
class StreamBegan:
    """A stream was started, or had been started before the recording began."""

    at: int  # place of the first byte behind its descriptor
    request: bytes  # the request that started it
    mode: ScanMode
    packet_size: int  # length that its descriptor states
    sample_ns: float  # nanoseconds a sample; 0 where the device does not say
    slowest_turn_s: float  # longest time one revolution may take
    baudrate: int  # speed of the line in bits a second; 0 where bytes take no time
    wall_offset_ns: int  # what was added to the monotonic clock to get the wall clock
    zero_offset_deg: float  # degrees that were added to every device angle
    may_take_ns: tuple[float, ...] = ()  # as in `Stream`
    # Whether it goes on where the one before had failed: what passed since then is counted as missed.
    continues: bool = False

    @classmethod
    def of(
        cls, stream: Stream, at: int, request: bytes, baudrate: int, wall_offset_ns: int, *, continues: bool = False
    ) -> Self:
        """What is known of a stream that begins now; the arguments are those of the class."""
        return cls(
            at=at,
            request=request,
            mode=stream.mode,
            packet_size=stream.format.shortest,
            sample_ns=stream.sample_ns,
            slowest_turn_s=stream.slowest_turn_s,
            baudrate=baudrate,
            wall_offset_ns=wall_offset_ns,
            zero_offset_deg=stream.zero_offset_deg,
            may_take_ns=stream.may_take_ns,
            continues=continues,
        )


@dataclass(frozen=True, slots=True)
class StreamEnded:
    """The stream was stopped, or interrupted to ask something."""

    at: int  # place behind the last byte that was used


@dataclass(frozen=True, slots=True)
class ZeroOffsetSet:
    """Another zero-angle offset was chosen for the stream that runs."""

    # Place behind the last byte that had been parsed. The first revolution that ends behind it has the new offset.
    at: int
    zero_offset_deg: float  # degrees that are added to every device angle from then on
    # Whether only the revolution behind that one has it, because sectors of it were handed out.
    behind: bool = False


@dataclass(frozen=True, slots=True)
class Responded:
    """The device responded to a request."""

    request: bytes
    kind: int  # its type
    payload: bytes  # the response without its descriptor


@dataclass(frozen=True, slots=True)
class Placed:
    """Only in files: what stands where bytes and events before it may be missing."""

    at: int  # place of the next received byte
    running: StreamBegan | None = None  # the stream that runs, with the latest zero-angle offset, or None


@dataclass(frozen=True, slots=True)
class LineChanged:
    """Only in files: the line to the device was lost, and the session came back over another one."""

    at: int  # place of the next received byte, the first of the new line
    away_ns: int  # time since the last byte before that


StreamEvent = StreamBegan | StreamEnded | ZeroOffsetSet | Responded | Placed | LineChanged


class EventState:
    """What events add up to."""

    def __init__(self, events: Iterable[StreamEvent] = ()) -> None:
        self.responses: dict[bytes, Responded] = {}  # the latest response to each request
        self.running: StreamBegan | None = None  # the stream that runs, with the latest zero-angle offset, or None
        for event in events:
            self.follow(event)

    @property
    def events(self) -> tuple[StreamEvent, ...]:
        """Those that add up to the same."""
        return (*self.responses.values(), *((self.running,) if self.running is not None else ()))

    def follow(self, event: StreamEvent | None) -> None:
        """Take note of the next event."""
        if isinstance(event, StreamBegan):
            self.running = event
        elif isinstance(event, StreamEnded):
            self.running = None
        elif isinstance(event, ZeroOffsetSet) and self.running is not None:
            self.running = replace(self.running, zero_offset_deg=event.zero_offset_deg)
        elif isinstance(event, Responded) and (
            event.request in self.responses or len(self.responses) < MOST_RESPONSES
        ):
            self.responses[event.request] = event


class Chronicle(EventState):
    """What has happened in one session; the stream that runs has the latest wall clock, too."""

    def __init__(self) -> None:
        super().__init__()
        self._watchers: tuple[Callable[[StreamEvent], None], ...] = ()
        self._started_by = b""

    def watch(self, watcher: Callable[[StreamEvent], None]) -> None:
        """Call `watcher` with everything that is added from now on."""
        self._watchers = (*self._watchers, watcher)

    def unwatch(self, watcher: Callable[[StreamEvent], None]) -> None:
        """Call it no more; ignored where it is not there."""
        self._watchers = tuple(each for each in self._watchers if each != watcher)

    def responded(self, request: bytes, kind: int, payload: bytes) -> None:
        """The device has responded."""
        event = Responded(request, kind, payload)
        if self.responses.get(request) != event and len(self.responses) < MOST_RESPONSES:
            self._tell(event)

    def started(self, request: bytes) -> None:
        """The device has sent the descriptor of a stream that was asked for by `request`."""
        self._started_by = request

    def began(
        self, stream: Stream, at: int, baudrate: int, wall_offset_ns: int, *, continues: bool = False
    ) -> None:
        """A stream is delivered from now on; the arguments are those of `StreamBegan`."""
        self._tell(StreamBegan.of(stream, at, self._started_by, baudrate, wall_offset_ns, continues=continues))

    def zero_offset_set(self, at: int, degrees: float, *, behind: bool) -> None:
        """The stream that runs gets another zero-angle offset; the arguments are those of `ZeroOffsetSet`."""
        if self.running is not None and degrees != self.running.zero_offset_deg:
            self._tell(ZeroOffsetSet(at, degrees, behind))

    def clock_set(self, wall_offset_ns: int) -> None:
        """The system's wall clock was set. A recording that runs goes on by the clock with which it began."""
        if self.running is not None:
            self.follow(replace(self.running, wall_offset_ns=wall_offset_ns))

    def ended(self, at: int) -> None:
        """The stream is not delivered any more."""
        if self.running is not None:
            self._tell(StreamEnded(at))

    def _tell(self, event: StreamEvent) -> None:
        self.follow(event)
        for watcher in self._watchers:
            watcher(event)


_KINDS = {
    StreamBegan: "began", StreamEnded: "ended", ZeroOffsetSet: "zero offset", Responded: "responded",
    Placed: "placed", LineChanged: "line changed",
}  # fmt: skip
_NAMED = {name: kind for kind, name in _KINDS.items()}
_Event = TypeVar("_Event", bound=StreamEvent)


def moved(event: _Event, by: int, least: int = 0, clock_ns: int = 0) -> _Event:
    """The event, its place so many bytes farther, and not before `least`, its clock set back by `clock_ns`."""
    if isinstance(event, Responded):
        return event
    if isinstance(event, Placed) and event.running is not None:
        event = replace(event, running=moved(event.running, by, least, clock_ns))
    elif isinstance(event, StreamBegan):
        event = replace(event, wall_offset_ns=event.wall_offset_ns - clock_ns)
    return replace(event, at=max(event.at + by, least))


def text_of(event: StreamEvent) -> str:
    """The event as one line of JSON, for a file."""
    record = {"event": _KINDS[type(event)], **asdict(event)}
    if record.get("running") is not None:
        record["running"] = {"event": _KINDS[StreamBegan], **record["running"]}
    return json.dumps(record, default=bytes.hex, separators=(",", ":"))


def event_of(text: str) -> StreamEvent | None:
    """The event that `text_of` wrote; None for anything else. The text may come from anybody."""
    if len(text) > LONGEST_EVENT or not text.startswith("{"):
        return None
    try:
        record = json.loads(text)
        return _event_of(record, _NAMED[record["event"]])
    except (ValueError, KeyError, TypeError, AttributeError, OverflowError, RecursionError):
        return None


def mode_of(record: dict[str, object]) -> ScanMode:
    """A scan mode from its JSON form.

    Raises:
        ValueError, KeyError, TypeError: It is none.
    """
    return ScanMode(
        id=_whole(record["id"]),
        name=printable(record["name"], 64),
        sample_us=_sample(record["sample_us"], 1.0),
        max_distance=_number(record["max_distance"], 0.0, MOST_METRES),
        response_type=_whole(record["response_type"]) & 0xFF,
        typical=record.get("typical") is True,
        details=printable(record.get("details", ""), 200),
    )


def _whole(value: object, least: int = 0, most: int = MOST_NS) -> int:
    if not isinstance(value, int) or not least <= value <= most:
        raise ValueError(value)
    return value


def _number(value: object, least: float, most: float) -> float:
    if not isinstance(value, int | float) or not least <= value <= most:  # NaN is not
        raise ValueError(value)
    return float(value)


def _sample(value: object, microsecond: float) -> float:
    """The time of a sample; 0 where it is not known."""
    return 0.0 if value == 0 else _number(value, SHORTEST_SAMPLE_US * microsecond, LONGEST_SAMPLE_US * microsecond)


_READ: Final[dict[str, Callable[[Any], Any]]] = {
    "at": _whole,
    "away_ns": _whole,
    "baudrate": lambda value: _whole(value, most=MOST_BAUD),
    "behind": lambda value: value is True,
    "continues": lambda value: value is True,
    "kind": lambda value: _whole(value) & 0xFF,
    "may_take_ns": lambda values: tuple(_sample(each, 1e3) for each in values[:MOST_RATES]),
    "mode": mode_of,
    "packet_size": lambda value: _whole(value) & 0x3FFF_FFFF,
    "payload": bytes.fromhex,
    "request": bytes.fromhex,
    "running": lambda value: None if value is None else _event_of(value, StreamBegan),
    "sample_ns": lambda value: _sample(value, 1e3),
    "slowest_turn_s": lambda value: _number(value, 1e-3, MOST_TURN_S),
    "wall_offset_ns": lambda value: _whole(value, least=-MOST_NS),
    "zero_offset_deg": lambda value: _number(value, -360.0, 360.0),
}
"""What each field of an event may be. One name means the same in all of them."""


def _event_of(record: dict[str, Any], kind: type[_Event]) -> _Event:
    told = {each.name: _READ[each.name](record[each.name]) for each in fields(kind) if each.name in record}
    return kind(**told)
