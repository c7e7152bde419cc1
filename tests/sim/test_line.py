"""The device's end of the line: bytes leave at ten bit times each, neither early nor in another order."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from lidario.sim.line import LOGGED, RequestLog, TransmitQueue

BYTE = 10_000  # ns, at 1 Mbaud
US = 1_000


def test_wakeup_is_when_the_next_packet_has_left() -> None:
    queue = TransmitQueue(1_000_000)
    assert queue.wakeup(7) is None
    queue.push(b"aaabbbccc", 500_000, size=3, period=100 * US)
    assert queue.wakeup(0) == 500_000 + 3 * BYTE
    assert queue.take(500_000 + 3 * BYTE) == b"aaa"
    assert queue.wakeup(540_000) == 600_000 + 3 * BYTE
    assert queue.take(600_000 + BYTE) == b"b"
    assert queue.wakeup(610_000) == 600_000 + 3 * BYTE
    assert queue.wakeup(10_000_000) == 10_000_000  # overdue: at once
    assert queue.take(10_000_000) == b"bbccc"
    assert queue.wakeup(10_000_000) is None


def test_withdraw_keeps_what_is_made_and_frees_the_line() -> None:
    queue = TransmitQueue(1_000_000)
    queue.push(b"aaabbbccc", 100 * US, size=3, period=100 * US)
    queue.push(b"dddeee", 400 * US, size=3, period=100 * US)
    queue.withdraw(200 * US)  # the second packet is made in this very moment
    queue.push(b"X", 210 * US)
    assert queue.take(240 * US) == b"aaabbbX"
    assert queue.wakeup(240 * US) is None


def test_withdraw_before_the_first_packet_leaves_a_promised_answer() -> None:
    queue = TransmitQueue(1_000_000)
    queue.push(b"answer", 300 * US)
    queue.push(b"aaabbb", 400 * US, size=3, period=100 * US)
    queue.withdraw(200 * US)
    assert queue.take(10_000 * US) == b"answer"


def test_cut_loses_what_has_not_left() -> None:
    queue = TransmitQueue(1_000_000)
    queue.push(b"abcdef", 0)
    queue.cut(3 * BYTE)
    assert queue.wakeup(3 * BYTE) == 3 * BYTE
    queue.push(b"X", 3 * BYTE)
    assert queue.take(4 * BYTE) == b"abcX"


def test_half_a_packet_cannot_be_pushed() -> None:
    with pytest.raises(ValueError, match="whole number"):
        TransmitQueue(1_000_000).push(b"12345", 0, size=2, period=1)


pushes = st.lists(
    st.tuples(
        st.integers(0, 3_000_000),  # ready
        st.integers(1, 6),  # bytes of a packet
        st.integers(1, 8),  # packets
        st.integers(1, 200_000),  # period
    ),
    min_size=1,
    max_size=6,
)


@given(pushes, st.lists(st.integers(0, 6_000_000), min_size=1, max_size=20))
def test_every_byte_leaves_when_a_byte_by_byte_model_says(
    bursts: list[tuple[int, int, int, int]], moments: list[int]
) -> None:
    queue = TransmitQueue(1_000_000)
    leaves: list[int] = []
    end = 0
    for ready, size, count, period in bursts:
        first = len(leaves)
        for packet in range(count):
            end = max(end, ready + packet * period)
            for _ in range(size):
                end += BYTE
                leaves.append(end)
        data = bytes(i % 256 for i in range(first, len(leaves)))
        queue.push(data, ready, size=size, period=period)
    seen = b""
    for now in sorted(moments):
        seen += queue.take(now)
        assert len(seen) == sum(moment <= now for moment in leaves)
    seen += queue.take(end)
    assert seen == bytes(i % 256 for i in range(len(leaves)))


def test_the_log_forgets_the_oldest() -> None:
    log = RequestLog()
    for number in range(LOGGED + 2):
        log.add(number, "stop", b"\x00", "too early" if number == LOGGED + 1 else "")
    assert [entry.at_ns for entry in log] == list(range(2, LOGGED + 2))
    assert [entry.obeyed for entry in log] == [True] * (LOGGED - 1) + [False]
    assert log[-1].why == "too early"
