"""An event loop whose clock is driven: when nothing is ready it jumps to the next timer instead of sleeping.

An hour of keepalives passes in a second. A test that waits for ever fails by its name: at once where nothing can
arrive any more, else when the loop has gone round more often than any test needs.
"""

import asyncio
import math
import selectors
import threading
from collections.abc import Awaitable, Callable, Iterable
from functools import partial, wraps
from typing import Any, ParamSpec, TypeVar

P = ParamSpec("P")
T = TypeVar("T")
START = 1000.0
THREAD = "lidario: blocking call"
BOUND_S = 30.0
MOST_TURNS = 1_000_000
"""Twenty times as many as the longest test needs (`tests/recording/test_offline.py`: 44133)."""


class _DrivenSelector(selectors.DefaultSelector):
    """Waits by moving the clock forward."""

    def __init__(self) -> None:
        super().__init__()
        self.now = START

    def select(self, timeout: float | None = None) -> list[tuple[selectors.SelectorKey, int]]:
        # Looked at first: what a blocking call that has ended told last is there by now.
        waits = _in_a_thread()
        events: list[tuple[selectors.SelectorKey, int]] = super().select(0)
        while waits and not events:
            # A blocking call takes no time of this clock.
            waits = _in_a_thread()
            events = super().select(0.001 if waits else 0)
        if not events:
            if timeout is None:
                raise AssertionError("nothing is due and nothing can arrive: this would wait for ever")
            self.now += max(0.0, timeout)
        return events


def _in_a_thread() -> bool:
    """Whether a blocking call of lidario is under way."""
    return threading.active_count() > 1 and any(thread.name == THREAD for thread in threading.enumerate())


class DrivenLoop(asyncio.SelectorEventLoop):
    """A loop that never sleeps."""

    def __init__(self) -> None:
        self._driven = _DrivenSelector()
        super().__init__(self._driven)
        self.turns = 0  # times the loop has gone round, for tests that act at every step
        self.most_turns: float = MOST_TURNS  # how often it may
        self.at_turn: Callable[[int], object] | None = None

    def time(self) -> float:
        return self._driven.now

    @property
    def is_idle(self) -> bool:
        """Whether nothing else is to run in this turn or the next."""
        return not self._ready  # type: ignore[attr-defined]

    @property
    def timers(self) -> list[asyncio.TimerHandle]:
        """Those that are left, without cancelled ones."""
        return [timer for timer in self._scheduled if not timer.cancelled()]  # type: ignore[attr-defined]

    def after(self, turns: int, act: Callable[[], object]) -> None:
        """Call `act` once, when the loop has gone round that many times more; never where it is 0."""
        due = self.turns + turns
        self.at_turn = lambda turn: act() if turn == due else None

    def block(self, seconds: float) -> None:
        """As if the running callback had taken that long."""
        self._driven.now += seconds

    def _run_once(self) -> None:
        self.turns += 1
        if self.turns > self.most_turns:
            # What is cancelled because of that may need some turns more.
            self.most_turns += MOST_TURNS
            waiting = ", ".join(sorted(task.get_name() for task in asyncio.all_tasks(self)))
            raise AssertionError(
                f"the loop has gone round {self.turns - 1} times, {self.time() - START:.0f} s by its clock: "
                f"this would go on for ever. Tasks that wait: {waiting or 'none'}"
            )
        if self.at_turn is not None:
            self.at_turn(self.turns)
        super()._run_once()  # type: ignore[misc]


def endless_loop() -> DrivenLoop:
    """One for what is no test, and may take as long as it likes."""
    loop = DrivenLoop()
    loop.most_turns = math.inf
    return loop


def driven_loop() -> DrivenLoop:
    """The loop that runs, which is a driven one."""
    loop = asyncio.get_running_loop()
    assert isinstance(loop, DrivenLoop)
    return loop


def now() -> float:
    """What the clock of the running loop says, in seconds."""
    return asyncio.get_running_loop().time()


def now_ns() -> int:
    """The same in nanoseconds, as simulated devices count them."""
    return round(now() * 1e9)


async def until(condition: Callable[[], object]) -> None:
    """Wait until `condition` holds, on a loop with a real clock; the bound only turns a hang into a failure."""
    async with asyncio.timeout(BOUND_S):
        while not condition():
            await asyncio.sleep(0.002)


def unless_unfinished(loop: asyncio.AbstractEventLoop, context: dict[str, Any]) -> None:
    """An exception handler for tests that close a loop under its tasks: what is told of those is not logged.

    asyncio tells it when such a task becomes garbage, and that may be behind the last test.
    """
    if "was destroyed" not in context["message"]:
        loop.default_exception_handler(context)


def run_driven(main: Callable[[], Awaitable[T]]) -> T:
    """Run `main` on a driven loop; anything the loop's exception handler hears of is a failure."""
    complaints: list[dict[str, Any]] = []

    async def guarded() -> T:
        loop = asyncio.get_running_loop()
        loop.set_exception_handler(lambda _, context: complaints.append(context))
        result = await main()
        left = asyncio.all_tasks() - {asyncio.current_task()}
        assert not left, f"tasks left behind: {left}"
        return result

    with asyncio.Runner(loop_factory=DrivenLoop) as runner:
        value = runner.run(guarded())
    assert not complaints, complaints
    return value


def turns_of(main: Callable[[], Awaitable[object]]) -> int:
    """How often a driven loop goes round for it."""

    async def counted() -> int:
        before = driven_loop().turns
        await main()
        return driven_loop().turns - before

    return run_driven(counted)


def at_each(steps: Iterable[float], main: Callable[[Any], Awaitable[object]], told: str) -> None:
    """Run this at each of these steps, or moments; where it fails, the error says at which one."""
    for step in steps:
        try:
            run_driven(partial(main, step))
        except Exception as error:
            raise AssertionError(f"{told} at {step}: {error!r}") from error


def driven(test: Callable[P, Awaitable[None]]) -> Callable[P, None]:
    """Decorate an async test to run on a driven loop."""

    @wraps(test)
    def wrapper(*args: P.args, **kwargs: P.kwargs) -> None:
        run_driven(lambda: test(*args, **kwargs))

    return wrapper
