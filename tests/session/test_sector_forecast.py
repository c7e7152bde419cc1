"""Sectors are handed over within `latency` and a millisecond, and the port is polled about once for each.

The poller of a terminal, as `Reader` does it, over golden streams whose packets come at the device's own pace; its
timers are late by up to a millisecond.
"""

import random
from itertools import accumulate

import numpy as np
import pytest

from lidario.revolution.sectors import SectorAssembler
from lidario.session.streaming.forecast import Forecast
from lidario.wire.blocks import Block
from tests.support.cases import KINDS, Case, named
from tests.support.samples import one_a_parser
from tests.support.streams import in_one_run, stream_of

LATENCY_S, TIMER_S = 0.005, 0.001


@pytest.mark.long
@one_a_parser(KINDS)
def test_a_sector_is_handed_over_in_time(case: Case) -> None:
    chance = random.Random(case.name)
    stream = stream_of(case)
    ends = [end * case.byte_ns * 1e-9 for end in accumulate(map(len, case.packets))]
    published: list[int] = []
    assembler = SectorAssembler(stream)
    assembler.divide((8,), lambda _, sector: published.append(sector.index))
    forecast = Forecast(stream, 0, LATENCY_S)
    taken = polls = 0
    now, delays = 0.0, list[float]()
    while taken < len(ends):
        pause = forecast.due - now if forecast.due > now else LATENCY_S - TIMER_S
        now += min(pause, 0.7 * forecast.buffer_s) + chance.uniform(0.0, TIMER_S)
        polls += 1
        come = next((number for number in range(taken, len(ends)) if ends[number] > now), len(ends))
        if come == taken or forecast.due - now > 1e-5:
            continue
        for packet in range(taken, come):
            before = len(published)
            scans = assembler.add(in_one_run(stream.format, case.packets[packet], round(ends[packet] * 1e9)))
            for scan in scans:
                forecast.turned(scan, 0, now)
            if len(published) > before:
                delays.append(now - ends[packet])
        forecast.expect(assembler.next_ns)
        taken = come
    assert len(delays) >= 20
    assert np.percentile(delays[4:], 99) < LATENCY_S + 0.001


EXACT = [case for case in KINDS if case.name.startswith(("rplidar", "ydlidar")) and "_81" not in case.name]
"""Those of whose packets it is known when each ends; but for nodes, of which there are too many."""


@pytest.mark.parametrize("case", EXACT, ids=named)
def test_it_is_known_to_the_sample_when_the_last_sector_of_a_revolution_is_complete(case: Case) -> None:
    """Each packet comes when its last sample was measured."""
    stream = stream_of(case)
    published: list[int] = []
    assembler = SectorAssembler(stream)
    assembler.divide((8,), lambda _, sector: published.append(sector.index))
    measured, expected, off = 0, list[float](), list[float]()
    for packet in case.packets:
        measured += stream.format.samples_in([Block(len(packet), 1)])
        came_ns, before = round(measured * case.sample_us * 1e3), len(published)
        assembler.add(in_one_run(stream.format, packet, came_ns))
        if published[before:]:
            if published[-1] == 7:
                off += [(each - came_ns) / (case.sample_us * 1e3) for each in expected]
            expected = []
        if not np.isnan(assembler.next_ns):
            expected.append(assembler.next_ns)
    assert len(off) > 5
    assert np.abs(off).max() <= 1.01
