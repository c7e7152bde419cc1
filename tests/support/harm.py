"""Hypothesis strategies for streams that no device sends: golden packets cut, spliced, flipped, and noise."""

from hypothesis import strategies as st

from lidario.families.ydlidar.simulated.packers import SCAN_HEADER, pack_response, pack_time_stamp
from tests.support.cases import Case

LURES = (
    b"\xa5\x5a", b"\xa5", b"\xaa\x55", b"\xaa\xaa\x55", b"\xa0\x50", b"\xaf\x5f\xaf\x5f", b"\xaa\x55\x00\x28",
    SCAN_HEADER, SCAN_HEADER[:3], pack_response(0x04, bytes(range(20))), pack_response(0x04, bytes(20))[:11],
    pack_time_stamp(0x55AA55AA, 7), pack_time_stamp(1)[:5], bytes(200), b"\xff" * 200,
)  # fmt: skip
"""What begins like a packet, an answer or a record, and is none."""


def _most(case: Case) -> int:
    return 60 if len(case.packets[0]) == 5 else 4


@st.composite
def runs(draw: st.DrawFn, case: Case, least: int = 1, most: int | None = None) -> bytes:
    """Consecutive golden packets from anywhere in the stream."""
    count = draw(st.integers(least, most or max(least, _most(case))))
    first = draw(st.integers(0, len(case.packets) - count))
    return b"".join(case.packets[first : first + count])


@st.composite
def fragments(draw: st.DrawFn, case: Case) -> bytes:
    """A piece of a golden stream that begins and ends anywhere."""
    whole = draw(runs(case))
    begin = draw(st.integers(0, len(whole)))
    return whole[begin : draw(st.integers(begin, len(whole)))]


@st.composite
def _flipped(draw: st.DrawFn, case: Case) -> bytes:
    raw = bytearray(draw(runs(case)))
    for _ in range(draw(st.integers(1, 4))):
        bit = draw(st.integers(0, 8 * len(raw) - 1))
        raw[bit // 8] ^= 1 << bit % 8
    return bytes(raw)


def noises(case: Case) -> st.SearchStrategy[bytes]:
    """Bytes that are no packets: random, or made of pieces of packets."""
    parts = st.one_of(st.binary(max_size=300), fragments(case), st.sampled_from(LURES))
    return st.lists(parts, max_size=6).map(b"".join)


def messes(case: Case) -> st.SearchStrategy[bytes]:
    """A stream in which anything may follow anything."""
    parts = st.one_of(runs(case), _flipped(case), fragments(case), st.binary(max_size=100), st.sampled_from(LURES))
    return st.lists(parts, min_size=1, max_size=9).map(b"".join)
