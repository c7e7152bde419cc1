"""The state machine: what each state makes of requests and bytes."""

from dataclasses import replace

import pytest

from lidario.errors import LocalProtocolError
from lidario.families.rplidar import commands
from lidario.families.rplidar.commands import Conf, get_lidar_conf
from lidario.families.rplidar.formats import DenseFormat, ExpressFormat
from lidario.families.rplidar.simulated.packers import pack_dense
from lidario.families.ydlidar import commands as other
from lidario.families.ydlidar.formats import PointCloud
from lidario.families.ydlidar.simulated.packers import SCAN_HEADER, pack_points, pack_response
from lidario.wire.envelope import Request
from lidario.wire.events import Descriptor, Event, Packets, Response
from lidario.wire.link import Link, LinkState
from tests.support.streams import CASES, arrived, open_stream

INFO = bytes(range(20))
INFO_ANSWER = pack_response(0x04, INFO)
HEALTH_ANSWER = pack_response(0x06, b"\0\0\0")
DENSE = bytes.fromhex("A55A5400004085")
PACKETS = [pack_dense(300 * n, [[100 * n + k for k in range(40)]]) for n in range(12)]


def waiting(request: Request = commands.GET_INFO) -> Link:
    link = Link()
    link.send_request(request)
    assert link.data_to_send() == request.data
    assert link.state is LinkState.AWAIT_RESPONSE
    return link


def streaming() -> Link:
    link = waiting(commands.express_scan(1, DenseFormat()))
    link.receive_data(DENSE, 0)
    assert link.events_received() == [Descriptor(0x85, 84, continuous=True)]
    assert link.state is LinkState.STREAMING
    return link


def receive(link: Link, data: bytes, now: int = 0, size: int | None = None) -> list[Event]:
    for at in range(0, len(data), size or len(data) or 1):
        link.receive_data(data[at : at + (size or len(data))], now)
    return link.events_received()


# --------------------------------------------------------------------------------------------------- at rest


def test_nothing_is_sent_and_nothing_known_at_first() -> None:
    link = Link()
    assert (link.state, link.buffered, link.data_to_send(), link.events_received()) == (LinkState.IDLE, 0, b"", [])


def test_bytes_nobody_asked_for_are_stray() -> None:
    link = Link()
    assert receive(link, INFO_ANSWER + b"noise") == []
    assert (link.stats.stray_bytes, link.stats.bytes_received, link.buffered) == (32, 32, 0)
    assert link.state is LinkState.IDLE


def test_what_is_queued_is_handed_out_once_and_in_order() -> None:
    link = Link()
    link.send_request(commands.motor_speed(600))
    link.send_request(commands.GET_INFO)
    assert link.data_to_send() == commands.motor_speed(600).data + commands.GET_INFO.data
    assert link.data_to_send() == b""


def test_a_request_without_an_answer_changes_nothing() -> None:
    link = Link()
    link.send_request(commands.motor_speed(600))
    assert link.state is LinkState.IDLE


# --------------------------------------------------------------------------------------------------- answers


@pytest.mark.parametrize("size", [None, 1, 2, 5])
def test_an_answer_however_it_is_chopped(size: int | None) -> None:
    link = waiting()
    assert receive(link, INFO_ANSWER, 77, size) == [Response(0x04, INFO, 77)]
    assert (link.state, link.buffered, link.stats.stray_bytes) == (LinkState.IDLE, 0, 0)


def test_an_answer_arrives_when_its_last_byte_does() -> None:
    link = waiting()
    assert receive(link, INFO_ANSWER[:-1], 5) == []
    assert receive(link, INFO_ANSWER[-1:], 6) == [Response(0x04, INFO, 6)]


