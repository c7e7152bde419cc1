"""All lidars of a fleet through one connection: one reader of ``robots/*/scan``.

Scans arrive whole (`Share`, or a topic of ROS 2), or are decoded here from the bytes of the device, each with the
key of its lidar. What is missing is told: the next scan of that lidar says how much.
"""

import asyncio
import logging
from collections import deque
from collections.abc import Iterable, Iterator
from typing import Final, NamedTuple, Self

from lidario.basics.arguments import shown, whole
from lidario.basics.entered import Entered
from lidario.errors import Busy, InvalidValue, LocalProtocolError, SessionClosed
from lidario.network.bus import DEFAULT_ROUTER, Bus, Sample
from lidario.network.keys import Attachment, check_key, parse_attachment, status_key
from lidario.network.messages import is_raw, whole_scan
from lidario.network.raw import Decoders
from lidario.network.senders import Senders
from lidario.network.status import Status
from lidario.port.background import running_loop
from lidario.port.wall_clock import WallClock
from lidario.scans.scan import Scan
from lidario.session.streaming.stream import check_loop

_log = logging.getLogger("lidario")

MOST_MISSING: Final = 4096  # lidars of which messages are missing that no scan has told of yet
_STATUS: Final = status_key("")
MOST_BYTES: Final = 64 << 20
"""Of all scans that wait: two of each of a thousand lidars."""
_SAMPLE_BYTES: Final = 9
_SCAN_BYTES: Final = 2048


class FleetScan(NamedTuple):
    """One scan of one lidar.

    Attributes:
        key: Which lidar.
        scan: The scan.
        sent_ns: When it was sent, nanoseconds since the Unix epoch, by the clock of its publisher; 0 where it does
            not say.
        lost: Messages of this lidar that are missing since the scan before: lost on the way, or dropped here
            because the reader was slow. A message is a scan; of raw bytes, a part of one.
    """

    key: str
    scan: Scan
    sent_ns: int
    lost: int


class Fleet(Entered):
    """Reads the scans of many lidars; an asynchronous context manager and iterator.

    ::

        async with Fleet("robots/*/scan", router="tcp/fleet.example:7447") as fleet:
            async for each in fleet:
                print(each.key, each.scan.nearest())

    A lidar that comes is read from then on; one that sends raw bytes, as soon as it has told what it is, which it
    does once a second. One that goes brings nothing any more. While the router is away nothing comes.

    Args:
        keys: A key with wildcards: ``*`` for one part, ``**`` for any number.
        router: Address of the zenoh router.
        depth: Scans of each lidar that wait for a slow reader; the oldest beyond that are dropped and counted. With
            1, the default, it gets the latest scan of each lidar in turn; more is for readers that want them all.

    Attributes:
        bad_messages: Messages that were no scan.

    Raises:
        InvalidValue: `keys` cannot be one, or `depth` is below 1.
    """

    _instead = "a fleet is read asynchronously: write `async with Fleet(...) as fleet:`, `async for each in fleet:`"

    def __init__(self, keys: str, *, router: str = DEFAULT_ROUTER, depth: int = 1) -> None:
        depth = whole(depth, "depth")
        if depth < 1:
            raise InvalidValue(f"a reader keeps at least one scan of each lidar, not {shown(depth)}")
        self._keys = check_key(keys, wildcards=True)
        self._router = router
        self._scans = WaitingScans(depth)
        self._is_read = False
        self._news = asyncio.Event()
        self._bus: Bus | None = None
        self._loop: asyncio.AbstractEventLoop | None = None  # in which it was opened
        self._senders = Senders(_tell_mixed)
        self._gaps = 0
        self._closed = False
        self.bad_messages: int = 0

    @property
    def lost(self) -> int:
        """Messages that were lost on the way: dropped by zenoh at a publisher or a router, or sent to no router."""
        return max(0, self._gaps - self._untaken)

    @property
    def dropped(self) -> int:
        """Scans, and messages that were not parsed, that were dropped because this program was slow."""
        return self._scans.dropped + self._untaken

    @property
    def _untaken(self) -> int:
        return 0 if self._bus is None else self._bus.dropped

    async def start(self) -> None:
        """Connect to the router; ``async with`` does so. Cancelling leaves nothing open.

        Raises:
            ConnectFailed: There is no router. Unlike a publisher, a reader does not wait for it.
            SessionClosed: Another task has closed it meanwhile, or started it.
            Unsupported: The package that is needed is not installed.
        """
        if self._bus is not None:
            raise LocalProtocolError("a fleet can be started once: make another one")
        loop = self._loop = running_loop()
        self._clock = WallClock(lambda: round(loop.time() * 1e9))
        self._decoders = Decoders(self._clock)
        bus = await Bus.open(self._router)
        try:
            if self._closed or self._bus is not None:
                raise SessionClosed("another task has closed the fleet meanwhile, or started it")
            bus.subscribe(status_key(self._keys), self._learn)
            bus.subscribe(self._keys, self._take)
        except BaseException:
            bus.close_soon()
            raise
        self._bus = bus

    async def close(self) -> None:
        """End the reading; who waits gets the end of the iteration. Harmless when done before."""
        self._closed = True
        self._news.set()
        if self._bus is not None:
            await self._bus.close()

    def __aiter__(self) -> Self:
        if self._bus is None:
            raise SessionClosed("the fleet is not open yet: write `async with Fleet(...) as fleet:`")
        return self

    async def __anext__(self) -> FleetScan:
        """The next scan of any lidar. Cancelling loses none.

        Raises:
            LocalProtocolError: It was called in another event loop, or in a forked child.
        """
        if self._is_read:
            raise Busy("two tasks read one fleet: give each its own")
        if self._loop is not None:
            check_loop(self._loop, "the fleet was opened")
        self._is_read = True
        try:
            # A reader that never waits itself would see what came before it was slow, and nothing else be done.
            await asyncio.sleep(0)
            while not self._scans:
                if self._closed:
                    raise StopAsyncIteration
                self._news.clear()
                await self._news.wait()
            return self._scans.take()
        finally:
            self._is_read = False

    def _learn(self, sample: Sample) -> None:
        attachment, status = parse_attachment(sample.attachment), Status.of(sample.payload)
        if attachment is not None and status is not None and status.form == "raw":
            self._decoders.of(sample.key.removesuffix(_STATUS), attachment.gid).learn(status)

    def _take(self, sample: Sample) -> Iterator[None]:
        attachment, gap = self._senders.follow(sample)
        self._gaps += gap
        found = self._scans_of(sample, attachment)
        if found is None:
            self.bad_messages += 1
            found = ()
        self._scans.miss(sample.key, gap)
        for scans in found:
            for scan in scans:
                self._scans.put(FleetScan(sample.key, scan, 0 if attachment is None else attachment.time_ns, 0))
            if scans:
                self._news.set()
            yield

    def _scans_of(self, sample: Sample, attachment: Attachment | None) -> Iterable[list[Scan]] | None:
        """The scans that a message holds or completes, in steps; None where it is none of ours."""
        if is_raw(sample.payload) and attachment is not None:
            return self._decoders.of(sample.key, attachment.gid).steps(sample.payload)
        number = 0 if attachment is None else max(0, attachment.number)
        scan = whole_scan(sample, self._clock.wall_offset_ns, number)
        return None if scan is None else [[scan]]


