"""Streams of 0x85 packets whose samples are numbered.

Every sample has its own distance, so that none can be lost, doubled or swapped unseen.
"""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from lidario.families.rplidar.simulated import packers
from lidario.revolution.assemble import Assembler, AssemblerStats
from lidario.scans.scan import Scan
from tests.support.cases import CASES
from tests.support.streams import arrived, stream_of

DENSE = next(case for case in CASES if case.name == "rplidar_32k_85")
SAMPLE_NS = 31_250
TURN = 23040
BAUD = 1_000_000
WIRE_NS = 84 * 10_000
Arrival = Callable[[int], float]


def numbered(count: int, arc: float, first: int = 0) -> list[bytes]:
    """Dense packets of `arc` 1/64 degrees each; the n-th sample measures n + 1 millimetres."""
    starts = np.rint(first + arc * np.arange(count)).astype(np.int64) % TURN
    millimetres = np.arange(count * 40).reshape(-1, 40) % 65535 + 1
    raw = packers.pack_dense(starts, millimetres)
    return [raw[at : at + 84] for at in range(0, len(raw), 84)]


def on_time(number: int) -> float:
    """When the n-th packet arrives on a line without delays, the first sample being measured at 0."""
    return ((number + 1) * 40 - 1 + 1.5) * SAMPLE_NS + WIRE_NS


def assemble(
    packets: Sequence[bytes],
    arrival: Arrival = on_time,
    *,
    run: int = 1,
    baudrate: int = BAUD,
    stats: AssemblerStats | None = None,
    wall: int = 0,
    **about: Any,
) -> list[Scan]:
    """The scans of these packets, `run` of which arrive together."""
    about.setdefault("sample_ns", float(SAMPLE_NS))
    assembler = Assembler(stream_of(DENSE, **about), baudrate, wall, stats)
    scans: list[Scan] = []
    for at in range(0, len(packets), run):
        part = packets[at : at + run]
        scans += assembler.add(arrived(b"".join(part), len(part), round(arrival(at + len(part) - 1))))
    return scans


def numbers(scans: Sequence[Scan]) -> list[int]:
    """The numbers of the samples of all scans."""
    return [round(float(mm)) for scan in scans for mm in scan.device_distances]
