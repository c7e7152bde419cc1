"""The state machine: what each state makes of requests and bytes. Streams are in `test_link_streams`."""

from collections.abc import Callable

import pytest

from lidario.errors import LocalProtocolError
from lidario.families.rplidar import commands
from lidario.families.rplidar.commands import Conf, get_lidar_conf
from lidario.families.rplidar.formats import DenseFormat
from lidario.families.ydlidar import commands as other
from lidario.families.ydlidar.formats import PointCloud
from lidario.families.ydlidar.simulated.packers import SCAN_HEADER, pack_points, pack_response
from lidario.wire.envelope import Request
from lidario.wire.events import Descriptor, Response
from lidario.wire.link import Link
from lidario.wire.states import LinkState
from tests.support.cases import CASES
from tests.support.links import DENSE, HEALTH_ANSWER, INFO, INFO_ANSWER, PACKETS, receive, streaming, waiting
from tests.support.streams import arrived, open_stream


def test_at_first_nothing_is_known_and_what_comes_is_stray() -> None:
    link = Link()
    assert (link.state, link.buffered, link.events_received()) == (LinkState.IDLE, 0, [])
    # A request without a response changes nothing.
    link.send_request(commands.motor_speed(600))
    assert receive(link, INFO_ANSWER + b"noise") == []
    assert (link.stats.stray_bytes, link.stats.bytes_received, link.buffered) == (32, 32, 0)
    assert link.state is LinkState.IDLE


@pytest.mark.parametrize("size", [None, 1, 2, 5])
def test_an_answer_however_it_is_chopped_and_what_comes_behind_it_is_stray(size: int | None) -> None:
    link = waiting()
    assert receive(link, INFO_ANSWER, 0, size) == [Response(INFO)]
    assert (link.state, link.buffered, link.stats.stray_bytes) == (LinkState.IDLE, 0, 0)
    assert receive(link, INFO_ANSWER, 0, size) == []
    assert (link.stats.stray_bytes, link.buffered) == (len(INFO_ANSWER), 0)
    assert receive(waiting(), INFO_ANSWER + INFO_ANSWER) == [Response(INFO)]


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
def test_noise_before_the_answer_is_counted_and_hides_nothing(noise: bytes) -> None:
    for size in (None, 1, 3):
        link = waiting()
        assert receive(link, noise + INFO_ANSWER, 0, size) == [Response(INFO)], size
        assert link.stats.stray_bytes == len(noise)
        assert link.stats.bytes_received == len(noise + INFO_ANSWER)


def test_a_claimed_size_too_large_is_never_waited_for() -> None:
    link = waiting(get_lidar_conf(Conf.MODE_NAME, 0))
    for claim in ("A55A0401000020", "A55AFFFFFF3F20", "A55A0300000020"):
        receive(link, bytes.fromhex(claim) + bytes(100))
        assert link.buffered == 0
    value = Conf.MODE_NAME.to_bytes(4, "little") + b"n" * 255
    assert receive(link, pack_response(0x20, value)) == [Response(value)]


@pytest.mark.parametrize("size", [None, 1, 7])
def test_a_late_answer_to_another_question_is_dropped_and_counted(size: int | None) -> None:
    link = waiting(get_lidar_conf(Conf.SAMPLE_DURATION, 1))
    late = pack_response(0x20, Conf.MODE_NAME.to_bytes(4, "little") + b"DenseBoost\0")
    wanted = Conf.SAMPLE_DURATION.to_bytes(4, "little") + b"\0\x1f\0\0"
    assert receive(link, late + pack_response(0x20, wanted), 0, size) == [Response(wanted)]
    assert (link.stats.late_responses, link.stats.stray_bytes) == (1, len(late))


def test_an_answer_inside_a_late_one_is_found() -> None:
    """What looked like an answer was noise; the real one began in its middle."""
    link = waiting(get_lidar_conf(Conf.MODE_COUNT))
    wanted = Conf.MODE_COUNT.to_bytes(4, "little") + b"\x02\0"
    false = bytes.fromhex("A55A1400000020") + b"xyz"
    assert receive(link, false + pack_response(0x20, wanted) + bytes(20)) == [Response(wanted)]
    assert link.stats.late_responses == 1


