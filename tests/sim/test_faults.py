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
        ("burst:0.01%,duplicate:1%,babble:1000", Faults(burst=0.0001, duplicate=0.01, babble=1000.0)),
        ("late:300ms,replug:5s", Faults(late_s=0.3, replug_s=5.0)),
        ("reboot:5s,freeze:1min,protect:2", Faults(reboot_s=5.0, freeze_s=60.0, protect_s=2.0)),
        ("wrong-response:20%", Faults(wrong_response=0.2)),
    ],
)
def test_grammar(text: str, expected: Faults) -> None:
    assert parse_faults(text) == expected


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
        ("reboot:1s,reboot:2s", "twice"),
        ("babble:1%", "number of bytes"),
        ("babble", "number of bytes"),
        ("babble:0.4", "babble is at least one byte a second"),
        ("wrong-response:120%", "100 %"),
        ("wrong_response:1%", "'wrong_response'"),
        ("freeze:10%", "duration"),
    ],
)
def test_what_cannot_be_read_says_why(text: str, cause: str) -> None:
    with pytest.raises(ValueError, match=cause):
        parse_faults(text)


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
    st.sampled_from(
        [
            "drop:5%,flip:5%,insert:5%",
            "garbage",
            "drop:50%",
            "insert:30%",
            "burst:1%",
            "duplicate:2%",
            "burst:1%,duplicate:2%,drop:2%,flip:2%,insert:2%",
            "babble:5000,burst:1%,late:10ms",
        ]
    ),
    st.lists(st.integers(0, 400), max_size=12),
    st.integers(0, 5),
)
def test_chunks_make_no_difference(text: str, cuts: list[int], seed: int) -> None:
    data = COUNTING[:400]
    one, faults = parse_faults(text, seed=seed), parse_faults(text, seed=seed)
    whole = one.apply(b"", 0) + one.apply(data, SECOND) + one.apply(b"", 2 * SECOND)
    edges = [0, *sorted(cuts), len(data)]
    pieces = [faults.apply(b"", 0)]
    pieces += [faults.apply(data[a:b], SECOND) for a, b in pairwise(edges)]
    pieces.append(faults.apply(b"", 2 * SECOND))
    assert b"".join(pieces) == whole


def test_a_burst_makes_64_bytes_random() -> None:
    got = parse_faults("burst:0.01%", seed=3).apply(ZEROS, 0)
    assert len(got) == len(ZEROS)
    hit = np.flatnonzero(np.frombuffer(got, np.uint8))
    bursts = np.split(hit, np.flatnonzero(np.diff(hit) > 64) + 1)
    assert 3 <= len(bursts) <= 25
    for burst in bursts:
        # The first and the last byte may be 0 by chance; two bursts may meet.
        assert 50 <= np.ptp(burst) + 1 <= 128
        assert burst.size >= 50


def test_a_repetition_gives_the_64_bytes_before_again() -> None:
    got = parse_faults("duplicate:0.01%", seed=1).apply(COUNTING, 0)
    extra = len(got) - len(COUNTING)
    assert extra > 0
    assert extra % 64 == 0
    at = next(k for k, (a, b) in enumerate(zip(got, COUNTING, strict=False)) if a != b)
    assert got[:at] == COUNTING[:at]
    assert got[at : at + 64] == COUNTING[at - 64 : at]
    assert got[at + 64 : at + 128] == COUNTING[at : at + 64]


def test_babble_comes_from_a_silent_device() -> None:
    faults = parse_faults("babble:1000")
    assert faults.wakeup(100 * SECOND) == 100 * SECOND + SECOND // 1000
    assert len(faults.apply(b"", 101 * SECOND)) == 1000
    assert faults.apply(b"", 101 * SECOND) == b""
    got = faults.apply(b"abc", 102 * SECOND)
    assert len(got) == 1003
    assert got.endswith(b"abc")
    assert faults.wakeup(102 * SECOND) == 102 * SECOND + SECOND // 1000


