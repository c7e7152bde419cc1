"""The byte queue: first in, first out, and never beyond its limit."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from lidario.wire.buffer import ReceiveBuffer


def test_the_limit_is_kept() -> None:
    buffer = ReceiveBuffer(8)
    buffer.append(b"12345")
    assert len(buffer) == 5
    with pytest.raises(OverflowError, match="4 bytes do not fit: 5 of 8"):
        buffer.append(b"6789")
    assert buffer.peek(9) == b"12345"
    buffer.append(memoryview(b"678"))
    with pytest.raises(OverflowError, match="1 bytes do not fit: 8 of 8"):
        buffer.append(b"9")
    assert buffer.clear() == 8
    assert len(buffer) == 0


def test_looking_takes_nothing() -> None:
    buffer = ReceiveBuffer(100)
    buffer.append(bytearray(b"abcabc"))
    assert buffer.find(b"ca") == 2
    assert buffer.find(b"x") == -1
    assert buffer.peek(2, 4) == b"bc"
    assert buffer.peek(9, 5) == b"c"
    assert len(buffer) == 6


@given(st.lists(st.tuples(st.binary(max_size=30), st.integers(0, 40))))
def test_bytes_leave_in_the_order_they_came(steps: list[tuple[bytes, int]]) -> None:
    buffer, expected = ReceiveBuffer(10_000), b""
    for data, size in steps:
        buffer.append(data)
        expected += data
        assert buffer.peek(size) == expected[:size]
        buffer.skip(size)
        expected = expected[size:]
        assert buffer.peek(len(expected)) == expected
        assert len(buffer) == len(expected)
