"""A clock and a wheel: streams of which all angles and times are known, and what the model tells of them."""

from collections.abc import Iterable, Sequence

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from lidario.families.spans import Arcs
from lidario.families.wheel import Wheel
from tests.support.wheels import heads, lost

TURN = 23040
PACKET_NS = 2_000_000
Floats = NDArray[np.float64]


def even(hertz: float, packets: int, first: float = 0.3) -> Floats:
    """Where an even rotor is at the beginning of each packet, in turns."""
    turns: Floats = first + hertz * PACKET_NS * 1e-9 * np.arange(packets, dtype=np.float64)
    return turns


def ramp(from_hz: float, to_hz: float, packets: int) -> Floats:
    """Where a rotor is that changes its speed evenly all the time."""
    turns: Floats = 0.3 + np.cumsum(np.linspace(from_hz, to_hz, packets, dtype=np.float64)) * PACKET_NS * 1e-9
    return turns


def told(
    turns: Floats, kept: Iterable[int], *, times: bool = True, every: int = 5, late_ns: Sequence[int] = ()
) -> list[tuple[list[int], Arcs]]:
    """What a wheel tells of those packets that come, turn by turn: their numbers, and what it says.

    Args:
        turns: Where the rotor is at each packet of the stream.
        kept: Those that come; one more than are told of.
        times: Whether it is known when they came.
        every: Packets that each read brings.
        late_ns: How late the reads of each turn are.
    """
    wheel, found = Wheel(TURN), list[tuple[list[int], Arcs]]()
    wheel.tell_time(PACKET_NS if times else 0.0)
    numbers = sorted(kept)
    angles = np.floor(turns % 1.0 * TURN).astype(np.int32)
    whole = np.floor(turns).astype(int)
    for turn in range(int(whole[numbers[-1]])):
        here = [number for number in numbers[:-1] if whole[number] == turn]
        if not here:
            continue
        behind = next(number for number in numbers if number > here[-1])
        late = late_ns[turn] if turn < len(late_ns) else 0
        ends = [*range(every, len(here), every), len(here)]
        arrivals = [(end, (here[end - 1] + 1) * PACKET_NS + late) for end in ends]
        found.append((here, wheel.follow(heads(angles[here], int(angles[behind])), arrivals)))
    return found


def off(turns: Floats, found: Sequence[tuple[list[int], Arcs]]) -> float:
    """How far arcs that are told as certain are off the true ones, in degrees, at most."""
    return max(
        360 * float(np.abs(np.asarray(arcs.arc, float) / TURN - (turns[np.array(here) + 1] - turns[here])).max())
        for here, arcs in found
        if arcs.certain
    )


@pytest.mark.parametrize(("from_hz", "to_hz"), [(10, 1), (0.5, 10), (5, 12), (7, 7)])
@pytest.mark.parametrize("times", [True, False])
def test_a_rotor_that_changes_its_speed_loses_nothing(from_hz: float, to_hz: float, times: bool) -> None:
    turns = ramp(from_hz, to_hz, 1500)
    found = told(turns, range(1500), times=times)
    assert all(arcs.certain and not lost(arcs) for _, arcs in found)
    assert off(turns, found) < 0.04


@pytest.mark.parametrize("step", [2, 3])
@pytest.mark.parametrize("hertz", [4.0, 10.0, 15.0])
@pytest.mark.parametrize("late", [False, True])
def test_where_only_each_second_or_third_comes_time_tells(step: int, hertz: float, late: bool) -> None:
    """Also where one read of three turns is late."""
    turns = even(hertz, 1500)
    late_ns = [20_000_000 * (turn % 3 == 0) for turn in range(60)] if late else []
    found = told(turns, range(0, 1500, step), every=4, late_ns=late_ns)
    # The part of a turn with which the stream begins, and one more, may be too short to tell.
    settled = [(here, arcs) for here, arcs in found if here[0] * PACKET_NS > 0.35e9]
    assert all(arcs.certain for _, arcs in settled)
    assert all(lost(arcs) == (step - 1) * len(here) for here, arcs in settled)
    assert off(turns, settled) < 0.1


def test_without_times_spans_that_agree_are_one_arc() -> None:
    found = told(even(10.0, 600), range(0, 600, 2), times=False)
    assert all(arcs.certain and not lost(arcs) for _, arcs in found)


@pytest.mark.exhaustive("share", sample=[0.3, 0.6], full=[0.1, 0.2, 0.3, 0.4, 0.5, 0.6])
@pytest.mark.parametrize("large", [False, True])
@given(seed=st.integers(0, 2**32 - 1))
def test_random_gaps_are_no_new_speed(share: float, large: bool, seed: int) -> None:
    """Half of all packets or more are missing. What is told as certain is right.

    Of large packets, nine to a revolution, a few runs in hundreds may show three gaps alike by chance.
    """
    hertz = 40.0 if large else 10.0
    turns = even(hertz, 1200)
    random = np.random.default_rng(seed)
    kept = np.flatnonzero(random.random(1200) >= share).tolist()
    found = told(turns, [0, *kept[1:]], every=3)
    certain = [(here, arcs) for here, arcs in found if arcs.certain]
    assert len(certain) > 0.7 * len(found)
    wrong = sum(off(turns, [each]) >= 1.0 for each in certain)
    assert wrong <= (0.05 * len(certain) if large else 0)


def test_each_second_packet_is_lost_from_some_moment_on() -> None:
    turns = even(10.0, 1200)
    found = told(turns, [*range(600), *range(600, 1200, 2)])
    assert off(turns, found) < 0.1
    assert sum(lost(arcs) for here, arcs in found if here[0] >= 600) == sum(
        len(here) for here, _ in found if here[0] >= 600
    )


def test_a_device_that_is_faster_than_it_says_loses_nothing() -> None:
    """Its packets come in half the time that they should take."""
    wheel, angles = Wheel(TURN), np.arange(24, dtype=np.int32) * (TURN // 24)
    wheel.tell_time(PACKET_NS)
    for turn in range(20):
        arrivals = [(at, (turn * 24 + at) * PACKET_NS // 2) for at in (6, 12, 18, 24)]
        arcs = wheel.follow(heads(angles, 0), arrivals)
        assert (arcs.certain, lost(arcs)) == (True, 0)


def test_a_copy_goes_on_alone() -> None:
    wheel, angles = Wheel(TURN), np.arange(24, dtype=np.int32) * (TURN // 24)
    wheel.follow(heads(angles, 0))
    twin = wheel.copy()
    twin.follow(heads(angles[::2], 0))
    assert lost(wheel.follow(heads(angles, 0))) == 0
    assert lost(wheel.follow(heads(np.delete(angles, [3, 4]), 0))) == 2
