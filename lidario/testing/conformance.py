"""The rules that a lidar must keep, as tests.

::

    pytest --pyargs lidario.testing.conformance --lidario-device /dev/ttyUSB0

Without the option the simulated lidar is tried. One test is one rule. A rule that does not apply to the device is
skipped, and says why. What was measured is printed: ``-rA`` shows it.

The device is opened once, for all of them. Each test leaves laser and motor off.
"""

import asyncio
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager, nullcontext

import pytest

from lidario.conformance import RULES, Outcome, Rule, open_bench
from lidario.testing.clock import clock_of
from lidario.testing.device import SimulatedLidar
from lidario.testing.plugin import OPTION


@contextmanager
def opened(source: str | SimulatedLidar) -> Iterator[Callable[[Rule], None]]:
    """What tries a rule on this device, and fails or skips the test where it is not held, or not tried.

    The event loop belongs to no plugin: these tests run with pytest-asyncio, with anyio, and without both.
    """
    with asyncio.Runner() as runner:
        bench = runner.run(open_bench(source))
        clock = clock_of(runner.get_loop())
        if isinstance(source, SimulatedLidar) and clock is not None:
            # Its device lives on that clock, which stands still while the program sleeps.
            bench.pause = clock.skip

        def check(rule: Rule) -> None:
            verdict = runner.run(bench.try_rule(rule))
            print(verdict)
            if verdict.outcome is Outcome.NOT_TRIED:
                pytest.skip(verdict.text)
            if verdict.outcome is Outcome.BROKEN:
                known = f"known from: {rule.origin.value}, {rule.known_from}"
                pytest.fail(f"{rule.sentence}\nnot held: {verdict.text}\n{known}", pytrace=False)

        try:
            yield check
        finally:
            runner.run(bench.lidar.close())


@pytest.fixture(scope="module")
def lidar_bench(request: pytest.FixtureRequest) -> Iterator[Callable[[Rule], None]]:
    """What tries a rule on the device of ``--lidario-device``, which is open; a simulated one without."""
    given: str | None = request.config.getoption(OPTION)
    source = SimulatedLidar() if given is None else given
    with nullcontext(source) if isinstance(source, str) else closing(source), opened(source) as check:
        yield check


@pytest.mark.parametrize("rule", RULES, ids=lambda rule: rule.name)
def test_rule(lidar_bench: Callable[[Rule], None], rule: Rule) -> None:
    """What the rule says holds."""
    lidar_bench(rule)
