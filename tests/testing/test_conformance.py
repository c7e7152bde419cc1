"""The rules in a user's run of pytest: green with the simulated lidar, red and clear with one that breaks them."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from lidario.conformance import RULES, Rule, rule_named
from lidario.testing import SimulatedLidar
from lidario.testing.conformance import opened
from tests.support.inner import ASYNCIO_INI, STRICT_INI, run_pytest

SUITE = ("--pyargs", "lidario.testing.conformance")


@pytest.mark.long
@pytest.mark.parametrize(("ini", "options"), [(STRICT_INI, ("-p", "no:asyncio")), (ASYNCIO_INI, ())])
def test_the_simulated_lidar_keeps_every_rule(tmp_path: Path, ini: str, options: tuple[str, ...]) -> None:
    (tmp_path / "pytest.ini").write_text(ini, encoding="utf-8")
    ran = run_pytest(tmp_path, *options, *SUITE)
    assert ran.code == 0, ran.text
    assert ran.outcomes == {"passed": len(RULES) - 3, "skipped": 3}
    assert "sample-time: held: Standard told 62.50 us, measured 62." in ran.text
    assert "power-down protection" in ran.text


@pytest.mark.long
def test_what_is_no_device_says_so(tmp_path: Path) -> None:
    (tmp_path / "pytest.ini").write_text(STRICT_INI, encoding="utf-8")
    ran = run_pytest(tmp_path, "-p", "no:asyncio", *SUITE, "--lidario-device", "corridor.mcap")
    assert ran.outcomes == {"error": len(RULES)}
    assert "rules are tried on a device" in ran.text


@pytest.fixture
def wrong() -> Iterator[tuple[SimulatedLidar, Callable[[Rule], None]]]:
    """A device that tells twice the time of a sample."""
    lidar = SimulatedLidar("rplidar-wrong-us")
    with opened(lidar) as check:
        yield lidar, check
    assert lidar.is_still
    lidar.close()


@pytest.mark.long
def test_a_rule_that_is_not_held_is_told_in_words(wrong: tuple[SimulatedLidar, Callable[[Rule], None]]) -> None:
    lidar, check = wrong
    with pytest.raises(pytest.fail.Exception) as failed:
        check(rule_named("sample-time"))
    lines = str(failed.value).splitlines()
    assert lines[0] == "A sample takes the time that the device tells."
    assert "told 62.50 us, measured 31." in lines[1]
    assert lines[2].startswith("known from: manual, ")
    assert lidar.is_still
    check(rule_named("turns-clockwise"))
    with pytest.raises(pytest.skip.Exception, match="power-down protection"):
        check(rule_named("protection-stops"))