def test_giving_up() -> None:
    link = waiting()
    receive(link, INFO_ANSWER[:10])
    assert link.buffered == 10
    link.forget()
    assert (link.state, link.buffered, link.stats.stray_bytes) == (LinkState.IDLE, 0, 10)
    assert receive(link, INFO_ANSWER[10:]) == []
    assert link.stats.stray_bytes == len(INFO_ANSWER)
    link.send_request(commands.GET_HEALTH)
    assert receive(link, HEALTH_ANSWER) == [Response(b"\0\0\0")]


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
    assert receive(link, HEALTH_ANSWER) == [Response(b"\0\0\0")]


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


def test_behind_a_stop_a_response_is_still_outstanding() -> None:
    """The device is busy with it, and may not have heard the stop."""
    link = waiting()
    link.send_request(commands.STOP)
    assert link.state is LinkState.AWAIT_RESPONSE
    link.drained()
    assert link.state is LinkState.AWAIT_RESPONSE
    assert receive(link, INFO_ANSWER) == []
    assert (link.state, link.stats.late_responses) == (LinkState.IDLE, 1)
    link.send_request(commands.GET_INFO)
    assert receive(link, INFO_ANSWER) == [Response(INFO)]


@pytest.mark.parametrize(
    ("verb", "links"),
    [("forget", [Link, streaming]), ("abandon", [Link, streaming]), ("drained", [Link, streaming, waiting])],
)
def test_what_ends_one_state_is_nothing_in_the_others(verb: str, links: list[Callable[[], Link]]) -> None:
    for make in links:
        link, other = make(), make()
        if make is streaming:
            receive(link, PACKETS[0][:50])
            receive(other, PACKETS[0][:50])
        getattr(link, verb)()
        assert (link.state, link.buffered, link.stats) == (other.state, other.buffered, other.stats)
        if make is Link:
            link.send_request(commands.GET_INFO)
        expected = [arrived(PACKETS[0], 1, 0)] if make is streaming else [Response(INFO)]
        assert receive(link, PACKETS[0][50:] if make is streaming else INFO_ANSWER) == expected


def test_two_questions_at_once_are_misuse() -> None:
    link = waiting()
    with pytest.raises(LocalProtocolError, match="GET_HEALTH may not be sent while a response is pending"):
        link.send_request(commands.GET_HEALTH)
    with pytest.raises(LocalProtocolError, match="MOTOR_SPEED_CTRL"):
        link.send_request(commands.motor_speed(0))
    # The first question still stands.
    assert receive(link, INFO_ANSWER) == [Response(INFO)]


def test_a_question_in_mid_stream_is_misuse() -> None:
    link = streaming()
    for request in (commands.GET_HEALTH, commands.motor_speed(0), commands.express_scan(1, DenseFormat())):
        with pytest.raises(LocalProtocolError, match="while packets flow"):
            link.send_request(request)
    assert link.state is LinkState.STREAMING
    assert receive(link, PACKETS[0]) == [arrived(PACKETS[0], 1, 0)]


def test_a_keepalive_may_be_sent_in_mid_stream() -> None:
    link = waiting(other.scan(PointCloud()))
    packet = pack_points(range(1, 41), 100, 500)
    receive(link, SCAN_HEADER + packet)
    link.send_request(other.KEEPALIVE)
    assert link.state is LinkState.STREAMING
    # Its answer, where there is one, is no noise.
    assert receive(link, SCAN_HEADER + packet) == [arrived(packet, 1, 0)]
    assert (link.stats.records, link.stats.skipped_bytes) == (1, 0)


def test_a_request_that_only_sets_a_control_line_is_followed_by_a_quiet_line() -> None:
    """It has no bytes, as what ends a stream that nobody asked for; but this device was told something."""
    link = open_stream(CASES[0])
    link.send_request(Request("motor off", b"", ends_stream=True, dtr=True))
    assert link.state is LinkState.DRAINING
