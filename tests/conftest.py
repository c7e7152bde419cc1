"""Hypothesis runs the same examples every time and takes the time it needs; ``--soak`` lengthens the slow tests."""

import pytest
from hypothesis import HealthCheck, settings

settings.register_profile(
    "ci",
    deadline=None,
    derandomize=True,
    max_examples=60,
    suppress_health_check=[HealthCheck.too_slow, HealthCheck.data_too_large],
)
settings.load_profile("ci")


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--soak", type=float, default=3.0, help="seconds that tests at true pace run")


@pytest.fixture
def soak(request: pytest.FixtureRequest) -> float:
    """Seconds that tests at true pace run."""
    return float(request.config.getoption("--soak"))
