"""Where the time of a revolution goes: what limits decoding in memory, and what limits reading live.

In memory a stream is taken in chunks of 4 KiB, first by `Link` alone, then with the search for the seam, then
wholly, with the decoder timed inside; what is left is the keeping of packets and the building of scans. Live, the
same work is done ten times a second instead of one after the other, with cold caches; and waking up costs something
even to who does nothing else.

A session does more for a revolution. The last table tells what the delivery that completes a revolution, or a
sector, calls, as `python -m benchmarks.walk pty` lists it, and the CPU of such deliveries at the device's own pace.
"""

from __future__ import annotations

import asyncio
import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any, Self
from unittest import mock

import lidario
from benchmarks.report import Result, Setting, Table, median, spread
from benchmarks.streams import KINDS, RATES, Kind, capture, recording
from benchmarks.walk import SECTOR_DEG, walked
from lidario.families.base import Decoder, Samples, Stream
from lidario.port.port import Port
from lidario.revolution.assemble import Assembler
from lidario.revolution.pipeline import Pipeline
from lidario.revolution.seam import Seam
from lidario.wire.events import Packets
from lidario.wire.link import Link

STAGES = ("Link", "headings, seam", "decoder", "keeping, scan")
_CHUNK = 4096
_LIVE = "S2 DenseBoost"
_TURN_S = 0.1
_WARM_UP = 5


class _Timed:
    """A decoder, and how long it took."""

    def __init__(self, decoder: Decoder) -> None:
        self.seconds = 0.0
        self._decoder = decoder

    def tell_time(self, sample_ns: float, *, passes: bool = True) -> None:
        self._decoder.tell_time(sample_ns, passes=passes)

    def fork(self) -> Self:
        return type(self)(self._decoder.fork())

    def decode(self, packets: Packets, following: bytes | None, room: int = 0, seam: int | None = None) -> Samples:
        start = time.perf_counter()
        samples = self._decoder.decode(packets, following, room, seam)
        self.seconds += time.perf_counter() - start
        return samples

    def is_whole(self, packets: Packets, following: bytes) -> bool:
        return self._decoder.is_whole(packets, following)

    def decode_several(
        self, packets: Packets, following: bytes, ends: Sequence[int], room: int, seam: int | None
    ) -> Samples | None:
        start = time.perf_counter()
        samples = self._decoder.decode_several(packets, following, ends, room, seam)
        self.seconds += time.perf_counter() - start
        return samples


def run(setting: Setting) -> Result:
    """Every format in memory; then one device at its own pace."""
    rounds, seconds, turns = (1, 0.6, 3) if setting.quick else (9, 2.0, 40)
    found: dict[str, dict[str, list[float]]] = {name: {} for name in KINDS}
    for number in range(rounds):
        setting.say(f"stages: round {number + 1} of {rounds}")
        for kind in KINDS.values():
            for stage, took in _stages(kind, seconds).items():
                found[kind.name].setdefault(stage, []).append(took)
    setting.say(f"stages: {_LIVE}, once in a while")
    live = {
        "a revolution, one after the other": _turns(turns, 0.0),
        f"a revolution, {1 / _TURN_S:.0f} times a second": _turns(turns, _TURN_S),
        "waking up after 20 ms, for nothing": _sleeps(turns, 0.020),
        "waking up after 1 ms, for nothing": _sleeps(turns, 0.001),
    }
    setting.say("stages: a session")
    walks, deliveries = walked("pty"), dict[str, dict[str, Any]]()
    session = Table("stages: a session on S2, the delivery that completes it", ["what", "calls", "CPU, µs"])
    for what, degrees in (("a revolution", 0.0), ("a sector", SECTOR_DEG)):
        (calls,) = (each.told for each in walks if f"completes {what}" in each.title)
        delivered = asyncio.run(_deliveries(turns, degrees))
        deliveries[what] = {"calls": calls, "us": delivered}
        session.add(what, calls, spread(delivered, 0))
    tables = [_table(found), _live_table(live), session]
    return Result("stages", tables, {"formats": found, "live": live, "deliveries": deliveries})


