"""No input raises, in any state; whatever the packets say, decoders and assembler make arrays of it."""

from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from lidario.families.rplidar import commands as rplidar
from lidario.families.ydlidar import commands as ydlidar
from lidario.revolution.assemble import Assembler
from lidario.scan import Scan
from lidario.wire.envelope import Request
from lidario.wire.events import Packets
from lidario.wire.link import Link
from lidario.wire.states import LinkState
from tests.support.cases import KINDS, LAYOUTS, Case
from tests.support.contents import any_packets
from tests.support.harm import LURES, messes
from tests.support.samples import one_a_parser
from tests.support.streams import cut_up, feed, in_one_run, stream_of

every_kind = one_a_parser(KINDS)
every_layout = one_a_parser([*KINDS, *LAYOUTS], KINDS)
LIMIT = 32 * 1024

REQUESTS = (rplidar.STOP, rplidar.GET_INFO, rplidar.get_lidar_conf(rplidar.Conf.MODE_NAME, 1), ydlidar.GET_HEALTH)
STATES: dict[str, Callable[[Link, Case], None]] = {
    "idle": lambda link, case: None,
    "draining": lambda link, case: link.send_request(rplidar.STOP),
    "waiting for info": lambda link, case: link.send_request(rplidar.GET_INFO),
    "waiting for a value": lambda link, case: link.send_request(REQUESTS[2]),
    "waiting for a stream": lambda link, case: link.send_request(_start(case)),
    "an abandoned question": lambda link, case: _abandon(link, rplidar.GET_INFO),
    "an abandoned start": lambda link, case: _abandon(link, _start(case)),
    "forgotten": lambda link, case: _forget(link),
}


def _forget(link: Link) -> None:
    link.send_request(rplidar.GET_INFO)
    link.forget()


def _abandon(link: Link, request: Request) -> None:
    link.send_request(request)
    link.abandon()


def _start(case: Case) -> Request:
    return case.request(case.make_format())


@every_kind
@pytest.mark.parametrize("state", STATES)
@settings(max_examples=settings().max_examples // 2)
@given(st.data())
def test_no_bytes_raise_in_any_state(case: Case, state: str, data: st.DataObject) -> None:
    link = Link()
    STATES[state](link, case)
    answers = st.sampled_from([case.descriptor, b"\xa5\x5a\x14\0\0\0\x04", b"\xa5\x5a\x44\0\0\0\x20", *LURES])
    parts = st.lists(st.one_of(st.binary(max_size=200), answers, messes(case)), max_size=6).map(b"".join)
    for chunk in cut_up(data.draw(parts, "bytes"), data.draw(st.integers(1, 3000), "chunk")):
        link.receive_data(chunk, 0)
        assert link.buffered <= LIMIT
        for event in link.events_received():
            if isinstance(event, Packets):
                assert len(event.data) >= event.count > 0
    # Whatever came, STOP is always possible and ends it, but for a response that is still owed.
    owed = link.is_awaiting
    link.send_request(rplidar.STOP)
    assert link.data_to_send().endswith(rplidar.STOP.data)
    assert link.state is (LinkState.AWAIT_RESPONSE if owed else LinkState.DRAINING)
    link.forget()
    link.send_request(rplidar.STOP)
    assert (link.state, link.buffered) == (LinkState.DRAINING, 0)


@every_kind
@given(st.data())
def test_a_mess_becomes_scans_without_a_murmur(case: Case, data: st.DataObject) -> None:
    received = feed(case, data.draw(messes(case), "raw"))
    check(case, [event for event in received.events if isinstance(event, Packets)])


@every_layout
@pytest.mark.parametrize("wild", [False, True], ids=["turning", "wild"])
@given(seed=st.integers(0, 2**32), count=st.integers(1, 150), run=st.integers(1, 60), late=st.integers(0, 10**9))
def test_any_contents_become_scans(case: Case, wild: bool, seed: int, count: int, run: int, late: int) -> None:
    packets = any_packets(case, seed, count, wild=wild)
    wire = case.make_format()
    for packet in packets:
        assert wire.measure(bytearray(packet), 0) == len(packet)
    if case.response_type != 0x81 or case.layout is not None:
        found = case.make_format().run(bytearray(b"".join(packets)), 0)
        assert sum(block.packets for block in found.packets) == count
    events, now = [], 0
    for at in range(0, count, run):
        now = max(now, at * 1_000_000 + late * (at % 3))
        events.append(in_one_run(wire, b"".join(packets[at : at + run]), now))
    check(case, events)


def check(case: Case, events: list[Packets]) -> None:
    """That the assembler takes these packets, and that its scans are what scans promise to be."""
    for sample_ns in (case.sample_us * 1e3, 0.0):
        assembler, scans = Assembler(stream_of(case, sample_ns=sample_ns), 115_200), list[Scan]()
        for event in events:
            scans += assembler.add(event)
        for scan in scans:
            assert len(scan) == len(scan.angles) == len(scan.device_angles) == len(scan.device_distances) > 0
            assert ((scan.device_angles >= 0) & (scan.device_angles < 360)).all()
            assert (np.abs(scan.angles) <= np.float32(np.pi)).all()
            assert (scan.device_distances >= 0).all()
            assert (np.isnan(scan.ranges) == ~scan.valid).all()
            assert scan.lost_packets >= 0
            assert scan.duration_ns >= 0
        assert assembler.stats.scans == len(scans)
