"""Faults: the grammar users type, and what happens to bytes, whatever the chunks."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from lidario.sim.faults import Faults, parse_faults

SECOND = 1_000_000_000
ZEROS = bytes(100_000)
COUNTING = bytes(i % 251 for i in range(20_000))


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("", Faults()),
        ("drop:1%", Faults(drop=0.01)),
        ("drop:0.001", Faults(drop=0.001)),
        ("drop:1%,flip:0.1%", Faults(drop=0.01, flip=0.001)),
        (" insert:.5% , silent:5s ", Faults(insert=0.005, silent_s=5.0)),
        ("unplug:1.5", Faults(unplug_s=1.5)),
        ("stall:200ms,garbage", Faults(stall_s=0.2, garbage=True)),
        ("silent:2min", Faults(silent_s=120.0)),
    ],
)
def test_grammar(text: str, expected: Faults) -> None:
    found = parse_faults(text)
    names = ("drop", "flip", "insert", "silent_s", "unplug_s", "stall_s", "garbage")
    assert [getattr(found, name) for name in names] == [getattr(expected, name) for name in names]


@pytest.mark.parametrize(
    ("text", "cause"),
    [
        ("dorp:1%", "'dorp'"),
        ("drop", "'drop'"),
        ("drop:", "share"),
        ("drop:many", "'drop:many'"),
        ("drop:-1%", "'drop:-1%'"),
        ("drop:120%", "100 %"),
        ("drop:60%,flip:60%", "100 %"),
        ("silent:5h", "duration"),
        ("unplug:1%", "duration"),
        ("stall:1s", "less than the second"),
        ("garbage:1", "nothing"),
        ("drop:1%,drop:2%", "twice"),
        ("silent:1s,silent:2s", "twice"),
    ],
)
def test_what_cannot_be_read_says_why(text: str, cause: str) -> None:
    with pytest.raises(ValueError, match=cause):
        parse_faults(text)


@pytest.mark.parametrize("text", ["dorp:1%", "drop:many"])
def test_what_cannot_be_read_names_the_faults(text: str) -> None:
    with pytest.raises(ValueError, match="drop, flip, insert, silent, unplug, stall, garbage"):
        parse_faults(text)


def test_no_faults_no_change() -> None:
    assert Faults().apply(COUNTING, 0) == COUNTING


def test_drop_takes_its_share() -> None:
    left = parse_faults("drop:1%").apply(ZEROS, 0)
    assert len(ZEROS) - len(left) == pytest.approx(1000, abs=150)


def test_dropping_all_leaves_nothing() -> None:
    assert parse_faults("drop:100%").apply(COUNTING, 0) == b""


def test_flip_inverts_one_bit_of_its_share_and_every_bit_in_turn() -> None:
    got = np.frombuffer(parse_faults("flip:2%").apply(ZEROS, 0), np.uint8)
    assert got.size == len(ZEROS)
    changed = got[got != 0]
    assert changed.size == pytest.approx(2000, abs=200)
    assert set(changed.tolist()) == {1, 2, 4, 8, 16, 32, 64, 128}


def test_insert_loses_nothing() -> None:
    got = parse_faults("insert:1%").apply(COUNTING, 0)
    assert len(got) - len(COUNTING) == pytest.approx(200, abs=60)
    remaining = iter(got)
    assert all(byte in remaining for byte in COUNTING)  # still there, in order


@given(
    st.sampled_from(["drop:5%,flip:5%,insert:5%", "garbage", "drop:50%", "insert:30%"]),
    st.lists(st.integers(0, 400), max_size=12),
    st.integers(0, 5),
)
def test_chunks_make_no_difference(text: str, cuts: list[int], seed: int) -> None:
    data = COUNTING[:400]
    whole = parse_faults(text, seed=seed).apply(data, 0)
    faults = parse_faults(text, seed=seed)
    edges = [0, *sorted(cuts), len(data)]
    pieces = [faults.apply(data[a:b], 0) for a, b in pairwise(edges)]
    assert b"".join(pieces) == whole


def test_the_seed_decides() -> None:
    one = parse_faults("drop:5%", seed=1).apply(COUNTING, 0)
    assert one == parse_faults("drop:5%", seed=1).apply(COUNTING, 0)
    assert one != parse_faults("drop:5%", seed=2).apply(COUNTING, 0)


def test_garbage_is_as_long_and_has_nothing_in_common() -> None:
    got = parse_faults("garbage").apply(COUNTING, 0)
    assert len(got) == len(COUNTING)
    same = sum(a == b for a, b in zip(got, COUNTING, strict=True))
    assert same < 0.01 * len(COUNTING)  # one in 256 by chance


def test_silence_counts_from_the_first_byte() -> None:
    faults = parse_faults("silent:5s")
    assert faults.apply(b"", 100 * SECOND) == b""
    assert faults.apply(b"a", 200 * SECOND) == b"a"
    assert faults.apply(b"b", 205 * SECOND - 1) == b"b"
    assert faults.apply(b"c", 205 * SECOND) == b""
    assert not faults.unplugged(300 * SECOND)


def test_unplugging_counts_from_the_first_byte() -> None:
    faults = parse_faults("unplug:2s")
    assert not faults.unplugged(100 * SECOND)
    assert faults.apply(b"a", 200 * SECOND) == b"a"
    assert not faults.unplugged(202 * SECOND - 1)
    assert faults.unplugged(202 * SECOND)
    assert faults.apply(b"b", 202 * SECOND) == b""


def test_a_stall_holds_bytes_back_and_loses_none() -> None:
    faults = parse_faults("stall:200ms")
    assert faults.apply(b"a", 0) == b"a"
    assert faults.apply(b"b", SECOND * 8 // 10 - 1) == b"b"
    assert faults.apply(b"c", SECOND * 8 // 10) == b""
    assert faults.apply(b"d", SECOND - 1) == b""
    assert faults.holding
    assert faults.apply(b"", SECOND) == b"cd"
    assert not faults.holding
