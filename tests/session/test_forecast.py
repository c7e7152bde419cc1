"""When the next turn is whole: predictions from the scans that came, and how long nobody need look."""

import copy
import random
from dataclasses import replace
from itertools import accumulate, pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from lidario.revolution.sectors import SectorAssembler
from lidario.scans.scan import Scan
from lidario.session.streaming.forecast import Forecast
from lidario.wire.blocks import Block
from tests.support.cases import CASES, KINDS, Case, named
from tests.support.samples import one_a_parser
from tests.support.streams import in_one_run, stream_of

BUFFER_BYTES = 4096
"""What a terminal of Linux keeps."""
GUARD_S = 0.002
DENSE = next(case for case in CASES if case.name == "rplidar_32k_85")
PACKET_S = 40 * 31.25e-6
WIRE_S = 840 / 1_000_000
TURN_BYTES = 6720
NOTHING = np.zeros(0, np.float32)
SCAN = Scan(NOTHING, NOTHING, None, 0, 0, 0, 0, 600.0, 0, 0, 0, "DenseBoost")


def forecast(latency: float = 0.005) -> Forecast:
    return Forecast(stream_of(DENSE, sample_ns=31_250.0), 1_000_000, latency)


def turning(
    here: Forecast, *starts: float, size: int = TURN_BYTES, received: int = 0, first_s: float = 0.1
) -> Forecast:
    """After scans that began at these times, each of `size` bytes; the first took `first_s`.

    Each is handed over when it is whole, 5 ms late.
    """
    here.turned(SCAN, received - size, starts[0] - 1)
    for number, (last, start) in enumerate(pairwise((starts[0] - first_s, *starts))):
        period = start - last
        scan = replace(SCAN, stamp_ns=round(start * 1e9), rpm=60 / period)
        here.turned(scan, received + number * size, start + period + 2 * PACKET_S + WIRE_S + 0.005)
    return here


def test_before_the_first_scan_nothing_is_known() -> None:
    assert forecast().due == 0
    # The line is taken to be full.
    assert forecast().buffer_s * 100_000 == pytest.approx(BUFFER_BYTES)
    unknown = forecast()
    unknown.turned(SCAN, TURN_BYTES, 0.1)
    assert unknown.due == 0
    unknown.turned(replace(SCAN, rpm=float("nan")), 2 * TURN_BYTES, 0.2)
    assert unknown.due == 0


@pytest.mark.parametrize("latency", [0.0, 0.005])
@pytest.mark.parametrize("times", [2, 50])
def test_a_device_that_tells_its_rate_wrong_is_not_believed(times: int, latency: float) -> None:
    """It says 600 rpm, and its scans come so many times as often."""
    wrong = forecast(latency)
    for number in range(1, 20):
        wrong.turned(replace(SCAN, stamp_ns=round(number * 1e8 / times)), number * TURN_BYTES, number * 0.1 / times)
        assert wrong.due <= number * 0.1 / times


def test_several_scans_at_once_are_not_several_turns() -> None:
    late = turning(forecast(), 0.0, 0.1, 0.2)
    for number in (3, 4):
        late.turned(replace(SCAN, stamp_ns=number * 10**8), 5 * TURN_BYTES, 0.55)
    assert late.due <= 0.55


def test_a_stamp_that_is_too_late_makes_no_scan_late() -> None:
    """However a scan is dated: a turn after it came, the next is there."""
    odd = turning(forecast(), 0.0, 0.1, 0.2)
    odd.turned(replace(SCAN, stamp_ns=400_000_000), 4 * TURN_BYTES, 0.41)
    assert odd.due == pytest.approx(0.51)


@given(st.floats(0.05, 3.0), st.integers(1, 20), st.floats(0, 1000))
def test_a_steady_rotor_is_predicted(period: float, turns: int, begin: float) -> None:
    starts = [begin + n * period for n in range(turns + 1)]
    for latency, early, packets in ((0.005, 0.0, 1.75), (0.0, 0.002, 1.0)):
        steady = turning(forecast(latency), *starts, first_s=period)
        # The scan that is being measured began one period ago, and its last packet needs another behind it.
        expected = starts[-1] + 2 * period + packets * PACKET_S + WIRE_S - early
        assert steady.due == pytest.approx(expected, abs=1e-6)


def test_one_stamp_that_is_off_hardly_moves_the_prediction() -> None:
    exact = turning(forecast(), 0.0, 0.1, 0.2, 0.3).due
    assert turning(forecast(), 0.0, 0.1, 0.2, 0.302).due - exact == pytest.approx(0.003, abs=2e-4)
    assert turning(forecast(), 0.0, 0.1, 0.202, 0.3).due == pytest.approx(exact, abs=2e-3)


def test_when_the_speed_changes_one_looks_early_rather_than_late() -> None:
    faster = turning(forecast(), 0.0, 0.1, 0.2, 0.29)
    assert faster.due == pytest.approx(0.29 + 2 * 0.09 + 1.75 * PACKET_S + WIRE_S)
    # More than 3 % are no noise.
    hardly = turning(forecast(), 0.0, 0.1, 0.2, 0.296)
    assert hardly.due == pytest.approx(0.296 + 2 * 0.096 + 1.75 * PACKET_S + WIRE_S)
    slower = turning(forecast(), 0.0, 0.1, 0.2, 0.4)
    assert slower.due == pytest.approx(0.4 + 2 * 0.1 + 1.75 * PACKET_S + WIRE_S)
    # From then on the new speed is the one to expect.
    steady = turning(forecast(), 0.0, 0.1, 0.2, 0.4, 0.6, 0.8)
    assert steady.due == pytest.approx(0.8 + 2 * 0.2 + 1.75 * PACKET_S + WIRE_S)


