"""Raw messages to scans without a session, and what becomes of messages that are missing, late or bad."""

from __future__ import annotations

import random
import time
from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import pytest

import lidario
from lidario.families.registry import family_named
from lidario.families.ydlidar.simulated.device import Simulated4Ros
from lidario.network import raw
from lidario.network.bus import Sample
from lidario.network.device import RemoteStreams
from lidario.network.keys import Attachment
from lidario.network.messages import MOST_RAW_BYTES, Entry, encode_raw_message, parse_raw_message
from lidario.network.raw import RawDecoder
from lidario.network.senders import RIVAL_S, OneSender, Senders
from lidario.network.status import Status
from lidario.port.wall_clock import WallClock
from lidario.recording.about import About
from lidario.recording.chronicle import MOST_NS, Responded, StreamBegan, StreamEnded, ZeroOffsetSet, text_of
from lidario.revolution.together import join_reads
from lidario.ros.share import RawFeed
from lidario.scans.scan import Scan
from tests.support.loop import driven, run_driven

MODELS = ("rplidar-s2", "ydlidar-4ros", "ldrobot-ld06")


def added(decoder: RawDecoder, message: bytes) -> list[Scan] | None:
    """The scans that a message completes; None where it is none."""
    taken = decoder.steps(message)
    return None if taken is None else [scan for scans in taken for scan in scans]


class Clock(WallClock):
    """The wall clock of a reader, which is so much ahead of its own clock until a test sets it."""

    def __init__(self, ahead_ns: int) -> None:
        super().__init__(time.monotonic_ns)
        self.ahead_ns = ahead_ns

    @property
    def wall_offset_ns(self) -> int:
        return self.ahead_ns


class Sent:
    """What a publisher of raw bytes sends, and the scans that its own session made of them."""

    def __init__(self, model: str, count: int = 6, chosen: Mapping[int, bool] | None = None) -> None:
        self.messages: list[bytes] = []
        self.scans: list[Scan] = []
        self.status: Status | None = None
        run_driven(lambda: self._run(model, count, chosen or {}))

    async def _run(self, model: str, count: int, chosen: Mapping[int, bool]) -> None:
        simulated = lidario.simulate(model, spin_up=0)
        if isinstance(simulated, Simulated4Ros):
            simulated.zero_offset = 42
        async with lidario.open_lidar(simulated) as lidar:
            feed = RawFeed(lidar, self._send, lambda: None)
            feed.begin()
            async with lidar.scans() as scans:
                async for scan in scans:
                    self.scans.append(scan)
                    about = feed.added_to(About(lidar.info, lidar.health, source=lidar.source))
                    told = Status("raw", "robot", about, (), lidar.mode, 10.0)
                    self.status = Status.of(told.to_bytes(whole=False))
                    if len(self.scans) == count:
                        break
                    if (on := chosen.get(len(self.scans))) is not None:
                        await lidar.set_zero_offset(on)
            feed.end()
            self.offset_ns = round(self.scans[0].wall_stamp_ns - self.scans[0].stamp_ns)

    def _send(self, entries: list[Entry]) -> None:
        self.messages.append(encode_raw_message(entries))

    def decoder(self) -> RawDecoder:
        """One that has heard the status."""
        decoder = RawDecoder(Clock(self.offset_ns))
        assert self.status is not None
        decoder.learn(self.status)
        return decoder


@pytest.fixture(scope="module", params=MODELS)
def sent(request: pytest.FixtureRequest) -> Sent:
    return Sent(request.param)


def test_scans_are_those_of_the_publisher(sent: Sent) -> None:
    decoder = sent.decoder()
    scans = [scan for message in sent.messages for scan in added(decoder, message) or ()]
    assert len(scans) == len(sent.scans)
    for own, other in zip(scans, sent.scans, strict=True):
        np.testing.assert_array_equal(own.device_angles, other.device_angles)
        np.testing.assert_array_equal(own.device_distances, other.device_distances)
        assert (own.seq, own.stamp_ns, own.mode) == (other.seq, other.stamp_ns, other.mode)


