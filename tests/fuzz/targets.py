"""The targets, by name, and the bytes that they begin with."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass

from lidario.basics.source import parse_source
from lidario.errors import ConnectFailed
from lidario.families.registry import check_source
from lidario.families.rplidar import commands as rplidar
from lidario.sim.faults import parse_faults
from lidario.wire.envelope import Request
from lidario.wire.events import Packets
from lidario.wire.link import Link
from lidario.wire.states import LinkState
from tests.fuzz.device import SEEDS as DEVICE_SEEDS
from tests.fuzz.device import hostile_device
from tests.fuzz.forged import ATTACKS
from tests.fuzz.packets import decode_packets, packet_seeds
from tests.fuzz.recordings import forged_recording, open_recording, recording_seeds
from tests.support.cases import KINDS, Case
from tests.support.ledger import assert_link_closes

_BUFFER = 32 * 1024
_SOURCES = (
    "auto",
    "/dev/ttyUSB0",
    "COM3",
    "serial:///dev/ttyUSB0?baud=1000000&family=rplidar",
    "id:00112233445566778899AABBCCDDEEFF",
    "tcp://[::1]:2000",
    "socket://host:20108?baud=115200",
    "sim://rplidar-s2?world=room&fault=drop:1%,unplug:5s&seed=7&via=memory",
    "sim://ydlidar-4ros?serial=0123456789012345",
    "tcp://\x00:0",
    "serial:///dev/%00",
    "http://[",
)


@dataclass(frozen=True, slots=True)
class Target:
    """One door.

    Attributes:
        run: Takes any bytes; raises where a promise is broken.
        seeds: Bytes to begin with.
        most: Most bytes that make sense.
    """

    run: Callable[[bytes], None]
    seeds: Sequence[bytes]
    most: int = 4096


QUESTION = rplidar.get_lidar_conf(rplidar.Conf.MODE_NAME, 1)
STATES: dict[str, Callable[[Link, Case], None]] = {
    "idle": lambda link, case: None,
    "draining": lambda link, case: link.send_request(rplidar.STOP),
    "waiting for info": lambda link, case: link.send_request(rplidar.GET_INFO),
    "waiting for a value": lambda link, case: link.send_request(QUESTION),
    "waiting for a stream": lambda link, case: link.send_request(_start(case)),
    "an abandoned question": lambda link, case: _left(link, rplidar.GET_INFO, link.abandon),
    "an abandoned start": lambda link, case: _left(link, _start(case), link.abandon),
    "forgotten": lambda link, case: _left(link, rplidar.GET_INFO, link.forget),
}


def _start(case: Case) -> Request:
    return case.request(case.make_format())


def _left(link: Link, request: Request, leave: Callable[[], None]) -> None:
    link.send_request(request)
    leave()


def link(data: bytes) -> None:
    """Bytes from the line, in any state of the parser and in any chunks.

    Promised: nothing raises; every byte is counted once; what is kept is bounded; a STOP ends everything, but for a
    response that is still owed.
    """
    case, state, chunk, rest = _headed(data)
    parser = Link()
    STATES[sorted(STATES)[state % len(STATES)]](parser, case)
    size = 1 + chunk
    for at in range(0, len(rest), size):
        parser.receive_data(rest[at : at + size], at)
        assert parser.buffered <= _BUFFER
        assert_link_closes(parser)
        for event in parser.events_received():
            if isinstance(event, Packets):
                assert len(event.data) >= event.count > 0
    owed = parser.state is LinkState.AWAIT_RESPONSE
    parser.send_request(rplidar.STOP)
    assert parser.state is (LinkState.AWAIT_RESPONSE if owed else LinkState.DRAINING)
    parser.forget()
    parser.send_request(rplidar.STOP)
    assert (parser.state, parser.buffered) == (LinkState.DRAINING, 0)


def source(data: bytes) -> None:
    """A text that names a device, or faults, from a command line or a file.

    Promised: a `Source`, or `ConnectFailed` with the reason ``source`` whose text a terminal can show.
    """
    text = data.decode("utf-8", "surrogateescape")
    try:
        check_source(parse_source(text))
    except ConnectFailed as error:
        _check(error)
    with suppress(ValueError):
        parse_faults(text)


def _check(error: ConnectFailed) -> None:
    shown = str(error).replace("\n", "")
    assert error.reason == "source"
    assert shown.isprintable(), ascii(shown)
    assert len(shown) < 2000


def _headed(data: bytes) -> tuple[Case, int, int, bytes]:
    head, rest = (data[:3] + bytes(3))[:3], data[3:]
    return KINDS[head[0] % len(KINDS)], head[1], head[2], rest


def _link_seeds() -> list[bytes]:
    states = sorted(STATES)
    started = states.index("waiting for a stream")
    seeds = [
        bytes((number, started, 63)) + case.descriptor + b"".join(case.packets[:4])
        for number, case in enumerate(KINDS)
    ]
    info = b"\xa5\x5a\x14\0\0\0\x04" + bytes(20)
    return [*seeds, *(bytes((0, state, 7)) + info for state in range(len(states)))]


TARGETS = {
    "link": Target(link, _link_seeds()),
    "decoders": Target(decode_packets, packet_seeds()),
    "source": Target(source, [text.encode("utf-8", "surrogateescape") for text in _SOURCES], most=300),
    "recordings": Target(open_recording, recording_seeds(), most=32 * 1024),
    "forged": Target(forged_recording, [bytes((number, 0, 0, 0)) for number in range(len(ATTACKS))], most=64),
    "device": Target(hostile_device, DEVICE_SEEDS, most=2048),
}
"""Every target by its name."""