def test_late_bytes_come_later_and_all_of_them() -> None:
    faults = parse_faults("late:300ms")
    assert faults.wakeup(0) is None
    assert faults.apply(b"ab", 0) == b""
    assert faults.apply(b"c", SECOND // 10) == b""
    assert faults.wakeup(SECOND // 10) == SECOND * 3 // 10
    assert faults.apply(b"", SECOND * 3 // 10) == b"ab"
    assert faults.wakeup(SECOND * 3 // 10) == SECOND * 4 // 10
    assert faults.apply(b"d", SECOND * 8 // 10) == b"c"
    assert faults.wakeup(SECOND * 8 // 10) == SECOND * 11 // 10
    assert faults.apply(b"", 2 * SECOND) == b"d"


def test_a_replug_pulls_the_cable_for_a_second() -> None:
    faults = parse_faults("replug:2s")
    assert faults.back_at(0) is None
    assert faults.apply(b"a", 100 * SECOND) == b"a"
    assert faults.back_at(100 * SECOND) == 103 * SECOND
    assert faults.wakeup(101 * SECOND) == 102 * SECOND
    assert [faults.unplugged(at * SECOND) for at in (101, 102, 103)] == [False, True, False]
    assert not faults.unplugged(102 * SECOND - 1)
    assert faults.unplugged(103 * SECOND - 1)
    assert [faults.cable(at * SECOND) for at in (101, 102, 103)] == [0, 1, 1]
    assert faults.apply(b"b", 102 * SECOND) == b""
    assert faults.apply(b"c", 103 * SECOND) == b"c"


@pytest.mark.parametrize("unplug", ["2500ms", "4s"])
def test_after_an_unplug_nothing_is_plugged_in_again(unplug: str) -> None:
    faults = parse_faults(f"replug:2s,unplug:{unplug}")
    faults.begin(0)
    assert faults.back_at(2 * SECOND) == 3 * SECOND
    assert faults.back_at(4 * SECOND) is None
    assert faults.unplugged(4 * SECOND)


def test_what_comes_by_itself_is_foretold() -> None:
    assert parse_faults("drop:1%").wakeup(0) is None
    stall = parse_faults("stall:200ms")
    stall.apply(b"a", 0)
    assert stall.wakeup(SECOND // 2) is None
    stall.apply(b"b", SECOND * 9 // 10)
    assert stall.wakeup(SECOND * 9 // 10) == SECOND
    unplug = parse_faults("unplug:2s")
    assert unplug.wakeup(0) is None
    unplug.begin(SECOND)
    assert unplug.wakeup(SECOND) == 3 * SECOND


def test_the_seed_decides() -> None:
    one = parse_faults("drop:5%", seed=1).apply(COUNTING, 0)
    assert one == parse_faults("drop:5%", seed=1).apply(COUNTING, 0)
    assert one != parse_faults("drop:5%", seed=2).apply(COUNTING, 0)


def test_silence_counts_from_the_first_byte() -> None:
    faults = parse_faults("silent:5s")
    assert faults.apply(b"", 100 * SECOND) == b""
    assert faults.apply(b"a", 200 * SECOND) == b"a"
    assert faults.apply(b"b", 205 * SECOND - 1) == b"b"
    assert faults.apply(b"c", 205 * SECOND) == b""
    assert not faults.unplugged(300 * SECOND)


def test_a_stall_holds_bytes_back_and_loses_none() -> None:
    faults = parse_faults("stall:200ms")
    assert faults.apply(b"a", 0) == b"a"
    assert faults.apply(b"b", SECOND * 8 // 10 - 1) == b"b"
    assert faults.apply(b"c", SECOND * 8 // 10) == b""
    assert faults.apply(b"d", SECOND - 1) == b""
    assert faults.wakeup(SECOND - 1) == SECOND
    assert faults.apply(b"", SECOND) == b"cd"
    assert faults.wakeup(SECOND) is None
