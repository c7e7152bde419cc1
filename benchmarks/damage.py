"""What damage costs: of streams of all seven formats, damaged in nine ways, what is kept, wrong, and told.

Nothing here is timed; the same command prints the same figures. The stream of a simulated device is damaged, every
byte arrives when it would have arrived anyway, and the scans are compared with those of the undamaged stream.

A point is *kept* when the undamaged revolution at the same time has one at the same angle (within 0.06 degrees) and
distance (within 1 mm), *wrong* when it has none. A sample that came without a distance is neither.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict, dataclass
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.report import Result, Setting, Table
from benchmarks.streams import KINDS, Kind, capture
from lidario.revolution.assemble import Assembler, AssemblerStats
from lidario.scans.scan import Scan
from lidario.wire.blocks import packet_offsets
from lidario.wire.envelope import DESCRIPTOR_SIZE
from lidario.wire.events import Packets
from lidario.wire.link import Link

_SECONDS = 6.0
_CHUNK = 512
_ANGLE_DEG, _DISTANCE_MM = 0.06, 1.0

Bytes = NDArray[np.uint8]
Places = NDArray[np.int64]
Damaged = tuple[Bytes, Places]
"""The bytes that arrive, and where in the undamaged stream each of them stood: that is when it arrives."""


@dataclass(frozen=True, slots=True)
class Outcome:
    """What became of one damaged stream.

    Attributes:
        samples: Samples with a distance in the undamaged scans.
        kept: Of these, delivered as they are.
        wrong: Points delivered that the undamaged stream does not have.
        missing: Packets of the undamaged stream that did not get through.
        told: Packets counted as lost.
        missing_scans: Revolutions of the undamaged stream that were not delivered.
        told_scans: Revolutions counted as missed.
    """

    samples: int
    kept: int
    wrong: int
    missing: int
    told: int
    missing_scans: int
    told_scans: int


def _flips(raw: Bytes, _: Places, random: np.random.Generator) -> Damaged:
    damaged = raw.copy()
    hit = random.random(len(raw)) < 1e-3
    damaged[hit] ^= (1 << random.integers(0, 8, int(hit.sum()))).astype(np.uint8)
    return damaged, np.arange(len(raw))


def _lost_bytes(raw: Bytes, _: Places, random: np.random.Generator) -> Damaged:
    left = np.flatnonzero(random.random(len(raw)) >= 1e-4)
    return raw[left], left


def _added_bytes(raw: Bytes, _: Places, random: np.random.Generator) -> Damaged:
    before = np.flatnonzero(random.random(len(raw)) < 1e-4)
    more = random.integers(0, 256, len(before), np.uint8)
    return np.insert(raw, before, more), np.insert(np.arange(len(raw)), before, before)


def _bursts(raw: Bytes, _: Places, random: np.random.Generator) -> Damaged:
    damaged = raw.copy()
    for begin in random.integers(0, len(raw) - 200, len(raw) // 20_000).tolist():
        damaged[begin : begin + 200] = random.integers(0, 256, 200, np.uint8)
    return damaged, np.arange(len(raw))


def _three_packets(raw: Bytes, offsets: Places, random: np.random.Generator) -> Damaged:
    gone = np.zeros(len(raw), np.bool_)
    for first in random.integers(0, len(offsets) - 4, 20).tolist():
        gone[offsets[first] : offsets[first + 3]] = True
    left = np.flatnonzero(~gone)
    return raw[left], left


def _outage(seconds: float) -> Callable[[Bytes, Places, np.random.Generator], Damaged]:
    def outage(raw: Bytes, offsets: Places, random: np.random.Generator) -> Damaged:
        del offsets
        size = round(len(raw) * seconds / _SECONDS)
        begin = round(len(raw) * random.uniform(0.3, 0.6))
        left = np.concatenate((np.arange(begin), np.arange(begin + size, len(raw))))
        return raw[left], left

    return outage


DAMAGES: dict[str, Callable[[Bytes, Places, np.random.Generator], Damaged]] = {
    "1 flip in 1000 bytes": _flips,
    "1 byte in 10000 lost": _lost_bytes,
    "1 byte in 10000 added": _added_bytes,
    "200 bytes in 20000 overwritten": _bursts,
    "20 times three packets lost": _three_packets,
    "an outage of 0.3 s": _outage(0.3),
    "an outage of 0.8 s": _outage(0.8),
}
"""Ways to damage a stream: from its bytes and where packets begin to what arrives, and where it stood."""


def _each_second_packet(raw: Bytes, offsets: Places, random: np.random.Generator) -> Damaged:
    del random
    kept = np.zeros(len(raw), np.bool_)
    for begin, end in zip(offsets[:-1:2].tolist(), offsets[1::2].tolist(), strict=False):
        kept[begin:end] = True
    left = np.flatnonzero(kept)
    return raw[left], left


def _most_packets(raw: Bytes, _: Places, random: np.random.Generator) -> Damaged:
    left = np.flatnonzero(random.random(len(raw)) >= 2e-2)
    return raw[left], left


SCARCE: dict[str, Callable[[Bytes, Places, np.random.Generator], Damaged]] = {
    "each second packet lost": _each_second_packet,
    "2 bytes in 100 lost": _most_packets,
}
"""Ways after which most packets are missing from the beginning on, so that the step of the angle is never seen."""


def run(setting: Setting) -> Result:
    """Every kind of damage to every format."""
    tables, data, rows = list[Table](), dict[str, dict[str, list[int]]](), list[dict[str, Any]]()
    for damage in (*DAMAGES, *SCARCE):
        setting.say(damage)
        table = Table(
            f"Damage: {damage}", ["", "kept", "wrong", "packets missing, told", "revolutions missing, told"]
        )
        for name, kind in KINDS.items():
            if not setting.selects(name, damage):
                continue
            found = outcome(kind, damage, seed=1)
            rows.append({"format": name, "case": damage, **asdict(found)})
            data.setdefault(damage, {})[name] = [getattr(found, field) for field in Outcome.__slots__]
            table.add(
                name,
                f"{100 * found.kept / found.samples:.1f} %",
                f"{100 * found.wrong / found.samples:.3f} %" if found.wrong else "0",
                f"{found.missing}, {found.told}",
                f"{found.missing_scans}, {found.told_scans}",
            )
        if table.rows:
            tables.append(table)
    return Result("damage", tables, data, rows)


def outcome(kind: Kind, damage: str, seed: int) -> Outcome:
    """What becomes of a stream of one kind."""
    raw = np.frombuffer(capture(kind, _SECONDS), np.uint8)[DESCRIPTOR_SIZE:]
    clean, packets, offsets = _undamaged(kind)
    damaged, places = (DAMAGES | SCARCE)[damage](raw, offsets, np.random.default_rng(seed))
    scans, stats, got, _ = received(kind, damaged, places)
    kept = wrong = 0
    stamps = np.array([scan.stamp_ns for scan in clean])
    for scan in scans:
        # A revolution of which the beginning was lost begins later.
        at = max(0, int(np.searchsorted(stamps, scan.stamp_ns + 10_000_000)) - 1)
        right, others = _compared(scan, clean[at])
        kept += right
        wrong += others
    return Outcome(
        samples=sum(int(np.count_nonzero(scan.device_distances)) for scan in clean),
        kept=kept,
        wrong=wrong,
        missing=packets - got,
        told=stats.lost_packets,
        missing_scans=len(clean) - len(scans),
        told_scans=stats.missed_scans,
    )


@cache
def _undamaged(kind: Kind) -> tuple[list[Scan], int, Places]:
    raw = np.frombuffer(capture(kind, _SECONDS), np.uint8)[DESCRIPTOR_SIZE:]
    scans, _, packets, offsets = received(kind, raw, np.arange(len(raw)))
    return scans, packets, offsets


def received(kind: Kind, data: Bytes, places: Places) -> tuple[list[Scan], AssemblerStats, int, Places]:
    """Scans, counters, how many packets there were, and where they stood if they lie back to back."""
    link, stream, byte_ns = Link(), kind.stream(), _SECONDS * 1e9 / max(1, int(places[-1]))
    link.send_request(kind.request(stream.format))
    link.receive_data(capture(kind, _SECONDS)[:DESCRIPTOR_SIZE], 0)
    link.events_received()
    assembler, scans, offsets = Assembler(stream), list[Scan](), [0]
    # No read lasts longer than a chunk takes: what comes behind an outage is a read of its own.
    cuts = np.flatnonzero(np.diff(places // _CHUNK)) + 1
    for begin, end in zip([0, *cuts.tolist()], [*cuts.tolist(), len(data)], strict=True):
        link.receive_data(data[begin:end].tobytes(), round(int(places[end - 1]) * byte_ns))
        for event in link.events_received():
            if isinstance(event, Packets):
                scans += assembler.add(event)
                offsets += [offsets[-1] + each for each in packet_offsets(event.blocks)[1:]]
    assembler.end()
    return scans, assembler.stats, link.stats.packets, np.array(offsets)


def _compared(scan: Scan, clean: Scan) -> tuple[int, int]:
    """How many samples of `scan` are samples of `clean`, and how many are not."""
    there = scan.device_distances > 0
    angle, distance = scan.device_angles[there], scan.device_distances[there]
    order = np.argsort(clean.device_angles, kind="stable")
    angles, distances = clean.device_angles[order], clean.device_distances[order]
    found = np.zeros(len(angle), np.bool_)
    nearest = np.searchsorted(angles, angle)
    for off in range(-3, 3):
        other = (nearest + off) % len(angles)
        apart = np.abs((angles[other] - angle + 180) % 360 - 180)
        found |= (apart <= _ANGLE_DEG) & (np.abs(distances[other] - distance) <= _DISTANCE_MM)
    right = int(np.count_nonzero(found))
    return right, len(found) - right