@pytest.mark.parametrize("ends", [True, False])
def test_what_is_late_behind_a_silence_comes_when_the_stream_ends_or_the_next_one_begins(ends: bool) -> None:
    sent = Sent("rplidar-s2")
    assert sent.status is not None
    turn_ns, begun_ns = round(60e9 / sent.scans[-1].rpm), sent.scans[2].stamp_ns
    decoder, began, scans, rest = sent.decoder(), sent.status.about.running, list[Scan](), b""
    for entry in [each for message in sent.messages for each in parse_raw_message(message) or ()]:
        if entry.is_event or entry.at_ns <= begun_ns:
            scans += added(decoder, encode_raw_message([entry])) or () if not rest else ()
        elif entry.at_ns < begun_ns + 2.5 * turn_ns:
            rest += entry.data
    late = Entry(False, begun_ns + round(3.7 * turn_ns), rest)
    assert added(decoder, encode_raw_message([late])) == []
    assert began is not None
    told = StreamEnded(0) if ends else replace(began, at=began.at + 1)
    behind = added(decoder, encode_raw_message([Entry(True, late.at_ns, text_of(told).encode())]))
    assert behind
    assert behind[0].stamp_ns > scans[-1].stamp_ns + turn_ns


def test_where_the_clock_of_a_reader_is_set_a_stream_goes_on_and_the_next_one_has_the_new_time(sent: Sent) -> None:
    assert sent.status is not None
    clock = Clock(sent.offset_ns)
    decoder = RawDecoder(clock)
    decoder.learn(sent.status)
    half = len(sent.messages) // 2
    scans = [scan for message in sent.messages[:half] for scan in added(decoder, message) or ()]
    clock.ahead_ns += 10**12
    scans += [scan for message in sent.messages[half:] for scan in added(decoder, message) or ()]
    assert [scan.stamp_ns for scan in scans] == [scan.stamp_ns for scan in sent.scans]
    again = [scan for message in sent.messages for scan in added(decoder, message) or ()]
    assert [scan.stamp_ns for scan in again] == [scan.stamp_ns - 10**12 for scan in sent.scans]
    assert [scan.wall_stamp_ns for scan in again] == [scan.wall_stamp_ns for scan in sent.scans]


@pytest.mark.parametrize("heard", [True, False])
def test_another_zero_offset_in_mid_stream_interrupts_nothing(heard: bool) -> None:
    """A reader has it from the same scan on; one that missed that is told by the next status, and loses nothing."""
    sent = Sent("ydlidar-4ros", 9, {2: True, 5: False})
    decoder, scans = sent.decoder(), list[Scan]()
    for message in sent.messages:
        if heard or b'"zero offset"' not in message:
            scans += added(decoder, message) or ()
        elif sent.status is not None:
            entries = [each for each in parse_raw_message(message) or () if not each.is_event]
            scans += added(decoder, encode_raw_message(entries)) or ()
            decoder.learn(sent.status)
    assert [scan.seq for scan in scans] == [scan.seq for scan in sent.scans]
    assert len({round(float(scan.device_angles[0]), -1) for scan in sent.scans}) == 2
    for own, other in zip(scans[:: 1 if heard else 8], sent.scans[:: 1 if heard else 8], strict=True):
        np.testing.assert_array_equal(own.device_angles, other.device_angles)


def test_a_message_that_is_missing_costs_a_part_of_one_revolution(sent: Sent) -> None:
    decoder = sent.decoder()
    missing = len(sent.messages) // 2
    scans = [
        scan
        for number, message in enumerate(sent.messages)
        if number != missing
        for scan in added(decoder, message) or ()
    ]
    assert decoder.stats.lost_packets
    assert len(scans) + decoder.stats.missed_scans >= len(sent.scans) - 1
    # A device's own clock of milliseconds is followed anew behind the gap.
    begins = np.array([scan.stamp_ns for scan in sent.scans])
    same = [scan for scan in scans if np.abs(begins - scan.stamp_ns).min() < 1e5 and not scan.lost_packets]
    assert len(same) >= len(sent.scans) - 3


