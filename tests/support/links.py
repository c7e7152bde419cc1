"""Links in the states in which tests need them, and bytes for them."""

from lidario.families.rplidar import commands
from lidario.families.rplidar.formats import DenseFormat
from lidario.families.rplidar.simulated.packers import pack_dense
from lidario.families.ydlidar.simulated.packers import pack_response
from lidario.wire.envelope import Request
from lidario.wire.events import Descriptor, Event
from lidario.wire.link import Link
from lidario.wire.states import LinkState

INFO = bytes(range(20))
INFO_ANSWER = pack_response(0x04, INFO)
HEALTH_ANSWER = pack_response(0x06, b"\0\0\0")
DENSE = bytes.fromhex("A55A5400004085")
PACKETS = [pack_dense(300 * n, [[100 * n + k for k in range(40)]]) for n in range(12)]


def waiting(request: Request = commands.GET_INFO) -> Link:
    link = Link()
    link.send_request(request)
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
