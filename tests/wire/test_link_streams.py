"""The state machine while packets flow, and how a stream begins and ends."""

import re
import sys
import tracemalloc
from dataclasses import replace
from pathlib import Path
from random import Random
from types import FrameType

import pytest

from lidario.families.rplidar import commands
from lidario.families.rplidar.formats import DenseFormat, ExpressFormat
from lidario.families.scripts import hear
from lidario.session.finding.listening import family_of_stream
from lidario.wire.events import Descriptor, Packets, Response
from lidario.wire.link import Link
from lidario.wire.states import LinkState
from tests.support.cases import CASES, KINDS, Case, named
from tests.support.links import DENSE, INFO, INFO_ANSWER, PACKETS, receive, streaming, waiting
from tests.support.streams import arrived, open_stream


@pytest.mark.parametrize("size", [None, 1, 50, 1000])
def test_a_stream_begins_right_behind_its_descriptor(size: int | None) -> None:
    link = waiting(commands.express_scan(1, DenseFormat()))
    events = receive(link, b"\0\xa5" + DENSE + b"".join(PACKETS), 4, size)
    assert events[0] == Descriptor(0x85, 84, continuous=True)
    assert all(isinstance(event, Packets) for event in events[1:])
    assert b"".join(event.data for event in events if isinstance(event, Packets)) == b"".join(PACKETS)
    assert (link.stats.packets, link.stats.stray_bytes, link.stats.skipped_bytes) == (12, 2, 0)
    assert link.stream_at == 2 + len(DENSE)


@pytest.mark.parametrize("descriptor", ["A55A5400004087", "A55A5500004082", "A55A5400000082", "A55A8400004085"])
def test_the_descriptor_of_an_unknown_stream_is_not_taken(descriptor: str) -> None:
    link = waiting(commands.express_scan(1, DenseFormat()))
    assert receive(link, bytes.fromhex(descriptor) + PACKETS[0]) == []
    assert link.state is LinkState.AWAIT_RESPONSE


def test_the_descriptor_of_another_known_stream_decides_the_format() -> None:
    link = waiting(commands.express_scan(1, ExpressFormat()))
    assert receive(link, DENSE + b"".join(PACKETS))[0] == Descriptor(0x85, 84, continuous=True)
    assert link.state is LinkState.STREAMING
    assert link.stats.packets == len(PACKETS)


def test_while_it_streams_a_descriptor_is_noise() -> None:
    link = streaming()
    events = receive(link, PACKETS[0] + INFO_ANSWER + b"".join(PACKETS[1:]))
    assert events == [arrived(PACKETS[0], 1, 0), replace(arrived(b"".join(PACKETS[1:]), 11, 0), skips=((0, 27),))]
    assert (link.stats.skipped_bytes, link.stats.skipped_stretches) == (27, 1)


def test_one_stretch_of_noise_is_one_event_however_long() -> None:
    link = streaming()
    assert receive(link, PACKETS[0]) == [arrived(PACKETS[0], 1, 0)]
    for _ in range(50):
        assert receive(link, bytes(100)) == []
    assert receive(link, PACKETS[1] + PACKETS[2]) == [
        replace(arrived(PACKETS[1] + PACKETS[2], 2, 0), skips=((0, 5000),))
    ]
    assert link.stats.skipped_stretches == 1


@pytest.mark.parametrize("size", [None, 1, 30])
@pytest.mark.parametrize("case", [case for case in KINDS if not case.descriptor], ids=named)
def test_so_many_packets_are_a_response_and_noise_between_them_is_no_part_of_it(
    case: Case, size: int | None
) -> None:
    """Also where the first one is cut."""
    random, link = Random(case.name), Link()
    link.send_request(hear(case.make_format(), 24))
    raw = b"".join(packet + random.randbytes(len(packet)) for packet in case.packets[:27])[1:]
    (response,) = receive(link, raw, 0, size)
    assert isinstance(response, Response)
    assert response.payload in b"".join(case.packets)
    assert len(case.split(response.payload)) >= 24
    stats = link.stats
    assert (link.state, stats.response_bytes) == (LinkState.IDLE, len(response.payload))
    assert len(raw) == stats.response_bytes + stats.stray_bytes + stats.drained_bytes + link.buffered


def test_stop_ends_the_stream_and_throws_away_what_is_left() -> None:
    link = streaming()
    receive(link, PACKETS[0] + PACKETS[1][:40])
    link.send_request(commands.STOP)
    assert link.state is LinkState.DRAINING
    assert link.stats.drained_bytes == 40
    assert receive(link, PACKETS[1][40:] + PACKETS[2] + INFO_ANSWER) == []
    assert link.stats.drained_bytes == 40 + 44 + 84 + 27
    assert link.buffered == 0


