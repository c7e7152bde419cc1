"""Work in steps: a bounded time of it in each turn of the event loop, in order, and nothing is lost."""

import asyncio
from collections.abc import Iterator

from lidario.port.turns import TURN_NS, Turns


class Worked:
    """What was done, on a clock that each step moves on.

    Attributes:
        now: Nanoseconds.
        done: The steps that were made.
        turns: How many had been made at each turn of the loop.
    """

    def __init__(self) -> None:
        self.now = 0
        self.done: list[str] = []
        self.turns: list[int] = []
        self.errors: list[Exception] = []
        self.all = Turns(lambda: self.now, self.errors.append)

    def steps(self, name: str, count: int, each_ns: int = TURN_NS // 4, fails: bool = False) -> Iterator[None]:
        for step in range(count):
            self.now += each_ns
            self.done.append(f"{name}{step}")
            yield
        if fails:
            raise ZeroDivisionError(name)

    async def end(self) -> None:
        while self.all.waiting:
            self.turns.append(len(self.done))
            await asyncio.sleep(0)


async def test_what_takes_no_time_is_done_at_once() -> None:
    worked = Worked()
    worked.all.add(worked.steps("a", 1000, each_ns=0), 7)
    assert len(worked.done) == 1000
    assert not worked.all.waiting
    assert worked.all.size == 0


async def test_each_turn_takes_a_bounded_time_and_the_order_stays() -> None:
    worked = Worked()
    worked.all.add(worked.steps("a", 10), 100)
    worked.all.add(worked.steps("b", 3), 20)
    assert worked.done == ["a0", "a1", "a2", "a3"]
    assert worked.all.size == 120
    await worked.end()
    assert worked.done == [*(f"a{step}" for step in range(10)), "b0", "b1", "b2"]
    assert [after - before for before, after in zip(worked.turns, worked.turns[1:], strict=False)] == [4, 4]
    assert worked.all.size == 0


async def test_what_comes_in_the_same_turn_shares_its_time() -> None:
    """As where two callbacks of one turn each read what a peer floods."""
    worked = Worked()
    worked.all.add(worked.steps("a", 3))
    worked.all.add(worked.steps("b", 3))
    assert worked.done == ["a0", "a1", "a2"]
    await asyncio.sleep(0)
    assert worked.done[3:] == ["b0", "b1", "b2"]
    await asyncio.sleep(0)
    worked.all.add(worked.steps("c", 2))
    worked.all.add(worked.steps("d", 1))
    assert worked.done[6:] == ["c0", "c1", "d0"]


async def test_a_failure_is_told_and_what_waits_behind_it_is_done() -> None:
    worked = Worked()
    worked.all.add(worked.steps("a", 1, fails=True))
    assert [str(error) for error in worked.errors] == ["a"]
    assert not worked.all.waiting
    worked.all.add(worked.steps("b", 9, fails=True), 5)
    worked.all.add(worked.steps("c", 1), 5)
    await worked.end()
    assert [str(error) for error in worked.errors] == ["a", "b"]
    assert worked.done[-1] == "c0"
    assert worked.all.size == 0
