"""The rules that a lidar must keep, as tests.

::

    pytest --pyargs lidario.testing.conformance --lidario-device /dev/ttyUSB0

Without the option the simulated lidar is tried. One test is one rule. A rule that does not apply to the device is
skipped, and says why. What was measured is printed: ``-rA`` shows it.

The device is opened once, for all of them. Each test leaves laser and motor off.
"""

import asyncio
from collections.abc import Iterator

import pytest

from lidario.conformance import RULES, Bench, Outcome, Rule, open_bench
from lidario.testing.clock import clock_of
from lidario.testing.device import SimulatedLidar
from lidario.testing.plugin import OPTION


class Runner:
    """A bench, and the event loop on which rules are tried, one in each test.

    The loop belongs to no plugin: these tests run with pytest-asyncio, with anyio, and without both.
    """

    def __init__(self, source: str | SimulatedLidar) -> None:
        self._loop = asyncio.Runner()
        try:
            self.bench: Bench = self._loop.run(open_bench(source))
        except BaseException:
            self._loop.close()
            raise
        clock = clock_of(self._loop.get_loop())
        if isinstance(source, SimulatedLidar) and clock is not None:
            # Its device lives on that clock, which stands still while the program sleeps.
            self.bench.pause = clock.skip

    def check(self, rule: Rule) -> None:
        """Try a rule; fails or skips the test where it is not held, or not tried."""
        verdict = self._loop.run(self.bench.try_rule(rule))
        print(verdict)
        if verdict.outcome is Outcome.NOT_TRIED:
            pytest.skip(verdict.text)
        if verdict.outcome is Outcome.BROKEN:
            pytest.fail(
                f"{rule.sentence}\nnot held: {verdict.text}\nknown from: {rule.origin.value}, {rule.known_from}",
                pytrace=False,
            )

    def close(self) -> None:
        """Leave the device still."""
        try:
            self._loop.run(self.bench.lidar.close())
        finally:
            self._loop.close()


@pytest.fixture(scope="module")
def lidar_bench(request: pytest.FixtureRequest) -> Iterator[Runner]:
    """The device of ``--lidario-device``, open; a simulated one without."""
    given: str | None = request.config.getoption(OPTION)
    source = SimulatedLidar() if given is None else given
    runner = Runner(source)
    yield runner
    try:
        runner.close()
    finally:
        if isinstance(source, SimulatedLidar):
            source.close()


@pytest.mark.parametrize("rule", RULES, ids=lambda rule: rule.name)
def test_rule(lidar_bench: Runner, rule: Rule) -> None:
    """What the rule says holds."""
    lidar_bench.check(rule)