def test_noise_before_stop_is_not_reported_in_the_next_stream() -> None:
    link = streaming()
    receive(link, bytes(500))
    link.send_request(commands.STOP)
    link.drained()
    link.send_request(commands.express_scan(1, DenseFormat()))
    assert receive(link, DENSE + b"".join(PACKETS))[1:] == [arrived(b"".join(PACKETS), 12, 0)]


def test_stop_is_legal_in_every_state() -> None:
    for link in (Link(), waiting(), streaming()):
        link.send_request(commands.STOP)
        link.send_request(commands.STOP)
        link.forget()
        assert link.state in (LinkState.DRAINING, LinkState.IDLE)
    link.drained()
    assert link.state is LinkState.IDLE
    link.send_request(commands.GET_INFO)
    assert receive(link, INFO_ANSWER) == [Response(INFO)]


def test_a_question_may_follow_stop_at_once() -> None:
    """It is the caller who knows how long to wait."""
    link = streaming()
    link.send_request(commands.STOP)
    link.send_request(commands.GET_INFO)
    assert link.state is LinkState.AWAIT_RESPONSE
    assert receive(link, PACKETS[0][:60] + INFO_ANSWER) == [Response(INFO)]


def reported(case: Case, raw: bytearray, ends: list[int], together: int) -> list[tuple[int, Packets]]:
    """The packets of reads that end there, one each nanosecond, of which so many are fed as one; and when."""
    link, begin, found = open_stream(case), 0, list[tuple[int, Packets]]()
    for first in range(0, len(ends), together):
        *before, (size, now) = [(end - begin, at) for at, end in enumerate(ends)][first : first + together]
        link.receive_data(raw[begin : begin + size], now, before)
        begin += size
        found += [(now, event) for event in link.events_received() if isinstance(event, Packets)]
    return found


@pytest.mark.exhaustive("case", sample=KINDS)
def test_of_joined_reads_it_is_told_which_packets_only_a_later_read_has_shown(case: Case) -> None:
    """Behind damage the bytes that follow decide whether something is a packet."""
    for seed in range(20):
        random, raw = Random(seed), bytearray(b"".join(case.packets[:30])[:3000])
        for _ in range(4):
            at = random.randrange(len(raw))
            raw[at : at + random.randrange(60)] = random.randbytes(random.randrange(60))
        ends = [*sorted(random.sample(range(1, len(raw)), 30)), len(raw)]
        shown = [now for now, event in reported(case, raw, ends, 1) for _ in range(event.count)]
        number = 0
        for _, event in reported(case, raw, ends, 3):
            later = bool(event.skipped) and event.arrivals[0][1] < shown[number]
            assert event.apart == later, (seed, number)
            number += event.count


@pytest.mark.long
@pytest.mark.parametrize("case", CASES, ids=lambda case: case.name)
def test_who_keeps_the_frames_of_the_parsers_ends_no_stream(case: Case) -> None:
    """As a profiler does, or a hook that keeps a failed finalizer's traceback: they hold views of the buffer."""
    link, kept = open_stream(case), list[FrameType]()
    before = sys.getprofile()
    sys.setprofile(lambda frame, *_: kept.append(frame))
    try:
        for begin in range(0, 4000, 700):
            link.receive_data(case.raw[begin : begin + 700], begin)
            heard = bytearray(case.raw[: begin + 700])
            family_of_stream(heard)
            heard += b"more"
    finally:
        sys.setprofile(before)
    assert link.stats.packets
    assert kept


def test_its_buffer_holds_no_more_than_the_table_of_bounds_says(monkeypatch: pytest.MonkeyPatch) -> None:
    page = (Path(__file__).parents[2] / "docs" / "bounds.md").read_text(encoding="utf-8")
    (kibibytes,) = re.findall(r"\(`Link`\) \| [^|]+ \| (\d+) KiB", page)
    link, most = streaming(), 0
    # What a mistake in a format would do: nothing is ever understood.
    monkeypatch.setattr(DenseFormat, "next_stretch", lambda _, data, at: ((), at, at))
    with pytest.raises(OverflowError, match="1024 bytes do not fit"):
        while most <= int(kibibytes) * 1024:
            receive(link, bytes(1024))
            most = link.buffered
    assert most == int(kibibytes) * 1024
    link.stats.bytes_received -= 1024  # those that did not fit


def test_of_reads_that_are_understood_no_times_are_kept() -> None:
    """However many come, each of two that were joined, and none behind damage."""
    link, packet = streaming(), PACKETS[0]
    tracemalloc.start()
    try:
        for now in range(1000):
            link.receive_data(packet + packet, 2 * now + 1, [(len(packet), 2 * now)])
            link.events_received()
        kept, _ = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert kept < 50_000
