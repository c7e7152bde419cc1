"""A format says the same of bytes wherever they stand in its buffer."""

from itertools import product

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.support.cases import CASES, Case

_RECORDS = (
    # The response of an LD14P, a frame of a Delta-2A that turns too slowly, a Hokuyo that is not ready.
    bytes.fromhex("54A104000000004A"),
    bytes.fromhex("AA00090161AE00012001E4"),
    b"MD0044072501000\n0M^\n\n",
)


@given(
    case=st.sampled_from(CASES),
    before=st.binary(min_size=1, max_size=12),
    cut=st.integers(0, 300),
    changes=st.lists(st.tuples(st.integers(0, 40), st.integers(0, 255)), max_size=3),
    record=st.sampled_from((b"", *_RECORDS)),
)
def test_where_bytes_stand_does_not_matter(
    case: Case, before: bytes, cut: int, changes: list[tuple[int, int]], record: bytes
) -> None:
    wire, data = case.make_format(), bytearray(record + b"".join(case.packets[:2]))
    for at, value in changes:
        data[at % len(data)] = value
    del data[max(1, len(data) - cut) :]
    moved, at = bytearray(before + data), len(before)

    assert wire.other_record(moved, at) == wire.other_record(data, 0)
    size = wire.measure(data, 0)
    assert wire.measure(moved, at) == size
    if 0 < size <= len(data):
        assert wire.intact(moved, at, size) == wire.intact(data, 0, size)


@pytest.mark.exhaustive("case", sample=CASES)
def test_of_the_beginning_all_is_said_that_is_said_of_the_whole_or_nothing_yet(case: Case) -> None:
    wire, packets = case.make_format(), b"".join(case.packets[:8])
    for record in (b"", *_RECORDS):
        for at, changed in product(range(20), (0, 1, 0x80)):
            data = bytearray(record + packets)
            data[at] ^= changed
            for ask in (wire.measure, wire.other_record):
                whole = ask(data, 0)
                said = [ask(data[:length], 0) for length in range(1, 40)]
                assert set(said) <= {0, whole}