def test_until_the_status_is_known_bytes_are_left_out(sent: Sent) -> None:
    """And behind the end of a stream; an unknown family stays unknown."""
    decoder = RawDecoder(Clock(0))
    strange = sent.status
    assert strange is not None
    data = [message for message in sent.messages if b'"began"' not in message]
    assert [added(decoder, message) for message in data] == [[]] * len(data)
    unknown = Status.of(strange.to_bytes(whole=True).replace(strange.about.info.family.encode(), b"nobody"))
    assert unknown is not None
    decoder.learn(unknown)
    assert [added(decoder, message) for message in sent.messages] == [[]] * len(sent.messages)
    decoder = sent.decoder()
    assert added(decoder, encode_raw_message([Entry(True, 0, text_of(StreamEnded(9)).encode())])) == []
    assert [added(decoder, message) for message in data] == [[]] * len(data)
    assert added(decoder, b"LDR1") is None


def test_damaged_messages_raise_nothing(sent: Sent) -> None:
    chance = random.Random(7)
    decoder = sent.decoder()
    for message in sent.messages:
        damaged = bytearray(message)
        for _ in range(chance.randrange(4)):
            damaged[chance.randrange(len(damaged))] = chance.randrange(256)
        for scan in added(decoder, bytes(damaged)) or ():
            assert len(scan)


@pytest.mark.parametrize("at_ns", [MOST_NS - 1, -MOST_NS + 1])
def test_a_time_that_cannot_be_brings_no_scan(sent: Sent, at_ns: int) -> None:
    """Its sums would not fit in the 64 bits of an array."""
    assert sent.status is not None
    (began,) = sent.status.about.events
    assert isinstance(began, StreamBegan)
    far = replace(began, wall_offset_ns=at_ns)
    decoder = sent.decoder()
    decoder.learn(replace(sent.status, about=replace(sent.status.about, events=(far,))))
    for message in sent.messages:
        entries = parse_raw_message(message) or []
        late = [each._replace(at_ns=at_ns) for each in entries if not each.is_event]
        for scan in added(decoder, encode_raw_message(late)) or ():
            assert len(scan.times_ns) == len(scan)


def test_gaps_are_counted_for_each_publisher() -> None:
    senders = Senders()
    one, two = bytes(16), bytes(range(16))
    numbers = [(one, 1, 0), (two, 40, 0), (one, 4, 2), (two, 41, 0), (one, 2, 0), (one, 3, 0)]
    for gid, number, gap in numbers:
        attachment, found = senders.follow(Sample("a", b"", Attachment(number, 0, gid).to_bytes()))
        assert attachment is not None
        assert found == gap
    assert senders.follow(Sample("a", b"", b"")) == (None, 0)


