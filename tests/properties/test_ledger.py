"""Every received byte is counted in exactly one place, whatever comes and whatever is requested in between."""

from collections.abc import Callable

import pytest
from hypothesis import given
from hypothesis import strategies as st

from lidario.errors import LocalProtocolError
from lidario.families.rplidar import commands as rplidar
from lidario.families.ydlidar import commands as ydlidar
from lidario.wire.link import Link
from tests.support.cases import KINDS, Case, named
from tests.support.harm import LURES, messes
from tests.support.ledger import assert_link_closes
from tests.support.samples import one_a_parser

INFO = b"\xa5\x5a\x14\0\0\0\x04" + bytes(20)
HEALTH = b"\xa5\x5a\x03\0\0\0\x06\0\0\0"
VALUE = b"\xa5\x5a\x08\0\0\0\x20\x75\0\0\0\x01\0\0\0"

ACTIONS: dict[str, Callable[[Link, Case], None]] = {
    "info": lambda link, case: link.send_request(rplidar.GET_INFO),
    "health": lambda link, case: link.send_request(ydlidar.GET_HEALTH),
    "value": lambda link, case: link.send_request(rplidar.get_lidar_conf(rplidar.Conf.RESPONSE_TYPE, 1)),
    "start": lambda link, case: link.send_request(case.request(case.make_format())),
    "keepalive": lambda link, case: link.send_request(ydlidar.KEEPALIVE),
    "stop": lambda link, case: link.send_request(rplidar.STOP),
    "abandon": lambda link, case: link.abandon(),
    "forget": lambda link, case: link.forget(),
    "drained": lambda link, case: link.drained(),
}


@one_a_parser(KINDS)
@given(st.data())
def test_every_byte_is_counted_once(case: Case, data: st.DataObject) -> None:
    link = Link()
    responses = st.sampled_from([case.descriptor, INFO, HEALTH, VALUE, *LURES])
    clean = st.integers(1, 30).map(lambda count: case.descriptor + b"".join(case.packets[:count]))
    pieces = st.one_of(responses, clean, messes(case), st.binary(max_size=200))
    steps = data.draw(st.lists(st.one_of(st.sampled_from(sorted(ACTIONS)), pieces), max_size=25), "steps")
    # Without these, few examples would get into the states in which most is counted.
    beginnings: list[list[str | bytes]] = [[], ["start", case.descriptor], ["start", "abandon"], ["info"]]
    for step in [*data.draw(st.sampled_from(beginnings), "beginning"), *steps]:
        if isinstance(step, str):
            try:
                ACTIONS[step](link, case)
            except LocalProtocolError:
                continue
            assert_link_closes(link)
        else:
            chunk = data.draw(st.integers(1, 1000), "chunk")
            for at in range(0, len(step), chunk):
                link.receive_data(step[at : at + chunk], 0)
                assert_link_closes(link)


@pytest.mark.parametrize("case", KINDS, ids=named)
def test_each_kind_of_bytes_has_its_place(case: Case) -> None:
    link, packets = Link(), b"".join(case.packets[:60])
    for step in (INFO, "info", INFO, HEALTH, "start", case.descriptor, packets, b"\0" * 7, packets, "stop", HEALTH):
        if isinstance(step, str):
            ACTIONS[step](link, case)
        else:
            link.receive_data(step, 0)
        assert_link_closes(link)
    stats = link.stats
    assert stats.stray_bytes == len(INFO) + len(HEALTH)
    assert stats.response_bytes == len(INFO) + len(case.descriptor)
    assert (stats.skipped_bytes, stats.skipped_stretches) == (7, 1)
    assert stats.packet_bytes + stats.drained_bytes == 2 * len(packets) + len(HEALTH)
    assert stats.packet_bytes > 1.5 * len(packets)
