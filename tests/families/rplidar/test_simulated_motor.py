"""What turns the motor of the simulated device."""

from __future__ import annotations

import struct

import pytest

from tests.support.simulated_rplidar import (
    BOARD,
    DUTY_0,
    DUTY_660,
    EXPRESS_1,
    FORCE_SCAN,
    MOTOR_600,
    MOTOR_OFF,
    MS,
    SECOND,
    STOP,
    Bench,
    express,
    framed,
    packets_of,
)

pytestmark = pytest.mark.discards("what the simulated device discards is tested here")


class TestMotor:
    @pytest.mark.parametrize(("rpm", "actual"), [(600, 600), (480, 480), (300, 480), (2000, 1200)])
    def test_speed_is_clamped_to_what_it_can_do(self, bench: Bench, rpm: int, actual: int) -> None:
        bench.send(framed(0xA8, struct.pack("<H", rpm)))
        assert bench.device.motor.target_rpm == actual

    def test_samples_are_withheld_until_it_is_stable(self) -> None:
        bench = Bench(spin_up_s=1.0)
        assert len(bench.ask(EXPRESS_1, 1000 * MS)) == 7
        assert bench.device.scanning
        assert len(bench.run(100 * MS)) > 5000

    def test_after_force_scan_they_are_not(self) -> None:
        bench = Bench(spin_up_s=1.0)
        packets = packets_of(0x81, bench.ask(FORCE_SCAN, 500 * MS)[7:])
        assert len(packets) > 7900
        turned = sum(packet[0] & 1 for packet in packets)
        assert 1 <= turned <= 4  # of five at full speed

    @pytest.mark.parametrize(
        "model", ["rplidar-old-firmware", "rplidar-a1", "rplidar-a2-no-board", "rplidar-c1-fixed"]
    )
    def test_a_motor_that_runs_by_itself_takes_no_command(self, model: str) -> None:
        bench = Bench(model)
        assert bench.device.motor_on
        for request in (MOTOR_OFF, DUTY_0, BOARD):
            assert bench.ask(request) == b""
            assert bench.why == "unknown to this device"
        assert bench.device.motor_on


class TestBoard:
    """A2 and A3: the motor hangs on an accessory board."""

    def test_it_tells_that_it_is_there(self) -> None:
        assert Bench("rplidar-a3").ask(BOARD) == bytes.fromhex("a55a04000000ff 01000000")
        bench = Bench("rplidar-s2")
        assert bench.ask(BOARD) == b""
        assert bench.why == "unknown to this device"

    def test_there_is_no_packet_before_the_duty_was_set_by_the_one_request_that_it_obeys(self) -> None:
        bench = Bench("rplidar-a2")
        bench.send(MOTOR_600)
        assert bench.why == "unknown to this device"
        assert len(bench.ask(express(3), 5 * SECOND)) == 7
        states = [bench.device.scanning]
        bench.ask(STOP)
        assert [*states, bench.device.scanning] == [True, False]
        bench.send(DUTY_660)
        assert bench.device.motor.target_rpm == 600
        assert len(bench.ask(express(3), SECOND)) > 20_000

    @pytest.mark.parametrize(("duty", "rpm"), [(0, 0), (330, 300), (2000, 600 * 1023 / 660)])
    def test_the_speed_follows_from_the_duty(self, duty: int, rpm: float) -> None:
        bench = Bench("rplidar-a2")
        bench.send(framed(0xF0, struct.pack("<H", duty)))
        assert bench.device.motor.target_rpm == pytest.approx(rpm)


class TestControlLine:
    """A1: DTR is the switch of the motor."""

    def test_a_stream_pauses_while_it_is_asserted(self) -> None:
        bench = Bench("rplidar-a1")
        bench.ask(express(3), SECOND)
        bench.device.set_dtr(True, bench.now)
        bench.run(50 * MS)
        assert bench.run(SECOND) == b""
        assert bench.device.scanning
        bench.device.set_dtr(False, bench.now)
        assert len(bench.run(SECOND)) > 9_000

    def test_to_the_others_it_means_nothing(self) -> None:
        bench = Bench("rplidar-s2")
        bench.ask(EXPRESS_1, 100 * MS)
        bench.device.set_dtr(True, bench.now)
        assert bench.device.motor_on
        assert len(bench.run(100 * MS)) > 5_000
