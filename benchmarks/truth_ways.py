"""The ways that bytes take to scans: live as they are read, a revolution at a time, or in sectors; and from a file.

All go through what a program uses: `Link` and `Assembler`, and the offline decoder.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from benchmarks.truth_cases import Line
from benchmarks.truth_streams import TrueStream
from lidario.families.base import Known
from lidario.recording.offline import OfflineDecoder
from lidario.revolution.assemble import AssemblerStats
from lidario.revolution.pipeline import Pipeline
from lidario.scans.scan import Scan
from lidario.scans.sector import Sector

WAYS = ("read", "held", "sectors", "file")
"""Each read parsed by itself; what was read kept until a revolution should be complete; each read by itself while
eighths of revolutions are handed out, too; a file of bytes."""


@dataclass(frozen=True, slots=True)
class Received:
    """What came of a stream.

    Attributes:
        scans: The scans.
        stats: The counters of the assembler.
        packets: How many were found intact.
        sectors: The sectors, where those are handed out.
    """

    scans: list[Scan]
    stats: AssemblerStats
    packets: int
    sectors: list[Sector] = field(default_factory=list)


def receive(stream: TrueStream, line: Line, way: str, seed: int = 1) -> Received:
    """Everything that comes of a line, in one of `WAYS`."""
    if way == "file":
        return _from_file(stream, line)
    reads = list(_reads(line, np.random.default_rng(seed)))
    pipeline = Pipeline(stream.form.stream(), stream.form.baudrate)
    sectors = list[Sector]()
    if way == "sectors":
        pipeline.assembler.divide((8,), lambda _, sector: sectors.append(sector))
    return replace(_live(pipeline, line, reads, _handed_over(stream, reads, way)), sectors=sectors)


def _reads(line: Line, random: np.random.Generator) -> Iterator[tuple[int, int]]:
    """Up to which byte each read reaches, and when it is."""
    now, done, (begin, end) = 0.0, 0, line.blocked_ns
    while done < len(line.data):
        now += random.uniform(*line.pace_s) * 1e9
        if begin <= now < end:
            now = end
        until = int(np.searchsorted(line.at_ns, now, side="right"))
        if until > done:
            yield until, round(now)
            done = until


def _handed_over(stream: TrueStream, reads: list[tuple[int, int]], way: str) -> NDArray[np.int64]:
    """How many reads there were at the end of each piece that is parsed at once."""
    count = np.arange(1, len(reads) + 1)
    if way != "held":
        return count
    # A revolution is complete with the packet behind its last one.
    late_ns = 2 * stream.form.samples * stream.form.sample_ns
    times = np.array([now for _, now in reads])
    due = np.searchsorted(times, [at + late_ns for at in stream.begins_ns.values()]) + 1
    return np.unique(np.append(np.minimum(due, len(reads)), len(reads)))


def _live(pipeline: Pipeline, line: Line, reads: list[tuple[int, int]], ends: NDArray[np.int64]) -> Received:
    scans = list[Scan]()
    first = begin = 0
    for end in ends.tolist():
        piece = reads[first:end]
        until, now = piece[-1]
        arrivals = [(place - begin, at) for place, at in piece[:-1]]
        scans += pipeline.receive(line.data[begin:until].tobytes(), now, arrivals)
        first, begin = end, until
    pipeline.assembler.end()
    return Received(scans, pipeline.stats, pipeline.link.stats.packets)


def _from_file(stream: TrueStream, line: Line) -> Received:
    form = stream.form
    data = form.intro + line.data.tobytes()
    decoder = OfflineDecoder(data, Known(form.kind.family, sample_us=form.kind.mode.sample_us))
    scans = list(decoder)
    return Received(scans, decoder.pipeline.stats, decoder.pipeline.link.stats.packets)