@pytest.mark.parametrize("size", [None, 1, 3])
@pytest.mark.parametrize(
    "noise",
    [
        b"\xa5",
        b"\xa5\x5a",
        b"\xa5\xa5",
        b"\xa5\x5a\xa5",
        b"boot banner\r\n",
        HEALTH_ANSWER,
        bytes.fromhex("A55A1400004004"),
        bytes.fromhex("A55A1400008004"),
        bytes.fromhex("A55A1300000004"),
        bytes.fromhex("A55AFFFFFF3F04"),
        DENSE,
        PACKETS[0] + PACKETS[1][:50],
        bytes(300),
    ],
    ids=range(13),
)
def test_noise_before_the_answer_is_counted_and_hides_nothing(noise: bytes, size: int | None) -> None:
    link = waiting()
    assert receive(link, noise + INFO_ANSWER, 0, size) == [Response(0x04, INFO, 0)]
    assert link.stats.stray_bytes == len(noise)
    assert link.stats.bytes_received == len(noise + INFO_ANSWER)


def test_a_claimed_size_too_large_is_never_waited_for() -> None:
    link = waiting(get_lidar_conf(Conf.MODE_NAME, 0))
    for claim in ("A55A45000000 20", "A55AFFFFFF3F20", "A55A0300000020"):
        receive(link, bytes.fromhex(claim) + bytes(100))
        assert link.buffered == 0
    value = Conf.MODE_NAME.to_bytes(4, "little") + b"n" * 64
    assert receive(link, pack_response(0x20, value)) == [Response(0x20, value, 0)]


@pytest.mark.parametrize("size", [None, 1, 7])
def test_a_late_answer_to_another_question_is_dropped_and_counted(size: int | None) -> None:
    link = waiting(get_lidar_conf(Conf.SAMPLE_DURATION, 1))
    late = pack_response(0x20, Conf.MODE_NAME.to_bytes(4, "little") + b"DenseBoost\0")
    wanted = Conf.SAMPLE_DURATION.to_bytes(4, "little") + b"\0\x1f\0\0"
    assert receive(link, late + pack_response(0x20, wanted), 9, size) == [Response(0x20, wanted, 9)]
    assert (link.stats.late_responses, link.stats.stray_bytes) == (1, len(late))


def test_an_answer_inside_a_late_one_is_found() -> None:
    """What looked like an answer was noise; the real one began in its middle."""
    link = waiting(get_lidar_conf(Conf.MODE_COUNT))
    wanted = Conf.MODE_COUNT.to_bytes(4, "little") + b"\x02\0"
    false = bytes.fromhex("A55A1400000020") + b"xyz"
    assert receive(link, false + pack_response(0x20, wanted) + bytes(20)) == [Response(0x20, wanted, 0)]
    assert link.stats.late_responses == 1


def test_what_comes_behind_an_answer_is_stray() -> None:
    link = waiting()
    assert receive(link, INFO_ANSWER + INFO_ANSWER) == [Response(0x04, INFO, 0)]
    assert (link.stats.stray_bytes, link.buffered) == (len(INFO_ANSWER), 0)


def test_giving_up() -> None:
    link = waiting()
    receive(link, INFO_ANSWER[:10])
    assert link.buffered == 10
    link.forget()
    assert (link.state, link.buffered, link.stats.stray_bytes) == (LinkState.IDLE, 0, 10)
    assert receive(link, INFO_ANSWER[10:]) == []
    assert link.stats.stray_bytes == len(INFO_ANSWER)
    link.send_request(commands.GET_HEALTH)
    assert receive(link, HEALTH_ANSWER) == [Response(0x06, b"\0\0\0", 0)]


def test_giving_up_is_nothing_in_other_states() -> None:
    link = streaming()
    receive(link, PACKETS[0][:50])
    link.forget()
    assert (link.state, link.buffered) == (LinkState.STREAMING, 50)
    idle = Link()
    idle.forget()
    assert idle.state is LinkState.IDLE


def test_a_response_collected_from_several_reads_has_its_own_arrival() -> None:
    link = waiting()
    link.receive_data(INFO_ANSWER[:5], 1)
    link.receive_data(INFO_ANSWER[5:] + b"xyz", 9, [(3, 4), (len(INFO_ANSWER) - 5, 5), (len(INFO_ANSWER) - 4, 6)])
    assert link.events_received() == [Response(0x04, INFO, 5)]


def test_whether_a_response_is_pending() -> None:
    link, seen = Link(), list[bool]()
    for action in ("nothing", "request", "abandon", "forget"):
        if action == "request":
            link.send_request(commands.GET_INFO)
        elif action != "nothing":
            getattr(link, action)()
        seen.append(link.is_awaiting)
    assert seen == [False, True, True, False]
    assert not streaming().is_awaiting


