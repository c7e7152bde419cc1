"""Revolutions of a 4ROS that a test makes itself, packet by packet, and what becomes of them."""

from collections.abc import Sequence
from itertools import accumulate, pairwise

import numpy as np

from lidario.families.ydlidar.formats import PointCloud
from lidario.families.ydlidar.simulated.packers import pack_points
from lidario.revolution.assemble import Assembler, AssemblerStats
from lidario.scans.scan import Scan
from tests.support.cases import CASES
from tests.support.streams import in_one_run, stream_of

_CASE = next(case for case in CASES if case.name == "ydlidar_4ros_room7")
SAMPLE_NS = 250_000
"""With 480 samples, 8.3 revolutions a second."""


def turn_of(counts: Sequence[int], ratio: float = 1.0) -> list[bytes]:
    """The packets of a revolution, by how many samples they hold; the last step is so many times the first one."""
    steps = np.geomspace(1.0, ratio, sum(counts))
    angles = np.rint(np.concatenate(((0.0,), np.cumsum(steps)[:-1])) * 23040 / steps.sum()).astype(int).tolist()
    bounds = [0, *accumulate(counts)]
    return [
        pack_points([1000] * (end - at), angles[at], angles[end - 1], control=int(not at))
        for at, end in pairwise(bounds)
    ]


def damaged(packet: bytes, off_q6: tuple[int, int]) -> bytes:
    """A packet whose two angles are wrong by so many 1/64 degrees, with a check value that is right."""
    first, last = (int.from_bytes(packet[at : at + 2], "little") >> 1 for at in (4, 6))
    return pack_points([1000] * packet[3], (first + off_q6[0]) % 23040, (last + off_q6[1]) % 23040)


def scans_of(
    turns: Sequence[Sequence[bytes]], missing: Sequence[tuple[int, int]] = ()
) -> tuple[list[Scan], AssemblerStats]:
    """The scans of these revolutions, whose packets come when they were measured.

    `missing` are those that do not come: number of the revolution, and of the packet in it.
    """
    assembler = Assembler(stream_of(_CASE, sample_ns=SAMPLE_NS))
    scans: list[Scan] = []
    measured = 0
    for number, turn in enumerate(turns):
        for at, packet in enumerate(turn):
            measured += packet[3]
            if (number, at) not in missing:
                scans += assembler.add(in_one_run(PointCloud(), packet, measured * SAMPLE_NS))
    return scans, assembler.stats
