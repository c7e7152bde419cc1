"""A serial number is replaced wherever it stands, by something that looks alike and says nothing."""

from __future__ import annotations

from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st

from lidario.conformance.hidden import REACH, Numbers, hide

TEXT = b"H0906091"
VALUES = bytes([2, 0, 1, 9, 0x42, 7, 1, 3, 0, 0, 0, 5, 1, 1, 8, 8])
BYTES = bytes.fromhex("A1D49A83C1E69CD1A5B49FF63C093C33")
NUMBERS = [
    pytest.param(TEXT.decode(), TEXT, id="sent as text"),
    pytest.param("2019[42]71300051188", VALUES, id="a number for each digit"),
    pytest.param(BYTES.hex().upper(), BYTES, id="shown as hexadecimal digits"),
]


@pytest.mark.parametrize(("serial", "sent"), NUMBERS)
def test_a_number_is_replaced_by_one_that_looks_alike(serial: str, sent: bytes) -> None:
    hidden = hide(serial, [b"\x18\x01" + sent + b"\x0a"])
    data = b"before" + sent + b"behind" + sent
    assert hidden.sent == sent
    assert hidden.in_bytes(data) == b"before" + hidden.instead + b"behind" + hidden.instead
    assert hidden.in_text(f"it is {serial}.") == f"it is {hidden.hashed}."
    assert hidden.instead != sent
    assert sum(hidden.instead) == sum(sent)
    # The two belong together: what shows the bytes shows the text.
    assert hide(hidden.hashed, [hidden.instead]).sent == hidden.instead
    # The same device has the same hash, and another one another.
    assert hide(serial, [sent]) == hidden
    last = "0" if serial[-1] != "0" else "1"
    changed = hide(serial[:-1] + last, [])
    assert changed.hashed != hidden.hashed


@pytest.mark.parametrize(("serial", "sent"), NUMBERS)
def test_no_byte_of_it_is_left_where_it_was(serial: str, sent: bytes) -> None:
    hidden = hide(serial, [sent])
    same = sum(a == b for a, b in zip(sent, hidden.instead, strict=True))
    assert same < len(sent) // 2


@given(st.lists(st.integers(0, 40), max_size=20))
def test_reads_may_divide_it(cuts: list[int]) -> None:
    hidden = hide(BYTES.hex(), [BYTES])
    data = b"\xa5\x5a" + BYTES + b"\x01\x02" + BYTES[:12]
    places = sorted({0, len(data), *(each for each in cuts if each < len(data))})
    chunks = [data[a:b] for a, b in pairwise(places)]
    numbers = Numbers()
    numbers.add(BYTES.hex(), [BYTES])
    found = [
        numbers.in_bytes(data[a:b], data[max(0, a - REACH) : a], data[b : b + REACH]) for a, b in pairwise(places)
    ]
    assert [len(each) for each in found] == [len(each) for each in chunks]
    assert b"".join(found) == b"\xa5\x5a" + hidden.instead + b"\x01\x02" + hidden.instead[:12]


def test_a_part_that_a_lossy_line_has_left_is_replaced_too() -> None:
    hidden = hide(BYTES.hex(), [BYTES])
    damaged = BYTES[:9] + BYTES[10:]
    found = hidden.in_bytes(damaged)
    assert found[:9] == hidden.instead[:9]
    assert found[9:] == BYTES[10:]  # six bytes, of which nobody makes the number


@pytest.mark.parametrize("serial", ["", "00000000000000000000000000000000", "FFFFFFFF"])
def test_what_was_never_written_into_the_device_is_no_secret(serial: str) -> None:
    hidden = hide(serial, [bytes(40)])
    assert hidden.in_bytes(bytes(100)) == bytes(100)
    assert hidden.in_text("a text") == "a text"


@given(st.binary(min_size=8, max_size=24).filter(lambda each: len(set(each)) > 1))
def test_the_sum_stays(sent: bytes) -> None:
    hidden = hide(sent.hex(), [sent])
    assert len(hidden.instead) == len(sent)
    assert sum(hidden.instead) == sum(sent)