@pytest.mark.parametrize("size", [None, 1, 5])
def test_the_response_to_an_abandoned_request_is_dropped_and_counted(size: int | None) -> None:
    link = waiting()
    receive(link, INFO_ANSWER[:9])
    link.abandon()
    assert link.state is LinkState.AWAIT_RESPONSE
    with pytest.raises(LocalProtocolError, match="while a response is pending"):
        link.send_request(commands.GET_HEALTH)
    assert receive(link, INFO_ANSWER[9:], 0, size) == []
    assert (link.state, link.buffered) == (LinkState.IDLE, 0)
    assert (link.stats.late_responses, link.stats.response_bytes, link.stats.stray_bytes) == (1, 27, 0)
    # Only that one request was abandoned.
    link.send_request(commands.GET_HEALTH)
    assert receive(link, HEALTH_ANSWER) == [Response(0x06, b"\0\0\0", 0)]


@pytest.mark.parametrize("size", [None, 1, 50])
def test_the_stream_of_an_abandoned_start_is_drained(size: int | None) -> None:
    link = waiting(commands.express_scan(1, DenseFormat()))
    link.abandon()
    assert receive(link, b"\0" + DENSE + b"".join(PACKETS), 0, size) == []
    assert link.state is LinkState.DRAINING
    stats = link.stats
    assert (stats.late_responses, stats.response_bytes, stats.stray_bytes) == (1, 7, 1)
    assert (stats.drained_bytes, stats.packets, link.buffered) == (12 * 84, 0, 0)
    link.drained()
    link.send_request(commands.express_scan(1, DenseFormat()))
    assert receive(link, DENSE)[0] == Descriptor(0x85, 84, continuous=True)


def test_stop_ends_what_was_abandoned() -> None:
    link = waiting()
    link.abandon()
    link.send_request(commands.STOP)
    assert (link.state, link.is_awaiting) == (LinkState.DRAINING, False)
    link.drained()
    link.send_request(commands.GET_INFO)
    assert receive(link, INFO_ANSWER) == [Response(0x04, INFO, 0)]


def test_abandoning_is_nothing_in_other_states() -> None:
    link = streaming()
    link.abandon()
    assert receive(link, PACKETS[0]) == [arrived(PACKETS[0], 1, 0)]
    idle = Link()
    idle.abandon()
    idle.send_request(commands.GET_INFO)
    assert receive(idle, INFO_ANSWER) == [Response(0x04, INFO, 0)]


# --------------------------------------------------------------------------------------------------- streams


@pytest.mark.parametrize("size", [None, 1, 50, 1000])
def test_a_stream_begins_right_behind_its_descriptor(size: int | None) -> None:
    link = waiting(commands.express_scan(1, DenseFormat()))
    events = receive(link, b"\0\xa5" + DENSE + b"".join(PACKETS), 4, size)
    assert events[0] == Descriptor(0x85, 84, continuous=True)
    assert all(isinstance(event, Packets) for event in events[1:])
    assert b"".join(event.data for event in events if isinstance(event, Packets)) == b"".join(PACKETS)
    assert (link.stats.packets, link.stats.stray_bytes, link.stats.skipped_bytes) == (12, 2, 0)


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
    assert events == [
        arrived(PACKETS[0], 1, 0),
        replace(arrived(b"".join(PACKETS[1:]), 11, 0), skipped=27),
    ]
    assert (link.stats.skipped_bytes, link.stats.skipped_stretches) == (27, 1)


def test_one_stretch_of_noise_is_one_event_however_long() -> None:
    link = streaming()
    assert receive(link, PACKETS[0]) == [arrived(PACKETS[0], 1, 0)]
    for _ in range(50):
        assert receive(link, bytes(100)) == []
    assert receive(link, PACKETS[1] + PACKETS[2]) == [
        replace(arrived(PACKETS[1] + PACKETS[2], 2, 0), skipped=5000),
    ]
    assert link.stats.skipped_stretches == 1