def test_the_publishers_that_were_not_heard_for_longest_are_forgotten(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("lidario.network.senders.MOST", 2)
    senders = Senders()
    for number, key in enumerate(("a", "b", "a", "c", "a", "b")):
        sample = Sample(key, b"", Attachment(10 * number, 0, bytes(16)).to_bytes())
        # Of one that is forgotten no gap is seen.
        assert senders.follow(sample)[1] == {2: 19, 4: 19}.get(number, 0)


def test_the_first_one_is_listened_to_as_long_as_it_sends() -> None:
    one = OneSender(b"", 0.0)
    assert one.follow(b"x", 0.0, lambda: False) == "rival"
    assert not one.is_other(b"a")
    assert one.follow(b"a", 0.0, lambda: True) == "same"
    assert one.follow(b"b", RIVAL_S - 0.1, lambda: True) == "rival"
    assert one.is_other(b"b")
    assert one.follow(b"a", RIVAL_S, lambda: False) == "same"
    assert one.follow(b"b", 2 * RIVAL_S, lambda: False) == "rival"
    assert one.follow(b"b", 2 * RIVAL_S, lambda: True) == "new"
    assert one.follow(b"a", 2 * RIVAL_S, lambda: True) == "rival"


# ------------------------------------------------------------------------------------------------ bounds


def test_a_message_that_is_too_large_is_none(sent: Sent) -> None:
    entry = Entry(False, 1, bytes(MOST_RAW_BYTES - 24))
    assert parse_raw_message(encode_raw_message([entry])) is not None
    assert parse_raw_message(encode_raw_message([entry, Entry(False, 2, bytes(100))])) is None


def test_reads_of_one_message_are_one_piece_with_their_times() -> None:
    assert join_reads([(b"ab", 5)]) == (b"ab", 5, [])
    assert join_reads([(b"ab", 5), (b"", 6), (b"c", 9)]) == (b"abc", 9, [(2, 5), (2, 6)])
    # Time never goes back, neither in a message nor behind the one before.
    assert join_reads([(b"a", 5), (b"b", 3), (b"c", 7)], 4) == (b"abc", 7, [(2, 5)])
    assert join_reads([(b"a", 5), (b"b", 6)], 8) == (b"ab", 8, [])


def test_decoders_are_bounded_by_what_they_hold(sent: Sent, monkeypatch: pytest.MonkeyPatch) -> None:
    """A peer may name itself anew with each message."""
    monkeypatch.setattr(raw, "MOST_DECODER_BYTES", 20 * raw.DECODER_BYTES)
    decoders = raw.Decoders(Clock(sent.offset_ns))
    first = decoders.of("a", bytes(16))
    for number in range(100):
        decoders.of("a", number.to_bytes(16, "big"))
    assert 15 < len(decoders) <= 20
    assert decoders.of("a", bytes(16)) is not first
    # One that holds much counts for as much.
    last = decoders.of("b", bytes(16))
    assert sent.status is not None
    last.learn(sent.status)
    for message in sent.messages[: len(sent.messages) // 2]:
        added(last, message)
    assert last.held > raw.DECODER_BYTES
    count = len(decoders)
    assert decoders.of("b", bytes(16)) is last
    assert len(decoders) <= count


@driven
async def test_what_was_read_at_once_is_sent_in_messages_that_are_taken() -> None:
    """A program that blocked its event loop reads up to a mebibyte."""
    sent: list[bytes] = []
    async with lidario.open_lidar(lidario.simulate("rplidar-s2", spin_up=0)) as lidar:
        feed = RawFeed(lidar, lambda entries: sent.append(encode_raw_message(entries)), lambda: None)
        feed.begin()
        feed.see_chunk("in", bytes(range(256)) * 4096, 7)
        feed.end()
    entries = [parse_raw_message(message) for message in sent]
    assert all(entries)
    joint = b"".join(entry.data for some in entries if some for entry in some if not entry.is_event)
    assert joint == bytes(range(256)) * 4096


@driven
async def test_a_reader_that_comes_later_is_told_the_latest_zero_offset() -> None:
    async with lidario.open_lidar(lidario.simulate("ydlidar-4ros", spin_up=0)) as lidar:
        feed = RawFeed(lidar, lambda _: None, lambda: None)
        feed.begin()
        async with lidar.scans() as scans:
            await anext(scans)
            feed.see_event(text_of(ZeroOffsetSet(1000, 10.5)), 7)
            running = feed.added_to(About(lidar.info)).running
            feed.end()
    assert running is not None
    assert running.zero_offset_deg == 10.5


def test_responses_that_no_device_gives_are_not_remembered(sent: Sent) -> None:
    assert sent.status is not None
    began = next(event for event in sent.status.about.events if isinstance(event, StreamBegan))
    family = family_named(sent.status.about.info.family)
    streams = RemoteStreams(family, sent.status.about, (), began, raw=True)
    for size in (10, 100_000):
        streams.learn(Responded(b"\xa5" * size, 4, b"\1"))
        streams.learn(Responded(bytes((1, size & 0xFF)), 4, bytes(size)))
    assert sorted(len(each.request) + len(each.payload) for each in streams.responses.values()) == [11, 12]
