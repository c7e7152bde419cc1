"""Packets with intact check values and any contents: decoders see nothing else, and must make scans of all of it.

Promised: nothing raises; a scan's arrays have one length, angles in [0, 360) and in [-pi, pi], distances from 0 on.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from lidario.families.rplidar.simulated import packers
from lidario.revolution.assemble import Assembler
from lidario.scans.scan import Scan
from tests.fuzz.checks import check_scan
from tests.reference import ydlidar
from tests.support.cases import KINDS, Case
from tests.support.contents import point_cloud
from tests.support.streams import in_one_run, stream_of

_MOST = 400  # packets
_STEPS_NS = (0, 1, 1_000_000, 20_000_000, 900_000_000)


def decode_packets(data: bytes) -> None:
    """Make packets of the bytes, and scans of the packets."""
    head, rest = (data[:3] + bytes(3))[:3], data[3:]
    case = KINDS[head[0] % len(KINDS)]
    packets = packets_of(case, rest)
    if packets:
        make_scans(case, packets, 1 + head[1] % 64, head[2])


def make_scans(case: Case, packets: Sequence[bytes], run: int, times: int) -> None:
    """Make scans of packets, `run` of which come together; `times` decides when."""
    wire, now = case.make_format(), 0
    # A sample that takes no time is what some firmware claims.
    assembler = Assembler(stream_of(case, sample_ns=0.0 if times & 0x80 else case.sample_us * 1e3), 115_200)
    scans: list[Scan] = []
    for at in range(0, len(packets), run):
        now += _STEPS_NS[(times + packets[at][-1]) % len(_STEPS_NS)]
        scans += assembler.add(in_one_run(wire, b"".join(packets[at : at + run]), now))
    scans += assembler.end()
    stats = assembler.stats
    assert stats.scans == len(scans)
    assert stats.scan_packets + stats.discarded_packets + stats.doubled_packets + stats.false_packets == len(
        packets
    )
    assert stats.unfinished_packets == 0
    assert stats.lost_packets >= 0
    for scan in scans:
        check_scan(scan)


def packet_seeds() -> list[bytes]:
    """A revolution and a half of each format, in the order of the formats."""
    return [bytes((number, 7, 2)) + b"".join(case.packets[:60]) for number, case in enumerate(KINDS)]


def packets_of(case: Case, data: bytes) -> list[bytes]:
    """Packets that the format takes for its own, with these bytes as contents."""
    wire = case.make_format()
    # A node has no check value but the angle: what is not taken for a packet never comes to the decoder.
    return [each for each in _packets(case, data) if wire.measure(bytearray(each), 0) == len(each)]


def _packets(case: Case, data: bytes) -> list[bytes]:
    if isinstance(case.layout, ydlidar.Kind):
        return _points(case.layout, data)[:_MOST]
    if case.response_type == 0x83:
        return _hq(data)
    size = len(case.packets[0])
    return [case.seal(case, data[at : at + size].ljust(size, b"\0")) for at in range(0, len(data), size)][:_MOST]


def _points(layout: ydlidar.Kind, data: bytes) -> list[bytes]:
    """Point packets: the first six bytes are angles, the number of samples and the mark, the rest samples."""
    found, at = [], 0
    while at + 6 <= len(data):
        first, last, count, control = data[at : at + 6][0:2], data[at + 2 : at + 4], data[at + 4], data[at + 5]
        count = 1 + count % 80
        size = layout.sample_bytes * count
        raw = data[at + 6 : at + 6 + size].ljust(size, b"\0")
        begin, end = (int.from_bytes(each, "little") & 0x7FFF for each in (first, last))
        found.append(point_cloud(layout, begin, end, raw, control=control, marked=bool(control & 1)))
        at += 6 + size
    return found


def _hq(data: bytes) -> list[bytes]:
    """HQ packets: each eight bytes are a node."""
    nodes = np.frombuffer(data[: len(data) // 8 * 8], "<u2").reshape(-1, 4).astype(np.int64)
    if not len(nodes):
        return []
    nodes = np.resize(nodes, (-(-len(nodes) // 96) * 96, 4)).reshape(-1, 96, 4)[:_MOST]
    angles, low, high, flags = (nodes[..., column] for column in range(4))
    raw = packers.pack_hq(angles, low | (high & 0xFF) << 16, flags & 0xFF, flags >> 8)
    return [raw[at : at + 781] for at in range(0, len(raw), 781)]
