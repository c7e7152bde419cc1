"""Times of packets that carry the device's clock: as even as that clock, whatever delays the bytes.

Packets of an LD19 are made here at known times, by the simulated device's packer, and delivered late at random.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest

from lidario.basics.model import ScanMode
from lidario.families.base import Stream
from lidario.families.ldrobot import BEAM
from lidario.families.ldrobot.simulated import pack_points
from lidario.recording.stored_times import StoredTimes
from lidario.revolution.device_clock import DeviceClock
from lidario.wire.events import Packets
from lidario.wire.link import Link

MS = 1_000_000
RATE = 4500
PACKET_NS = 12e9 / RATE
TURNS = 10
"""A second."""
WIRE_NS = 2_000_000
"""What every packet takes until it comes, if nothing delays it."""


def stream(*, timed: bool = True) -> Stream:
    wire = BEAM.wire()
    mode = ScanMode(0, "Standard", 1e6 / RATE, 12.0, wire.response_type, typical=True)
    return Stream(wire, BEAM.decoder(), mode, 1e9 / RATE, 1.0, 0.3, timed=timed)


def made(seconds: float, *, begin_ms: float = 29_000.0, fast: float = 1.0) -> tuple[bytes, np.ndarray]:
    """Packets back to back, and when the last sample of each was measured, in nanoseconds of our clock."""
    count = int(seconds * RATE / 12)
    times = np.arange(count * 12) / RATE
    angle = (times * TURNS % 1 * 36_000).astype(int).reshape(-1, 12)
    stamps = (begin_ms + times[::12] * 1e3 * fast).astype(int) % 30_000
    data = pack_points(
        np.full((count, 12), 1000), np.full((count, 12), 200), angle[:, 0], angle[:, -1], milliseconds=stamps
    )
    return data, times[11::12] * 1e9


def received(data: bytes, reads: Sequence[tuple[int, int]]) -> list[Packets]:
    """What a link makes of reads: up to which packet, and when."""
    link, begin, found = Link(), 0, list[Packets]()
    link.enter_stream(stream().format)
    for end, at_ns in reads:
        link.receive_data(data[begin * 47 : end * 47], at_ns)
        begin = end
        found += [event for event in link.events_received() if isinstance(event, Packets)]
    return found


def late_reads(times: np.ndarray, seed: int, latest_ms: float, every: int = 7) -> list[tuple[int, int]]:
    """Reads of `every` packets, each as late as chance has it; what is read next never comes before that."""
    late, reads, last = (
        np.random.default_rng(seed).uniform(0, latest_ms * MS, len(times)),
        list[tuple[int, int]](),
        0,
    )
    for end in range(every, len(times) + 1, every):
        last = max(last, round(times[end - 1] + WIRE_NS + late[end]))
        reads.append((end, last))
    return reads


def errors_ms(events: Sequence[Packets], times: np.ndarray) -> list[float]:
    """How much later than at once the last packet of each read is said to have come."""
    clock, place, found = DeviceClock(stream()), 0, list[float]()
    for event in events:
        for count, at_ns in clock.dated(event).arrivals:
            found.append((at_ns - times[place + count - 1] - WIRE_NS) / MS)
        place += event.count
    return found


@pytest.mark.parametrize("latest_ms", [4.0, 16.0, 40.0])
@pytest.mark.exhaustive("seed", sample=range(1), full=range(3))
def test_times_are_even_though_bytes_come_late(seed: int, latest_ms: float) -> None:
    data, times = made(15.0)
    found = errors_ms(received(data, late_reads(times, seed, latest_ms)), times)[300:]
    # A millisecond is what the device's clock tells. Above that, a sixth of what the line makes of it is left.
    assert max(found) - min(found) < 1.0 + latest_ms / 6


@pytest.mark.parametrize(("gone", "came"), [(2, 1), (5, 3), (300, 2)])
def test_the_first_packets_behind_an_outage_are_not_dated_by_those_before_it(gone: int, came: int) -> None:
    """Those are still more, and would tell a time that is earlier by the outage."""
    data, times = made(5.0)
    kept, before = np.delete(np.arange(len(times)), slice(903, 903 + gone)), [*range(7, 903, 7), 903]
    rows, times = np.frombuffer(data, np.uint8).reshape(-1, 47)[kept].tobytes(), times[kept]
    ends = [*before, *range(903 + came, len(times), 7)]
    found = errors_ms(received(rows, [(end, round(times[end - 1] + WIRE_NS)) for end in ends]), times)
    assert max(map(abs, found[len(before) // 2 :])) < 0.5


@pytest.mark.long
@pytest.mark.parametrize("fast", [0.99, 1.0001, 1.01])
def test_a_clock_that_goes_otherwise_than_ours_is_followed(fast: float) -> None:
    data, times = made(30.0, fast=fast)
    found = errors_ms(received(data, late_reads(times, 1, 16.0)), times)
    # Two clocks that are a hundredth apart are 300 ms apart at the end.
    assert max(found[300:]) < 5.0
    assert min(found) > -12.0


@pytest.mark.long
def test_no_packet_comes_before_it_was_read_nor_before_the_one_before() -> None:
    data, times = made(20.0)
    reads = late_reads(times, 5, 30.0)
    clock, last = DeviceClock(stream()), 0
    for event, (_, at_ns) in zip(received(data, reads), reads, strict=True):
        ((_, told_ns),) = clock.dated(event).arrivals
        assert last <= told_ns <= at_ns
        last = told_ns


@pytest.mark.long
def test_a_packet_that_passes_its_check_by_chance_says_nothing() -> None:
    data, times = made(20.0)
    rows = bytearray(data)
    for at in range(300, len(times), 50):
        rows[at * 47 : at * 47 + 47] = pack_points([1000] * 12, [9] * 12, 77, 99, milliseconds=at * 997 % 30_000)
    found = errors_ms(received(bytes(rows), late_reads(times, 2, 16.0)), times)
    assert max(found[500:]) < 17.0  # as late as it was read, where the false one is the last
    assert min(found) > -1.0
    assert np.median(found[500:]) < 2.0


@pytest.mark.long
def test_where_decoding_began_makes_no_difference() -> None:
    """Neither before a restart nor behind it, as soon as twenty seconds have passed."""
    data, times = made(30.0, fast=1.0001)
    again, later = made(30.0, begin_ms=3.0, fast=1.0001)
    events = received(data + again, late_reads(np.concatenate((times, later + 30.4e9)), 3, 16.0))
    clock = DeviceClock(stream())
    whole = [clock.dated(event) for event in events]
    for begin in (300, 1000, 1700):
        part = DeviceClock(stream())
        found = [part.dated(event) for event in events[begin:]]
        behind = 21 * RATE // 12 // 7
        assert len(found) > behind + 300
        assert found[behind:] == whole[begin + behind :]


@pytest.mark.parametrize("begin_ms", [0.0, 4_000.0, 6_500.0, 7_500.0, 8_700.0, 20_000.0])
def test_a_clock_that_began_anew_is_another_one_wherever_it_begins(begin_ms: float) -> None:
    """That of the device said 9 s when it was restarted: what came then may seem as late as reads can be."""
    data, times = made(4.0, begin_ms=5_000.0)
    again, later = made(2.0, begin_ms=begin_ms)
    times = np.concatenate((times, later + 4.3e9))
    found = errors_ms(received(data + again, late_reads(times, 3, 16.0)), times)
    assert max(found) < 17.0
    assert min(found) > -12.0


def stored(data: bytes, size: int) -> list[int]:
    """When the packets of a file came that is read in pieces of so many bytes."""
    times, link, at_ns = StoredTimes(stream(timed=False)), Link(), list[int]()
    link.enter_stream(stream().format)
    for begin in range(0, len(data), size):
        link.receive_data(data[begin : begin + size], 0)
        at_ns += [
            at
            for event in link.events_received()
            if isinstance(event, Packets)
            for _, at in times.dated(event).arrivals
        ]
    assert at_ns == sorted(at_ns)
    return at_ns


@pytest.mark.parametrize("size", [1024, 65536])
def test_in_a_file_a_clock_that_began_anew_tells_of_no_outage(size: int) -> None:
    """As of a device that was restarted; to take it for one that went on would tell of 25 seconds."""
    at_ns = stored(made(4.0, begin_ms=5_000.0)[0] + made(2.0, begin_ms=300.0)[0], size)
    assert at_ns[-1] == pytest.approx(6e9, abs=5 * MS)


def test_where_most_stamps_contradict_the_sample_time_that_counts() -> None:
    data, times = made(1.0, fast=2.5)
    link = Link()
    link.enter_stream(stream().format)
    link.receive_data(data, 0)
    (event,) = [each for each in link.events_received() if isinstance(each, Packets)]
    assert StoredTimes(stream(timed=False)).dated(event).received_ns == pytest.approx(times[-1], abs=MS)