def _stages(kind: Kind, seconds: float) -> dict[str, float]:
    """Microseconds a revolution."""
    raw = capture(kind, seconds)
    alone = _through(kind.stream(), kind, raw, lambda _: None)
    stream = kind.stream()
    wire, seam = stream.format, Seam(stream.format.full_turn, stream.format.first_seam)
    sought = _through(stream, kind, raw, lambda packets: seam.splits(wire.headings(packets)))
    stream = kind.stream()
    decoder = _Timed(stream.decoder)
    assembler = Assembler(replace(stream, decoder=decoder))
    whole = _through(stream, kind, raw, assembler.add)
    parts = (alone, sought - alone, decoder.seconds, whole - sought - decoder.seconds)
    return {name: part / assembler.stats.scans * 1e6 for name, part in zip(STAGES, parts, strict=True)}


def _through(stream: Stream, kind: Kind, raw: bytes, take: Callable[[Packets], object]) -> float:
    """Seconds to pass a stream through a `Link` and what it reports to `take`."""
    link = _opened(stream, kind)
    start = time.perf_counter()
    for at in range(0, len(raw), _CHUNK):
        link.receive_data(raw[at : at + _CHUNK], 0)
        for event in link.events_received():
            if isinstance(event, Packets):
                take(event)
    return time.perf_counter() - start


def _opened(stream: Stream, kind: Kind) -> Link:
    link = Link()
    link.send_request(kind.request(stream.format))
    return link


def _turns(count: int, every_s: float) -> list[float]:
    """Microseconds of CPU for each of so many revolutions, from bytes to radians and metres."""
    kind = RATES[_LIVE].kind
    played, stream = recording(kind), kind.stream()
    pipeline = Pipeline(stream, link=_opened(stream, kind))
    pipeline.receive(played.descriptor + played.head)
    ends = (0, *played.loop_ends)
    found: list[float] = []
    while len(found) < count:
        begin, end = ends[len(found) % len(played.loop_ends)], ends[len(found) % len(played.loop_ends) + 1]
        time.sleep(every_s)
        start = time.thread_time_ns()
        for scan in pipeline.receive(played.loop[begin:end], len(found)):
            assert len(scan.angles) == len(scan.ranges)
        found.append((time.thread_time_ns() - start) / 1e3)
        if end == ends[-1]:
            pipeline.link.receive_data(played.loop[end:], len(found))
    return found


async def _deliveries(count: int, degrees: float) -> list[float]:
    """Microseconds of CPU for the deliveries that complete so many sectors of a width, or revolutions (0)."""
    took_ns = 0
    receive = Port.data_received

    def timed(port: Port, *given: Any, **how: Any) -> None:
        nonlocal took_ns
        start = time.thread_time_ns()
        receive(port, *given, **how)
        took_ns = time.thread_time_ns() - start

    found: list[float] = []
    with mock.patch.object(Port, "data_received", timed):
        async with (
            lidario.open_lidar("sim://rplidar-s2?via=pty") as lidar,
            lidar.sectors(degrees) if degrees else lidar.scans() as stream,
        ):
            for _ in range(_WARM_UP):
                await anext(stream)
            async for _ in stream:
                found.append(took_ns / 1e3)
                if len(found) == count:
                    return found
    return found


def _sleeps(count: int, seconds: float) -> list[float]:
    """Microseconds of CPU for each of so many naps."""
    found = []
    for _ in range(count):
        start = time.thread_time_ns()
        time.sleep(seconds)
        found.append((time.thread_time_ns() - start) / 1e3)
    return found


def _table(found: dict[str, dict[str, list[float]]]) -> Table:
    columns = ["format", "µs/rev", *(f"{stage}, µs" for stage in STAGES), *(f"{stage}, %" for stage in STAGES)]
    table = Table("stages: in memory, chunks of 4096 B", columns)
    for name, stages in found.items():
        medians = [median(stages[stage]) for stage in STAGES]
        whole = sum(medians)
        table.add(
            name,
            f"{whole:.0f}",
            *(f"{each:.0f}" for each in medians),
            *(f"{100 * each / whole:.0f}" for each in medians),
        )
    return table


def _live_table(live: dict[str, list[float]]) -> Table:
    table = Table(f"stages: {_LIVE}, CPU", ["what", "µs each"])
    table.rows = [[name, spread(took, 0)] for name, took in live.items()]
    return table