def _tell_mixed(key: str) -> None:
    text = "zenoh:%s: two publishers send under this key, and their scans come mixed. Give each its own key"
    _log.warning(text, key)


class WaitingScans:
    """Scans of many lidars that wait for one reader, so many of each; in the order in which they came.

    Each lidar has its own room: a lidar with many scans does not push out those of another. What is dropped is
    counted in the next scan of the same lidar. All together they are bounded in bytes: how many lidars there are is
    for the network to say.
    """

    def __init__(self, depth: int) -> None:
        self.dropped: int = 0
        self._depth = depth
        self._order: deque[str] = deque()
        self._scans: dict[str, deque[FleetScan]] = {}
        self._missing: dict[str, int] = {}
        self._size = 0

    def __len__(self) -> int:
        return len(self._order)

    def miss(self, key: str, count: int) -> None:
        """So many messages of a lidar are missing before its next scan, which tells it."""
        if count and (key in self._missing or len(self._missing) < MOST_MISSING):
            self._missing[key] = self._missing.get(key, 0) + count

    def put(self, item: FleetScan) -> None:
        """Add a scan; the oldest one of its lidar gives way where there are too many."""
        item = item._replace(lost=item.lost + self._missing.pop(item.key, 0))
        held = self._scans.setdefault(item.key, deque())
        held.append(item)
        self._size += _size(item)
        if len(held) > self._depth:
            # The next one takes its place in the order.
            self._drop(item.key)
        else:
            self._order.append(item.key)
        while self._size > MOST_BYTES and len(self._order) > 1:
            self._drop(self._order.popleft())

    def take(self) -> FleetScan:
        """The oldest scan; there must be one."""
        return self._oldest_of(self._order.popleft())

    def _oldest_of(self, key: str) -> FleetScan:
        """Take the oldest scan of a lidar."""
        held = self._scans[key]
        item = held.popleft()
        self._size -= _size(item)
        if not held:
            # Lidars come and go, and their number is not ours.
            del self._scans[key]
        return item

    def _drop(self, key: str) -> None:
        """Drop the oldest scan of a lidar; the next one tells what is missing."""
        gone = self._oldest_of(key)
        self.dropped += 1
        if held := self._scans.get(key):
            held[0] = held[0]._replace(lost=held[0].lost + gone.lost + 1)
        else:
            self.miss(key, gone.lost + 1)


def _size(item: FleetScan) -> int:
    return len(item.key) + _SAMPLE_BYTES * len(item.scan) + _SCAN_BYTES
