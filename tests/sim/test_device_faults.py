"""Faults of the device, in driven time, in both families: what happens, in whatever steps of time."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest

from lidario.families.rplidar.simulated.device import make_simulated as make_first
from lidario.families.ydlidar.simulated.device import make_simulated as make_second
from lidario.sim.faults import ERROR_CODE, parse_faults
from lidario.sim.memory import MemoryLine

pytestmark = pytest.mark.discards("a device that boots or is frozen discards requests, which is tested here")

MS = 1_000_000
SECOND = 1_000 * MS
BEGIN = 100 * SECOND

# Family, model, scan, info, health, reset.
MAKERS: dict[str, tuple[Callable[..., Any], str, bytes, bytes, bytes, bytes]] = {
    "rplidar": (make_first, "rplidar-s2", b"\xa5\x20", b"\xa5\x50", b"\xa5\x52", b"\xa5\x40"),
    "ydlidar": (make_second, "ydlidar-4ros", b"\xa5\x60", b"\xa5\x90", b"\xa5\x91", b"\xa5\x80"),
}
both = pytest.mark.parametrize("family", MAKERS)


class Bench:
    """A device behind a line with faults; it begins to scan at once."""

    def __init__(self, family: str, faults: str, *, seed: int = 0, scan: bool = True) -> None:
        make, model, self.scan, self.info, self.health, self.reset = MAKERS[family]
        self.device = make(model)
        self.device.spin_up_s = 0.0
        self.line = MemoryLine(self.device, parse_faults(faults, seed=seed))
        if scan:
            self.line.write(self.scan, BEGIN)

    def ask(self, request: bytes, at: int) -> bytes:
        self.line.read(at)
        self.line.write(request, at)
        return self.line.read(at + 20 * MS)

    def status(self, at: int) -> tuple[int, int]:
        """Status and error code, as health reports them."""
        response = self.ask(self.health, at)
        assert len(response) == 10
        return response[7], int.from_bytes(response[8:], "little")


@both
@pytest.mark.parametrize("fault", ["reboot:1s", "freeze:1s", "protect:1s", "wrong-response:50%,reboot:1s"])
@pytest.mark.parametrize("step", [7 * MS + 1, 333 * MS])
def test_the_steps_of_time_make_no_difference(family: str, fault: str, step: int) -> None:
    whole, pieces = Bench(family, fault), Bench(family, fault)
    data, now = b"", BEGIN
    while now < BEGIN + 3 * SECOND:
        now = min(now + step, BEGIN + 3 * SECOND)
        data += pieces.line.read(now)
    expected = whole.line.read(BEGIN + 3 * SECOND)
    assert expected == data
    assert len(data) > 40_000
    assert not whole.device.scanning


@both
@pytest.mark.parametrize("cured", [True, False])
def test_protect_stops_it_in_mid_scan_until_a_reset_cures_it_or_does_not(family: str, cured: bool) -> None:
    bench = Bench(family, "protect:1s")
    bench.device.faults_cleared_by_reset = cured
    assert bench.line.read(BEGIN + 990 * MS)
    assert bench.line.wakeup(BEGIN + 990 * MS) is not None
    bench.line.read(BEGIN + SECOND + 20 * MS)
    assert bench.line.read(BEGIN + 5 * SECOND) == b""
    assert bench.line.wakeup(BEGIN + 5 * SECOND) is None
    assert bench.status(BEGIN + 5 * SECOND) == (2, ERROR_CODE)
    assert bench.ask(bench.scan, BEGIN + 6 * SECOND) == b""
    assert bench.device.log[-1].why == "in protection stop"
    assert (bench.device.scanning, bench.device.motor_on) == (False, False)
    bench.line.write(bench.reset, BEGIN + 7 * SECOND)
    bench.line.read(BEGIN + 9 * SECOND)
    assert bench.status(BEGIN + 9 * SECOND) == ((0, 0) if cured else (2, ERROR_CODE))
    assert bool(bench.ask(bench.scan, BEGIN + 10 * SECOND)) is cured


@both
def test_reboot_cuts_the_stream_and_obeys_nothing_until_it_has_booted(family: str) -> None:
    bench = Bench(family, "reboot:1s")
    bench.device.boot_s = 0.8
    assert len(bench.line.read(BEGIN + SECOND)) > 40_000
    assert not bench.device.scanning
    assert bench.ask(bench.info, BEGIN + SECOND + 700 * MS) == b""
    assert bench.device.log[-1].why == "still booting"
    bench.line.read(BEGIN + SECOND + 850 * MS)
    assert len(bench.ask(bench.info, BEGIN + SECOND + 900 * MS)) == 27
    assert bench.status(BEGIN + 2 * SECOND) == (0, 0)
    assert bench.ask(bench.scan, BEGIN + 3 * SECOND)


def test_reboot_forgets_protection_and_speed() -> None:
    bench = Bench("ydlidar", "reboot:1s", scan=False)
    bench.ask(b"\xa5\xd9", BEGIN)
    bench.ask(b"\xa5\x0b", BEGIN + SECOND // 2)
    assert (bench.device.protected, bench.device.set_speed) == (True, 800)
    bench.line.read(BEGIN + 3 * SECOND)
    assert (bench.device.protected, bench.device.set_speed) == (False, 700)


@both
def test_freeze_lasts_until_the_power_is_gone(family: str) -> None:
    bench = Bench(family, "freeze:1s,replug:10s")
    assert len(bench.line.read(BEGIN + SECOND)) > 40_000
    for at in (1, 2, 9):
        for request in (bench.info, b"\xa5\x40", b"\xa5\x80", b"\xa5\x25", b"\xa5\x65"):
            assert bench.ask(request, BEGIN + at * SECOND) == b""
            assert bench.device.log[-1].why == "frozen"
    bench.line.read(BEGIN + 14 * SECOND)
    assert len(bench.ask(bench.info, BEGIN + 14 * SECOND)) == 27


@both
def test_replug_takes_the_power_for_a_second_and_then_it_boots(family: str) -> None:
    bench = Bench(family, "replug:1s")
    bench.device.boot_s = 0.5
    bench.line.read(BEGIN + 2 * SECOND)
    assert not bench.device.scanning
    assert bench.ask(bench.info, BEGIN + 2 * SECOND + 400 * MS) == b""
    bench.line.read(BEGIN + 3 * SECOND)
    assert len(bench.ask(bench.info, BEGIN + 3 * SECOND)) == 27


@both
def test_what_nobody_has_read_when_the_cable_is_pulled_is_lost(family: str) -> None:
    bench = Bench(family, "replug:1s")
    bench.device.boot_s = 600.0
    assert bench.line.read(BEGIN + 900 * MS)
    assert bench.line.read(BEGIN + 5 * SECOND) == b""


@both
def test_a_garbled_response_is_as_long_and_the_next_one_is_right(family: str) -> None:
    bench = Bench(family, "", scan=False)
    good = bench.ask(bench.info, BEGIN)
    bench.device.garble_responses = 1
    bad = bench.ask(bench.info, BEGIN + SECOND)
    assert len(bad) == len(good) == 27
    assert bad != good
    assert bench.ask(bench.info, BEGIN + 2 * SECOND) == good


@both
def test_mute_it_hears_and_obeys_but_what_it_says_is_lost(family: str) -> None:
    bench = Bench(family, "", scan=False)
    bench.device.mute = True
    assert bench.ask(bench.info, BEGIN) == b""
    assert bench.ask(bench.scan, BEGIN + SECOND) == b""
    assert bench.line.read(BEGIN + 2 * SECOND) == b""
    assert bench.device.scanning
    bench.device.mute = False
    assert 0 < len(bench.line.read(BEGIN + 3 * SECOND)) < 100_000


@both
def test_a_wrong_answer_is_the_one_before(family: str) -> None:
    bench = Bench(family, "wrong-response:100%", scan=False)
    info = bench.ask(bench.info, BEGIN)
    assert len(info) == 27  # there was none before
    assert bench.ask(bench.health, BEGIN + SECOND) == info
    assert len(bench.ask(bench.info, BEGIN + 2 * SECOND)) == 10
