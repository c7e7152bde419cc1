"""When packets came that were stored without times: as soon after their last sample as live ones can.

Samples follow each other evenly, so counting them tells the time. What is missing took time too: the bytes that
were skipped tell how long, and the clock of the device corrects that, where its packets carry one. It tells of
outages as well of which no byte was stored.
"""

from collections.abc import Iterator
from itertools import pairwise
from typing import Final

from lidario.families.base import Stream
from lidario.revolution.device_clock import StampReader
from lidario.revolution.partial import part_of
from lidario.revolution.timing import DEVICE_DELAY_SAMPLES
from lidario.revolution.together import joined
from lidario.wire.blocks import Block
from lidario.wire.events import Arrival, Packets
from lidario.wire.formats import Ticks

_BELIEVED: Final = 3
"""Packets that follow each other, from which their stamps are believed: a false packet may say anything."""
_BACK_NS: Final = 1_000_000_000
"""By so much skipped bytes may tell too much. Any more is the long way round: an outage, or, where the clock went
back, another beginning of it, as of a device that was restarted."""


class StoredTimes:
    """Follows one stream."""

    def __init__(self, stream: Stream) -> None:
        self._wire, self._sample_ns = stream.format, stream.sample_ns
        self._packet_ns = self._wire.pitch * stream.sample_ns
        self._samples = 0.0
        self._last_ns = 0
        self._reader = StampReader(self._wire.ticks, self._packet_ns) if self._wire.ticks else None
        # Packets that follow each other up to now; the last ones that were believed: their stamp, and how many
        # samples there were; and whether something since then may be missing.
        self._run = 0
        self._believed: tuple[int, float] | None = None
        self._is_in_doubt = False

    @property
    def is_told(self) -> bool:
        return self._reader is not None

    def dated(self, packets: Packets) -> Packets:
        """The next packets, with the times at which they came."""
        wire = self._wire
        places = [0, *[at for at, _ in packets.skips if at], packets.count]
        if len(places) == 2:
            return self._dated(packets)
        parts = [part_of(packets, *each, None, wire, self._sample_ns) for each in pairwise(places)]
        return joined([self._dated(part) for part in parts])

    def _dated(self, packets: Packets) -> Packets:
        """As `dated`, where nothing was skipped but before the first of them."""
        return Packets(packets.data, packets.blocks, tuple(self._arrivals(packets)), packets.skips)

    def _arrivals(self, packets: Packets) -> Iterator[Arrival]:
        """When they came."""
        wire, done = self._wire, 0
        samples = packets.count * wire.pitch if wire.whole else wire.samples_in(packets.blocks)
        if packets.skipped:
            self._samples += packets.skipped * samples / len(packets.data)
        told_ns = wire.told_sample_ns(packets)
        if told_ns is not None:
            # Packets of one stream may hold more samples or fewer.
            held = [
                wire.pitch if wire.shortest == wire.longest else wire.samples_in((Block(size, 1),))
                for size, count in packets.blocks
                for _ in range(count)
            ]
            for number, (sample_ns, count) in enumerate(zip(told_ns.tolist(), held, strict=True), 1):
                self._samples += count * sample_ns / self._sample_ns
                yield number, self._came()
            return
        for at, missing in self._corrections(packets):
            self._samples += (at - done) * self._wire.pitch
            samples -= (at - done) * self._wire.pitch
            if at > done and missing > 0:
                yield at, self._came()
            self._samples += missing * self._wire.pitch
            done = at
        self._samples += samples
        yield packets.count, self._came()

    def _came(self) -> int:
        came_ns = round((self._samples - 1 + DEVICE_DELAY_SAMPLES) * self._sample_ns)
        self._last_ns = max(self._last_ns, came_ns)
        return self._last_ns

    def _corrections(self, packets: Packets) -> list[tuple[int, int]]:
        """Before which of these packets more are missing by the device's clock than were skipped."""
        reader, ticks = self._reader, self._wire.ticks
        if reader is None or ticks is None:
            return []
        stamps = self._wire.stamps(packets)
        odd = [at for at, _ in reader.gaps(stamps)]
        reader.add(stamps)
        if 2 * len(odd) > len(stamps):
            # The user has named another sample time, or hardly two packets follow each other.
            self._run, self._is_in_doubt = 0, True
            return []
        found, place = list[tuple[int, int]](), self._samples
        for begin, end in pairwise(sorted({0, *odd, packets.count})):
            if begin or begin in odd:
                self._run, self._is_in_doubt = 0, True
            self._run += end - begin
            first, place = place + self._wire.pitch, place + (end - begin) * self._wire.pitch
            if self._run >= _BELIEVED:
                missing = self._missing(int(stamps[begin]), first, ticks) if self._is_in_doubt else 0
                if missing:
                    found.append((begin, missing))
                    place += missing * self._wire.pitch
                self._believed, self._is_in_doubt = (int(stamps[end - 1]), place), False
        return found

    def _missing(self, stamp: int, place: float, ticks: Ticks) -> int:
        """How many packets more than were counted have passed since the last ones that were believed."""
        if self._believed is None:
            return 0
        before, since = self._believed
        apart_ns = (stamp - before) % ticks.wrap * ticks.tick_ns - (place - since) * self._sample_ns
        more_ns = (apart_ns + _BACK_NS) % (ticks.wrap * ticks.tick_ns) - _BACK_NS
        if stamp < before and more_ns > _BACK_NS:
            return 0
        return round(more_ns / self._packet_ns) if abs(more_ns) > 1.5 * ticks.tick_ns else 0