def test_packets_bear_the_arrival_of_their_last_byte() -> None:
    link = streaming()
    assert receive(link, PACKETS[0] + PACKETS[1][:40], 10) == [arrived(PACKETS[0], 1, 10)]
    assert receive(link, PACKETS[1][40:], 20) == [arrived(PACKETS[1], 1, 20)]


def test_stop_ends_the_stream_and_throws_away_what_is_left() -> None:
    link = streaming()
    receive(link, PACKETS[0] + PACKETS[1][:40])
    link.send_request(commands.STOP)
    assert (link.state, link.data_to_send()) == (LinkState.DRAINING, commands.STOP.data)
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


def test_drained_ends_draining_alone() -> None:
    link = Link()
    link.send_request(commands.STOP)
    link.drained()
    assert link.state is LinkState.IDLE
    stream = streaming()
    stream.drained()
    assert stream.state is LinkState.STREAMING
    pending = waiting()
    pending.drained()
    assert pending.state is LinkState.AWAIT_RESPONSE


def test_stop_is_legal_in_every_state_and_ends_waiting() -> None:
    for link in (Link(), waiting(), streaming()):
        link.send_request(commands.STOP)
        link.send_request(commands.STOP)
        assert link.state is LinkState.DRAINING
    link.drained()
    link.send_request(commands.GET_INFO)
    assert receive(link, INFO_ANSWER) == [Response(0x04, INFO, 0)]


def test_a_question_may_follow_stop_at_once() -> None:
    """It is the caller who knows how long to wait."""
    link = streaming()
    link.send_request(commands.STOP)
    link.send_request(commands.GET_INFO)
    assert link.state is LinkState.AWAIT_RESPONSE
    assert receive(link, PACKETS[0][:60] + INFO_ANSWER) == [Response(0x04, INFO, 0)]


# --------------------------------------------------------------------------------------------------- misuse


def test_two_questions_at_once_are_misuse() -> None:
    link = waiting()
    with pytest.raises(LocalProtocolError, match="GET_HEALTH may not be sent while a response is pending"):
        link.send_request(commands.GET_HEALTH)
    with pytest.raises(LocalProtocolError, match="MOTOR_SPEED_CTRL"):
        link.send_request(commands.motor_speed(0))
    # Nothing of them leaves, and the first question still stands.
    assert link.data_to_send() == b""
    assert receive(link, INFO_ANSWER) == [Response(0x04, INFO, 0)]


def test_a_question_in_mid_stream_is_misuse() -> None:
    link = streaming()
    for request in (commands.GET_HEALTH, commands.motor_speed(0), commands.express_scan(1, DenseFormat())):
        with pytest.raises(LocalProtocolError, match="while packets flow"):
            link.send_request(request)
    assert (link.state, link.data_to_send()) == (LinkState.STREAMING, b"")
    assert receive(link, PACKETS[0]) == [arrived(PACKETS[0], 1, 0)]


def test_a_keepalive_may_be_sent_in_mid_stream() -> None:
    link = waiting(other.scan(PointCloud()))
    packet = pack_points(range(1, 41), 100, 500)
    receive(link, SCAN_HEADER + packet)
    link.send_request(other.KEEPALIVE)
    assert link.data_to_send() == other.KEEPALIVE.data
    assert link.state is LinkState.STREAMING
    # Its answer, where there is one, is no noise.
    assert receive(link, SCAN_HEADER + packet) == [arrived(packet, 1, 0)]
    assert (link.stats.records, link.stats.skipped_bytes) == (1, 0)


def test_a_large_chunk_is_taken_in_slices() -> None:
    link = streaming()
    data = b"".join(PACKETS) * 100
    assert len(data) > 3 * 32 * 1024
    events = receive(link, memoryview(data).tobytes())
    assert b"".join(event.data for event in events if isinstance(event, Packets)) == data
    assert link.buffered == 0
    assert link.stats.packets == 1200


def test_a_request_that_only_sets_a_control_line_is_followed_by_a_quiet_line() -> None:
    """It has no bytes, as what ends a stream that nobody asked for; but this device was told something."""
    link = open_stream(CASES[0])
    link.send_request(Request("motor off", b"", ends_stream=True, dtr=True))
    assert link.state is LinkState.DRAINING
    assert link.data_to_send() == b""
