"""What a device sends in one scan mode: its packets, and the scans that the session makes of them."""

import asyncio
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from lidario.basics.model import ScanMode, Stats
from lidario.conformance.rule import Broken
from lidario.errors import LidarError, Unsupported
from lidario.families.stream import Stream
from lidario.scans.scan import Scan
from lidario.session.streaming.stream import ScanStream
from lidario.wire.events import Packets
from lidario.wire.formats import HEADING_MASK
from lidario.wire.stats import LinkStats

if TYPE_CHECKING:
    from lidario.conformance.bench import Bench

FLOW_S = 1.0
"""How long packets are collected. A USB adapter dates them by 16 ms late at most, which is 1.6 % of it."""
STEADY_S = 5.0  # how long a rotor may change its speed behind its first packets
LIKE, ALIKE = 0.01, 2
"""So many neighbours whose speeds differ by less than that share: then the rotor has its speed."""
SCANS = 8  # revolutions of each mode; the slowest rotor takes 0.5 s for one


@dataclass(slots=True, eq=False)
class Flow:
    """The packets of one stream, as the line brought them."""

    mode: ScanMode
    stream: Stream  # what is known of it
    stats: LinkStats  # the counters of the line
    began: float  # when its start was asked for, seconds of the event loop's clock
    announced_s: float  # seconds until the device had responded to the start
    first_s: float = 0.0  # seconds until the first packet
    first: asyncio.Event = field(default_factory=asyncio.Event)  # set with the first packet
    packets: list[Packets] = field(default_factory=list)  # what has come
    _skipped: tuple[int, int] = (0, 0)

    def take(self, packets: Packets) -> tuple[None, ...]:
        """Take packets. No scan is made of them, and the counters tell that."""
        self.stats.unread_packets += packets.count
        first = self._skipped[0] if self.packets else self.stats.skipped_bytes
        self._skipped = first, self.stats.skipped_bytes
        self.packets.append(packets)
        self.first.set()
        return ()

    @property
    def skipped(self) -> int:
        """Bytes between its packets that belong to none: the line, or the device, has damaged some.

        Who begins to listen to a device that only talks meets half a packet, which is no damage.
        """
        first, last = self._skipped
        return last - first

    def sample_us(self) -> float:
        """Microseconds a sample, by the times at which the packets came."""
        wire, behind = self.stream.format, self.packets[1:]
        if wire.whole:
            # The rotor turns on where the device sees nothing.
            samples = sum(each.count for each in behind) * wire.pitch
        else:
            samples = sum(wire.samples_in(each.blocks) for each in behind)
        took = self.packets[-1].received_ns - self.packets[0].received_ns
        return took * 1e-3 / samples if samples else 0.0

    def turns_ns(self) -> NDArray[np.float64]:
        """What each revolution took by the device's clock; empty where no packet is a whole one."""
        wire = self.stream.format
        if not wire.whole or wire.ticks is None:
            return np.empty(0)
        passed = np.diff(np.concatenate([wire.stamps(each) for each in self.packets])) % wire.ticks.wrap
        # Of those between which some are missing, what one took.
        took: NDArray[np.float64] = passed / np.maximum(np.rint(passed / max(np.median(passed), 1)), 1)
        return took * wire.ticks.tick_ns

    def steps(self) -> NDArray[np.float64]:
        """Turns from the beginning of each packet to that of the next one, in [0, 1): clockwise ones are short."""
        wire = self.stream.format
        made = [np.asarray(wire.headings(each), np.int64) & HEADING_MASK for each in self.packets]
        steps: NDArray[np.float64] = np.diff(np.concatenate(made)) % wire.full_turn / wire.full_turn
        return steps


@dataclass(slots=True)
class Watch:
    """One scan mode, looked at: its packets, then scans in a row, with the counters before and behind these."""

    mode: ScanMode
    error: str = ""  # why there is nothing to see, if so
    unknown: bool = False  # whether that is because its format is not known here
    flow: Flow | None = None
    scans: list[Scan] = field(default_factory=list)
    before: Stats = field(default_factory=Stats)
    after: Stats = field(default_factory=Stats)

    @property
    def is_whole(self) -> bool:
        """Whether no packet of it was damaged, and none is missing."""
        return not (self.flow and self.flow.skipped) and self.after.lost_packets == self.before.lost_packets


async def steady(scans: ScanStream) -> Scan:
    """The first scan of a stream whose speed is that of those before, or the one that comes after `STEADY_S`."""
    loop = asyncio.get_running_loop()
    until, before, alike = loop.time() + STEADY_S, await anext(scans), 0
    while True:
        scan = await anext(scans)
        # NaN of a first scan is like nothing.
        alike = alike + 1 if abs(scan.rpm / before.rpm - 1) < LIKE else 0
        if alike == ALIKE or loop.time() > until:
            return scan
        before = scan


async def collect(bench: "Bench", mode: ScanMode) -> Watch:
    """Look at one mode: at its packets for a second, then at some scans."""
    watch = Watch(mode)
    try:
        watch.flow = await bench.flow(mode)
        await asyncio.sleep(FLOW_S)
        await bench.dialogue.quieten()
        # By its name: firmware that lists no modes leaves several with one number.
        async with bench.lidar.scans(mode.name, depth=SCANS) as scans:
            await steady(scans)
            # Not earlier: who begins to listen to a device that only talks meets half a packet.
            watch.before = bench.lidar.stats
            async for scan in scans:
                watch.scans.append(scan)
                if len(watch.scans) == SCANS:
                    break
            watch.after = bench.lidar.stats
    except Unsupported as error:
        watch.error, watch.unknown = str(error), True
    except (Broken, LidarError) as error:
        watch.error = f"{type(error).__name__}: {error}" if isinstance(error, LidarError) else str(error)
        # It may be streaming all the same, and the next mode is to be started.
        await bench.rest()
    return watch
