"""All lidars of a fleet through one connection: one reader of ``robots/*/scan``.

Scans come whole (`Share`, or a topic of ROS 2), each with the key of its lidar, in the order in which they arrive.
Raw bytes have to be decoded one stream after the other: open each as ``zenoh:KEY``.
"""

from __future__ import annotations

import asyncio
import time
from collections import deque
from types import TracebackType
from typing import Final, NamedTuple, NoReturn, Self

from lidario.errors import Busy, LocalProtocolError, SessionClosed
from lidario.laserscan import LaserScan
from lidario.network.bus import DEFAULT_ROUTER, Bus, Sample
from lidario.network.foreign import scan_of_laserscan
from lidario.network.keys import LASERSCAN_IN_KEY, check_key, parse_attachment
from lidario.network.messages import parse_scan
from lidario.scan import Scan

__all__ = ["Fleet", "FleetScan"]

MOST_PUBLISHERS: Final = 65536
"""Publishers whose messages are counted; those beyond are read, and their losses are not known."""


class FleetScan(NamedTuple):
    """One scan of one lidar.

    Attributes:
        key: Which lidar.
        scan: The scan.
        sent_ns: When it was sent, nanoseconds since the Unix epoch, by the clock of its publisher; 0 where it does
            not say.
        lost: Scans of this lidar that were lost on the way since the one before.
    """

    key: str
    scan: Scan
    sent_ns: int
    lost: int


class Fleet:
    """Reads the scans of many lidars; an asynchronous context manager and iterator.

    ::

        async with Fleet("robots/*/scan", router="tcp/fleet.example:7447") as fleet:
            async for each in fleet:
                print(each.key, each.scan.nearest())

    A lidar that comes is read from then on; one that goes brings nothing any more. While the router is away nothing
    comes.

    Args:
        keys: A key with wildcards: ``*`` for one part, ``**`` for any number.
        router: Address of the zenoh router.
        depth: Scans that wait for a slow reader; the oldest beyond that are dropped and counted.

    Attributes:
        lost: Scans that were lost on the way.
        bad_messages: Messages that were no scan.

    Raises:
        InvalidValue: `keys` cannot be one.
    """

    def __init__(self, keys: str, *, router: str = DEFAULT_ROUTER, depth: int = 64) -> None:
        self._keys = check_key(keys, wildcards=True)
        self._router = router
        self._scans: deque[FleetScan] = deque()
        self._depth = depth
        self._waiter: asyncio.Future[None] | None = None
        self._bus: Bus | None = None
        self._offset_ns = 0
        self._numbers: dict[tuple[str, bytes], int] = {}
        self._closed = False
        self._here = 0
        self.lost: int = 0
        self.bad_messages: int = 0

    @property
    def dropped(self) -> int:
        """Scans that were dropped because the reader was slow."""
        return self._here + (0 if self._bus is None else self._bus.dropped)

    async def start(self) -> None:
        """Connect to the router; ``async with`` does so. Cancelling leaves nothing open.

        Raises:
            ConnectFailed: There is no router. Unlike a publisher, a reader does not wait for it.
            Unsupported: The package that is needed is not installed.
        """
        if self._bus is not None:
            raise LocalProtocolError("a fleet can be started once: make another one")
        self._offset_ns = time.time_ns() - round(asyncio.get_running_loop().time() * 1e9)
        self._bus = await Bus.open(self._router)
        self._bus.subscribe(self._keys, self._take)

    async def close(self) -> None:
        """End the reading; who waits gets the end of the iteration. Harmless when done before."""
        self._closed = True
        self._wake()
        if self._bus is not None:
            await self._bus.close()

    async def __aenter__(self) -> Self:
        await self.start()
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        await self.close()

    def __enter__(self) -> NoReturn:
        raise LocalProtocolError("a fleet is entered asynchronously: write `async with`")

    def __exit__(self, *_: object) -> None:
        """Never reached; `with` looks for it before `__enter__` can say what to write."""

    def __aiter__(self) -> Self:
        if self._bus is None:
            raise SessionClosed("the fleet is not open yet: write `async with Fleet(...) as fleet:`")
        return self

    async def __anext__(self) -> FleetScan:
        """The next scan of any lidar. Cancelling loses none."""
        if self._waiter is not None:
            raise Busy("two tasks read one fleet: give each its own")
        while not self._scans:
            if self._closed:
                raise StopAsyncIteration
            self._waiter = asyncio.get_running_loop().create_future()
            try:
                await self._waiter
            finally:
                self._waiter = None
        return self._scans.popleft()

    def _take(self, sample: Sample) -> None:
        attachment = parse_attachment(sample.attachment)
        lost = 0
        if attachment is not None:
            publisher = (sample.key, attachment.gid)
            before = self._numbers.get(publisher)
            if before is not None or len(self._numbers) < MOST_PUBLISHERS:
                self._numbers[publisher] = attachment.number
            lost = max(0, attachment.number - before - 1) if before is not None else 0
            self.lost += lost
        scan = self._scan_of(sample, 0 if attachment is None else attachment.number)
        if scan is None:
            self.bad_messages += 1
            return
        self._scans.append(FleetScan(sample.key, scan, 0 if attachment is None else attachment.time_ns, lost))
        if len(self._scans) > self._depth:
            self._scans.popleft()
            self._here += 1
        self._wake()

    def _scan_of(self, sample: Sample, number: int) -> Scan | None:
        if LASERSCAN_IN_KEY not in sample.key:
            return parse_scan(sample.payload, self._offset_ns)
        laser = LaserScan.from_cdr(sample.payload)
        return None if laser is None else scan_of_laserscan(laser, max(0, number), self._offset_ns)

    def _wake(self) -> None:
        if self._waiter is not None and not self._waiter.done():
            self._waiter.set_result(None)