def test_where_every_moment_counts_an_unsteady_rotor_is_looked_after_earlier() -> None:
    calm, wary = turning(forecast(), 0.0, 0.1, 0.2, 0.302), turning(forecast(0.0), 0.0, 0.1, 0.2, 0.302)
    assert calm.due - wary.due == pytest.approx(0.75 * PACKET_S + GUARD_S + 0.002, abs=1e-6)
    # Steadiness forgives.
    steady = turning(forecast(0.0), 0.0, 0.1, 0.2, 0.302, *(0.402 + np.arange(12) * 0.1))
    assert steady.due == pytest.approx(1.502 + 0.2 + PACKET_S + WIRE_S - GUARD_S, abs=3e-4)


def test_each_steady_revolution_halves_how_much_earlier_one_looks() -> None:
    starts = [0.0, 0.1, 0.2, 0.302, 0.402, 0.502]
    earlier = [
        turning(forecast(), *starts[:count]).due
        - turning(forecast(0.0), *starts[:count]).due
        - 0.75 * PACKET_S
        - GUARD_S
        for count in (3, 4, 5, 6)
    ]
    assert earlier == pytest.approx([0.0, 0.002, 0.001, 0.0005], abs=1e-6)


def test_a_sector_counts_as_long_as_it_is_known_when_the_next_one_is_complete() -> None:
    """It is polled for a millisecond later, as an adapter delivers; then the revolution counts again."""
    both = turning(forecast(), 0.0, 0.1, 0.2)
    whole = both.due
    both.expect(0.33e9)
    assert both.due == pytest.approx(0.331)
    both.expect(float("nan"))
    assert both.due == whole > 0.36


def test_where_bytes_take_no_time_a_revolution_is_due_sooner_and_a_socket_holds_more_than_a_terminal() -> None:
    timed, untimed = forecast(), Forecast(stream_of(DENSE, sample_ns=31_250.0), 0, 0.005)
    assert 0.01 < untimed.buffer_s < 0.05
    assert turning(timed, 0.0, 0.1, 0.2).due - turning(untimed, 0.0, 0.1, 0.2).due == pytest.approx(WIRE_S)
    assert untimed.buffer_s >= 2 * timed.buffer_s


def test_what_came_before_the_stream_is_not_counted() -> None:
    fresh = turning(forecast(), 0.0)
    later = Forecast(stream_of(DENSE, sample_ns=31_250.0), 1_000_000, 0.005, 10**9)
    turning(later, 0.0, received=10**9)
    assert later.due == fresh.due > 0.11


@given(st.integers(100, 20_000), st.integers(2, 5))
def test_the_buffer_never_fills_while_a_port_is_unread(size: int, scans: int) -> None:
    """It fills as fast as the bytes of one revolution came."""
    even = turning(forecast(), *(0.1 * at for at in range(scans)), size=size)
    # Nothing is faster than the line.
    bytes_a_second = min(size / 0.1, 100_000)
    assert even.buffer_s == pytest.approx(min(BUFFER_BYTES / bytes_a_second, 0.25))


def test_the_bytes_of_many_revolutions_at_once_do_not_look_like_a_faster_line() -> None:
    late = turning(forecast(), 0.0, 0.1, 0.2)
    late.turned(replace(SCAN, stamp_ns=300_000_000), 23 * TURN_BYTES, 2.2)
    # The next one was among them: no byte came for it.
    late.turned(replace(SCAN, stamp_ns=400_000_000), 23 * TURN_BYTES, 2.4)
    assert late.buffer_s == forecast().buffer_s


LATENCY_S, TIMER_S = 0.005, 0.001


@pytest.mark.long
@one_a_parser(KINDS)
def test_a_sector_is_handed_over_in_time(case: Case) -> None:
    """Within the latency and a millisecond, and the port is polled about once for each.

    The poller of a terminal, as `Reader` does it, over golden streams whose packets come at the device's own pace;
    its timers are late by up to a millisecond.
    """
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


BUSY_S = 0.008


@pytest.mark.parametrize("latency", [0.0, LATENCY_S, 0.02])
def test_scans_whose_bytes_come_at_once_are_not_polled_later_and_later(latency: float) -> None:
    """Such bytes do not tell how late they were read, and the timers of a busy machine are late, never early."""
    chance, period = random.Random(7), 0.1
    wire = copy.copy(stream_of(DENSE).format)
    wire.whole, wire.samples = True, 3200
    scan = replace(SCAN, duration_ns=66_000_000)
    forecast = Forecast(replace(stream_of(DENSE), format=wire), 0, latency)
    now, delays = 0.0, list[float]()
    while len(delays) < 300:
        came = (len(delays) + 1) * period
        pause = max(forecast.due - now, 0.0) or latency - TIMER_S
        # Without a latency it is woken by what comes.
        now = max(now + pause + chance.uniform(0.0, BUSY_S) if pause > 0 else came, now)
        if now >= came:
            delays.append(now - came)
            forecast.turned(replace(scan, stamp_ns=round(came * 1e9) - scan.duration_ns), 0, now)
    assert max(delays[2:]) < latency + BUSY_S


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
