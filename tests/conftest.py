"""Hypothesis runs the same examples every time and takes the time it needs; ``--soak`` lengthens the slow tests.

``HYPOTHESIS_PROFILE=search`` makes it look for new examples, many of them.
"""

import os
import sys

import pytest
from hypothesis import HealthCheck, settings

NEVER_MIND = (HealthCheck.too_slow, HealthCheck.data_too_large)

settings.register_profile("ci", deadline=None, derandomize=True, max_examples=40, suppress_health_check=NEVER_MIND)
settings.register_profile("search", deadline=None, max_examples=1500, suppress_health_check=NEVER_MIND)
settings.load_profile(os.environ.get("HYPOTHESIS_PROFILE", "ci"))

# Pseudo-terminals, signals and /proc: these tests are about what only such systems have.
LINUX_ONLY = [
    "cli/test_ending.py",
    "cli/test_sim.py",
    "sim/test_serve.py",
    "port/test_closing.py",
    "port/test_diagnose.py",
    "port/test_fork.py",
    "port/test_opening.py",
    "port/test_port.py",
    "port/test_serial.py",
    "port/test_simulated.py",
    "port/test_tcp.py",
]
collect_ignore = [] if sys.platform == "linux" else LINUX_ONLY


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--soak", type=float, default=3.0, help="seconds that tests at true pace run")


@pytest.fixture
def soak(request: pytest.FixtureRequest) -> float:
    """Seconds that tests at true pace run."""
    return float(request.config.getoption("--soak"))
