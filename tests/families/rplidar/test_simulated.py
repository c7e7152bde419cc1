"""The simulated device, in driven time: what it discards, and the states in which it can be found."""

from __future__ import annotations

import pytest

from lidario.families.rplidar import FAMILY
from lidario.families.rplidar.simulated.device import PROFILES, make_simulated
from tests.support.simulated_rplidar import (
    EXPRESS_1,
    FORCE_SCAN,
    GET_HEALTH,
    GET_INFO,
    MOTOR_600,
    MS,
    RESET,
    SCAN,
    SECOND,
    STOP,
    Bench,
    conf,
    express,
    framed,
)

pytestmark = pytest.mark.discards("what the simulated device discards is tested here")


class TestOneRequestAtATime:
    """While a request is unanswered, further ones are discarded, and nothing tells the host (manual)."""

    @pytest.mark.parametrize("second", [GET_HEALTH, STOP, RESET, SCAN])
    @pytest.mark.parametrize(
        ("first", "name"),
        [(GET_INFO, "get_info"), (conf(0x7F, 1), "get_lidar_conf"), (SCAN, "scan"), (express(1), "express_scan")],
    )
    def test_a_request_before_the_response_has_left_is_discarded(
        self, bench: Bench, first: bytes, name: str, second: bytes
    ) -> None:
        bench.send(first)
        whole = bench.device.wakeup(bench.now)
        assert whole is not None
        bench.run(whole - bench.now - 1)
        bench.send(second)
        assert not bench.device.log[-1].obeyed
        assert bench.why == f"while the response to {name} is outstanding"
        assert bench.device.scanning is ("scan" in name)
        bench.run(1)
        bench.send(second)
        assert bench.device.log[-1].obeyed


def begin_to_scan(bench: Bench) -> None:
    """A scan whose motor still speeds up, so that no packet comes yet."""
    bench.device.spin_up_s = 1.0
    bench.send(SCAN)
    bench.run(50 * MS)
    assert bench.device.scanning


class TestDiscarding:
    @pytest.mark.parametrize(("wait", "heard"), [(0, False), (10 * MS - 1, False), (10 * MS, True)])
    def test_too_soon_after_stop(self, bench: Bench, wait: int, heard: bool) -> None:
        begin_to_scan(bench)
        bench.send(STOP)
        bench.run(wait)
        assert len(bench.ask(GET_INFO)) == (27 if heard else 0)
        assert bench.device.log[-1].obeyed is heard
        assert bench.why == ("" if heard else "within 10 ms of stop")

    @pytest.mark.parametrize(("wait", "remark"), [(5, "within 10 ms of a stop that was ignored"), (10, "")])
    def test_a_stop_in_idle_is_ignored(self, bench: Bench, wait: int, remark: str) -> None:
        bench.send(STOP)
        bench.run(wait * MS)
        assert len(bench.ask(GET_INFO)) == 27
        assert bench.device.log[-1].remark == remark

    def test_its_first_byte_counts(self, bench: Bench) -> None:
        begin_to_scan(bench)
        bench.send(STOP)
        bench.run(9 * MS)
        bench.send(GET_INFO[:1])
        bench.run(9 * MS)
        assert bench.ask(GET_INFO[1:]) == b""
        assert bench.why == "within 10 ms of stop"

    @pytest.mark.parametrize(
        ("model", "boot_s", "silence", "why"),
        [
            ("rplidar-s2", None, 600 * MS, "still booting after reset"),
            ("rplidar-s1", None, 2 * SECOND, "still booting after reset"),
            ("rplidar-s2", 0.0, 500 * MS, "within 500 ms of reset"),
        ],
    )
    def test_too_soon_after_reset(self, model: str, boot_s: float | None, silence: int, why: str) -> None:
        """However fast it boots, half a second."""
        bench = Bench(model)
        bench.device.boot_s = bench.device.boot_s if boot_s is None else boot_s
        bench.send(RESET)
        bench.run(silence - 1)
        assert bench.ask(GET_INFO, 0) == b""
        assert bench.why == why
        bench.run(1)
        assert len(bench.ask(GET_INFO)) == 27

    def test_incomplete_after_five_seconds(self, bench: Bench) -> None:
        bench.send(EXPRESS_1[:4])
        bench.run(5 * SECOND)
        assert bench.device.log == []
        bench.run(1)
        assert bench.device.log[0].data == EXPRESS_1[:4]
        assert bench.device.log[0].name == "express_scan"
        assert bench.why == "not complete within 5 s"
        assert bench.device.log[0].at_ns == 100 * SECOND
        assert len(bench.ask(GET_INFO)) == 27

    @pytest.mark.parametrize(
        ("request_", "why"),
        [
            (EXPRESS_1[:-1] + b"\x22", "wrong checksum"),
            *((each, "unknown to this device") for each in (b"\xa5\x33", framed(0x99, b"xy"), b"\xa5\x90\x00\x35")),
            (framed(0x82, b"\x01"), "payload of 1 bytes"),
            (framed(0x84, b"\x70"), "payload of 1 bytes"),
            (express(9), "no scan mode 9"),
        ],
    )
    def test_what_cannot_be_obeyed(self, bench: Bench, request_: bytes, why: str) -> None:
        assert bench.ask(request_, SECOND) == b""
        assert (bench.device.log[-1].data, bench.why) == (request_, why)
        assert not bench.device.scanning

    @pytest.mark.parametrize("request_", [GET_INFO, EXPRESS_1, conf(0x71, 1), MOTOR_600])
    def test_chunks_make_no_difference(self, request_: bytes) -> None:
        whole, pieces = Bench(), Bench()
        for byte in request_[:-1]:
            pieces.send(bytes([byte]))
        assert pieces.ask(request_[-1:]) == whole.ask(request_)
        assert pieces.device.log == whole.device.log
        assert whole.device.log[0].obeyed


class TestProtectionStop:
    def test_scans_are_refused_and_stop_is_ignored(self, bench: Bench) -> None:
        bench.device.protection_stop(7)
        for request in (SCAN, FORCE_SCAN, EXPRESS_1):
            assert bench.ask(request, SECOND) == b""
            assert bench.why == "in protection stop"
        bench.send(STOP)
        assert bench.why == "in protection stop"
        # So no pause follows it.
        assert bench.ask(GET_HEALTH)[7:] == b"\x02\x07\x00"


def test_a_line_counts_as_quiet_only_after_the_slowest_packets() -> None:
    """An adapter may hold bytes for 16 ms more."""
    slowest = max(mode.period_ns for profile in PROFILES.values() for mode in profile.modes)
    assert slowest > 19 * MS
    assert slowest + 16 * MS < FAMILY.timing.quiet_s * SECOND < 60 * MS


def test_an_overloaded_line_is_refused() -> None:
    s2 = PROFILES["rplidar-s2"]
    with pytest.raises(ValueError, match="cannot carry"):
        type(s2)("too-slow", 0x71, 115_200, s2.modes, typical=1)


def test_an_unknown_model_names_those_there_are() -> None:
    with pytest.raises(ValueError, match=r"no simulated device .*'rplidar-s9'.*rplidar-s2.*rplidar-old-firmware"):
        make_simulated("rplidar-s9")
