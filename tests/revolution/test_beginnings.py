"""The clock alone, by beginnings of revolutions that are made up: what passed between them."""

from collections.abc import Iterable, Sequence
from dataclasses import replace
from typing import Any

import pytest

from lidario.revolution.clock import Beginning, Passed, RevolutionClock

MS = 1_000_000


def beginning(start: float, lost: int = 0, over: float = 0.0) -> Beginning:
    """The next revolution begins, `start` revolutions after the stream; in its packets are such figures."""
    return Beginning(round(start * 100 * MS), over, 100.0 * MS, 1.25 * MS, 80 - lost, lost, False, 0, 0)


def told(beginnings: Iterable[Beginning]) -> list[Passed]:
    """What a clock tells of them, each with the number that was counted up to it."""
    clock, number, packets, found = RevolutionClock(1e9), 0, 0, list[Passed]()
    for each in beginnings:
        found.append(clock.follow(replace(each, number=number, packets_before=packets)))
        number += 1 + found[-1].unseen
        packets += each.packets + each.lost + found[-1].lost
    return found


def test_an_outage_with_a_gap_is_told_at_once_and_one_without_when_it_lasts() -> None:
    def unseen(starts: Sequence[float], lost: int | None = None, read: float = 1.0) -> list[int]:
        reads = behind_a_silence(round(read * 100 * MS))
        found = told(replace(beginning(n, n == lost), **reads) for n in starts)
        return [passed.unseen for passed in found]

    assert unseen((0, 1, 2, 6, 7), lost=2) == [0, 0, 0, 3, 0]
    # Where each takes a revolution to read, it is told at once; where it is read in a moment, when that has lasted.
    assert unseen((0, 1, 2, 6, 7)) == [0, 0, 0, 3, 0]
    assert unseen((0, 1, 2, 6, 7, 8, 9), read=0.2) == [0, 0, 0, 0, 0, 3, 0]
    assert unseen((0, 1, 2, 6, 7, 8, 9), read=0.0) == [0] * 7
    # Late, and back: nothing was missing.
    assert unseen((0, 1, 3.9, 4, 4.2, 5), read=0.1) == [0] * 6


def behind_a_silence(read_ns: int) -> dict[str, Any]:
    """Reads that took so long, behind a silence of ten revolutions; none if they took no time."""
    return {"read_ns": read_ns, "silences_ns": (1000 * MS, 0)} if read_ns else {}


@pytest.mark.parametrize("lost", [0, 20])
def test_without_a_silence_no_revolution_passes_unseen(lost: int) -> None:
    """A rotor that was held for half a second: only packets may be missing, as time tells. A silence hides some."""
    reads: dict[str, Any] = {"read_ns": 580 * MS, "silences_ns": [10 * MS] * 59}
    starts = [replace(beginning(n, lost), **reads) for n in (0, 1, 2, 7, 8)]
    starts[2].broken = lost > 0
    found = told(starts)
    assert [passed.unseen for passed in found] == [0] * 5
    assert [passed.lost for passed in found] == [0, 0, 0, 320, 0]
    for silence_ns, unseen in ((60 * MS, 0), (80 * MS, 1), (240 * MS, 3), (1000 * MS, 4)):
        starts[2].silences_ns = (10 * MS, silence_ns)
        assert told(starts)[3] == Passed(unseen, 320)


def numbered(start: float, number: int, **changes: object) -> Beginning:
    """As `beginning`, with the number that was counted up to it."""
    return replace(beginning(start), number=number, packets_before=number * 80, **changes)  # type: ignore[arg-type]


def test_what_passes_while_nothing_is_known_is_told_afterwards() -> None:
    """Behind a restart, and before a speed was ever sure."""
    clock = RevolutionClock(1e9)
    assert [clock.follow(numbered(n, n)).unseen for n in (0, 1, 2)] == [0, 0, 0]
    clock.restart()
    # The fifth one begins, and only three have a number.
    passed = clock.follow(numbered(5, 3))
    assert passed.unseen == 2
    assert passed.lost == pytest.approx(160, abs=3)
    assert clock.follow(numbered(6, 6)).unseen == 0
    # Counted too many meanwhile: not told again until as many have passed.
    clock.restart()
    assert clock.follow(numbered(8, 9)).unseen == 0
    clock.restart()
    assert clock.follow(numbered(12, 11)).unseen == 1


@pytest.mark.parametrize(("early", "is_none"), [(0.6, False), (0.7, True), (1.0, True), (1.3, True), (1.4, False)])
@pytest.mark.parametrize("read_ns", [0, 100 * MS])
@pytest.mark.parametrize("packets", [60, 79])
def test_one_that_begins_a_whole_revolution_early_is_none(
    early: float, is_none: bool, read_ns: int, packets: int
) -> None:
    """Where it is known when bytes were read, and not all of it came. The next one is one revolution on."""
    clock = RevolutionClock(1e9)
    reads = behind_a_silence(read_ns)
    for n in range(4):
        assert clock.follow(numbered(n, n, **reads)).unseen == 0
    is_none = is_none and read_ns > 0 and packets == 60
    here = numbered(4 - early, 4, **reads, packets=packets)
    assert clock.follow(here).unseen == (-1 if is_none else 0)
    if is_none:
        assert clock.follow(numbered(4, 4, **reads)) == Passed(0, 0)
        assert clock.follow(numbered(7, 5, **reads)).unseen == 2


def test_revolutions_that_begin_elsewhere_from_now_on_are_not_told_as_missing() -> None:
    """Seen with 0x81: a stream that begins at 281 degrees, and marks at 270."""
    clock = RevolutionClock(1e9)
    clock.follow(numbered(0, -1, over=281.25 / 360))
    clock.restart(270 / 360)
    assert clock.follow(numbered(0.96875, 0)).unseen == 0
    # A false mark at 90, and back: what was counted begins where it did.
    for number, seam in ((1.96875, 90 / 360), (3.96875, 270 / 360)):
        clock.follow(numbered(number, round(number - 1)))
        clock.restart(seam)
    assert clock.follow(numbered(4.96875, 4)).unseen == 0


@pytest.mark.parametrize(("seam", "unseen"), [(0.3, 4), (0.7, 5)])
def test_behind_a_seam_that_moved_rather_too_few_are_told(seam: float, unseen: int) -> None:
    """Revolutions begin three or seven tenths later from now on; the nearer of both beginnings is meant."""
    clock = RevolutionClock(1e9)
    for number in range(3):
        clock.follow(numbered(number, number))
    clock.restart(seam)
    clock.restart(seam)
    assert clock.follow(numbered(7 + seam, 3)).unseen == unseen
    # It moves again, by half a revolution.
    clock.restart(seam + 0.5)
    assert clock.follow(numbered(10 + seam + 0.5, 4 + unseen)).unseen == 2
