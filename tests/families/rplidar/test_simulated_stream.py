"""What the simulated device streams, how its streams end, and what turns its motor."""

import struct
from itertools import pairwise

import numpy as np
import pytest

from lidario.sim.world import World
from tests.reference import rplidar
from tests.reference.samples import revolutions
from tests.support import simulated_rplidar as say
from tests.support.simulated_rplidar import MS, SECOND, Bench, begin, conf, express, framed, packets_of

pytestmark = pytest.mark.discards("what the simulated device discards is tested here")


class TestStream:
    @pytest.mark.exhaustive("how", sample=say.ONE_A_FORMAT, full=say.MODES)
    def test_what_is_decoded_is_what_there_is(self, how: tuple[str, int]) -> None:
        model, mode_id = how
        # A smooth world without noise: an angle wrong by 0.1° shows, as does every wrong bit of a distance.
        direction = np.radians((np.arange(32768) + 0.5) * (360.0 / 32768))
        scene = World(3000.0 + 1500.0 * np.sin(direction) + 400.0 * np.cos(3 * direction))
        bench = Bench(model, world=scene)
        mode = bench.mode(mode_id)
        bench.begin(mode)
        stream = bench.run(500 * MS, step=7 * MS)[7:]
        samples = rplidar.decode(mode.format, packets_of(mode.format, stream))
        assert len(samples) > 0.45e9 / (mode.us_q8 / 0.256) * 0.9
        angles = np.array([sample.angle_deg for sample in samples])
        distances = np.array([sample.distance_mm for sample in samples])
        # 47 mm a degree at the steepest; start angles are cut to 1/64°, and 0x84 and 0x86 round distances
        np.testing.assert_allclose(distances, scene.ranges_mm(angles, 0.0), atol=6.0)
        assert np.ptp(angles) > 355.0

    @pytest.mark.parametrize(
        ("model", "mode_id", "samples"),
        [
            ("rplidar-s2", 1, 3200),
            ("rplidar-s2", 0, 1600),
            ("rplidar-s1", 1, 100_000 / 108),
            ("rplidar-hq", 1, 1000),
        ],
    )
    def test_a_turn_takes_what_the_motor_says(self, model: str, mode_id: int, samples: float) -> None:
        bench = Bench(model)
        mode = bench.mode(mode_id)
        for rpm in (600, 750):
            bench.send(framed(0xA8, struct.pack("<H", rpm)))
            bench.run(20 * MS)
            stream = bench.ask(begin(mode), 600 * MS)
            packets = packets_of(mode.format, stream[stream.index(b"\xa5\x5a") + 7 :])
            turns = revolutions(rplidar.decode(mode.format, packets))
            assert len(turns) >= 3
            for turn in turns:
                assert len(turn) == pytest.approx(samples * 600 / rpm, abs=1.5)

    def test_standard_marks_the_first_sample_of_each_turn(self, bench: Bench) -> None:
        packets = packets_of(0x81, bench.ask(say.SCAN, SECOND)[7:])
        marked = [i for i, packet in enumerate(packets) if packet[0] & 1]
        np.testing.assert_allclose(np.diff(marked), 1600, atol=1)
        assert len(marked) >= 9
        for i in marked:
            before, at = rplidar.decode(0x81, packets[i - 1 : i + 1])
            assert before.angle_deg > 359.5
            assert at.angle_deg < 0.5

    @pytest.mark.parametrize("model", ["rplidar-a1", "rplidar-a2", "rplidar-s1"])
    def test_returns_lie_beside_the_beam_where_the_device_triangulates(self, model: str) -> None:
        """As in transcripts of an A1M8: by the correction of 0x84, and a sample without a return is at the beam."""
        direction = np.arange(32768)
        bench = Bench(model, world=World(np.where(direction % 3000 < 900, 0.0, 600.0 + direction / 10)))
        bench.ask(say.DUTY_660)
        stream = bench.ask(say.SCAN, 2 * SECOND)
        beams = [
            sample.angle_deg + rplidar.correction_deg(round(4 * sample.distance_mm))
            if sample.distance_mm and model != "rplidar-s1"
            else sample.angle_deg
            for sample in rplidar.decode(0x81, packets_of(0x81, stream[stream.index(b"\xa5\x5a") + 7 :]))
        ]
        # Angles and what is taken off them are rounded.
        steps = np.diff(np.unwrap(beams, period=360.0))
        assert len(steps) > 1500
        assert np.abs(steps - steps.mean()).max() < 0.2

    @pytest.mark.parametrize(
        ("metres", "least", "most"), [(0.0, 358.6, 360.0), (0.2, 357.0, 359.0), (9.0, 350.6, 352.4)]
    )
    def test_an_a1_marks_the_sample_before_its_beam_passes_0(
        self, metres: float, least: float, most: float
    ) -> None:
        """Over 139 revolutions of a real one marks stood at 351.4 to 359.5 degrees (cpane/heron)."""
        bench = Bench("rplidar-a1", world=World(np.full(32768, 1000.0 * metres)))
        stream = bench.ask(say.SCAN, 2 * SECOND)
        packets = packets_of(0x81, stream[stream.index(b"\xa5\x5a") + 7 :])
        marked = [sample.angle_deg for sample in rplidar.decode(0x81, [each for each in packets if each[0] & 1])]
        assert len(marked) in (13, 14, 15)
        assert least <= min(marked) <= max(marked) <= most

    @pytest.mark.parametrize(("metres", "offset"), [(0.0, 0.0), (0.5, 5.25), (0.2, 1.125), (8.0, 7.875)])
    def test_an_a_model_carries_in_0x82_how_far_returns_lie_behind_the_beam(
        self, metres: float, offset: float
    ) -> None:
        """Of a real A2 that was 7 degrees, and less of what is near (change 4 of Roboticia/RPLidar)."""
        bench = Bench("rplidar-a2", world=World(np.full(32768, 1000.0 * metres)))
        bench.begin(bench.mode(1))
        packets = packets_of(0x82, bench.run(500 * MS, step=7 * MS)[7:])
        carried = {each[8] & 15 | (each[4] & 3) << 4 for each in packets[1:]}
        assert carried == {round(8 * offset)}

    @pytest.mark.parametrize(
        ("model", "mode_id"),
        [("rplidar-s2", 1), ("rplidar-express", 1), ("rplidar-ultra", 2), ("rplidar-ultradense", 1)],
    )
    def test_only_the_first_packet_of_a_stream_is_new(self, model: str, mode_id: int) -> None:
        bench = Bench(model)
        mode = bench.mode(mode_id)
        for _ in range(2):
            packets = packets_of(mode.format, bench.ask(express(mode_id), 400 * MS)[7:])
            new = [rplidar.is_reset(mode.format, packet) for packet in packets]
            assert new == [True] + [False] * (len(packets) - 1)
            bench.ask(say.STOP)

    def test_streams_begin_anywhere(self) -> None:
        starts = set()
        for seed in range(5):
            stream = Bench(seed=seed).ask(say.EXPRESS_1)
            starts.add(rplidar.start_q6(0x85, stream[7:91]))
        assert len(starts) == 5

    def test_the_stream_leaves_at_the_samples_pace(self, bench: Bench) -> None:
        bench.send(say.EXPRESS_1)
        bench.run(1_500_000 + 70_000)  # the descriptor
        # A packet of 40 samples is made 1.25 ms after the first began, and needs 0.84 ms on the line.
        made = 100 * SECOND + 1_500_000 + 1_250_000
        assert bench.device.wakeup(bench.now) == made + 840_000
        assert bench.run(made - bench.now) == b""
        assert len(bench.run(840_000)) == 84
        assert len(bench.run(1_250_000 * 8)) == 84 * 8

    def test_beyond_its_reach_nothing_returns(self) -> None:
        bench = Bench("rplidar-s2", world=World(np.full(32768, 30_500.0)))  # it sees 30 m
        packets = packets_of(0x85, bench.ask(say.EXPRESS_1, 50 * MS)[7:])
        assert not any(sample.distance_mm for sample in rplidar.decode(0x85, packets))
        far = Bench("rplidar-s3", world=World(np.full(32768, 30_500.0)))  # it sees 40 m
        packets = packets_of(0x85, far.ask(say.EXPRESS_1, 50 * MS)[7:])
        assert {sample.distance_mm for sample in rplidar.decode(0x85, packets)} == {30_500.0}


class TestEndOfStream:
    def test_stop_lets_the_packet_under_way_leave_and_no_more(self, bench: Bench) -> None:
        stream = bench.ask(say.EXPRESS_1, 98 * MS)
        stream += bench.ask(say.STOP, SECOND)
        packets = packets_of(0x85, stream[7:])
        assert (len(stream) - 7) % 84 == 0
        assert len(packets) == (98 * MS - 1_500_000) // 1_250_000
        assert not bench.device.scanning
        assert bench.device.motor_on  # as the S series does
        assert bench.device.wakeup(bench.now) is None

    @pytest.mark.parametrize(
        ("request_", "answer"),
        [(say.GET_INFO, 27), (say.GET_HEALTH, 10), (conf(0x70), 13), (framed(0xA8, bytes(2)), 0)],
    )
    def test_every_request_ends_it(self, bench: Bench, request_: bytes, answer: int) -> None:
        bench.ask(say.EXPRESS_1, 100 * MS)
        after = bench.ask(request_, SECOND)
        assert not bench.device.scanning
        assert bench.device.motor_on is (answer > 0)  # but for the speed 0
        assert bench.device.log[-1].obeyed
        assert len(after) % 84 < answer + 84
        assert (len(after) - answer) < 3 * 84
        assert bench.run(SECOND) == b""

    @pytest.mark.long
    @pytest.mark.parametrize("model", ["rplidar-s2", "rplidar-hq"])
    def test_a_speed_does_not_and_the_head_changes_to_it(self, model: str) -> None:
        bench = Bench(model)
        mode = bench.mode(1)
        stream = bench.ask(begin(mode), 400 * MS)
        stream += bench.ask(framed(0xA8, struct.pack("<H", 900)), 4 * SECOND)
        samples = rplidar.decode(mode.format, packets_of(mode.format, stream[7:]))
        turns = revolutions(samples)
        assert len(turns[0]) == pytest.approx(1.5 * len(turns[-1]), rel=0.01)
        # It turns faster each time, and nowhere jumps.
        assert all(len(turn) <= len(before) + 2 for before, turn in pairwise(turns))
        steps = np.diff(np.unwrap(np.radians([sample.angle_deg for sample in samples[:: len(turns[-1]) // 24]])))
        assert 0.16 < steps.min() <= steps.max() < 0.27
        assert bench.device.scanning

    @pytest.mark.parametrize("noise", [b"\x25", b"\xa5\x33", say.EXPRESS_1[:-1] + b"\x00"])
    def test_noise_does_not(self, bench: Bench, noise: bytes) -> None:
        bench.ask(say.EXPRESS_1, 100 * MS)
        bench.ask(noise)
        assert bench.device.scanning

    def test_reset_ends_it_in_the_middle_of_a_packet(self, bench: Bench) -> None:
        bench.send(say.EXPRESS_1)
        out = bench.run(1_500_000 + 1_250_000 * 5 + 400_000)  # 40 bytes into the fifth packet
        assert (len(out) - 7) % 84 == 40
        bench.send(say.RESET)
        assert bench.run(5 * SECOND) == b""
        assert not bench.device.scanning
        assert not bench.device.motor_on

    @pytest.mark.parametrize(
        ("model", "told"),
        [
            # As users read them: thijses/rplidar and cpane/heron, who count 64 bytes; a diary on a ROSbot.
            ("rplidar-a1", "Firmware Ver 1.29 - rtm, HW Ver 7\r\nModel: 18"),
            ("rplidar-a2", "Firmware Ver 1.32 - rtm, HW Ver 6\r\nModel: 2c"),
            ("rplidar-a2-empty-list", "Firmware Ver 1.27 - rc9, HW Ver 5\r\nModel: 26"),
            ("rplidar-old-firmware", "Firmware Ver 1.20 - rtm, HW Ver 5\r\nModel: 18"),
        ],
    )
    def test_an_a_model_prints_a_banner_when_it_has_booted(self, model: str, told: str) -> None:
        bench = Bench(model)
        bench.send(say.RESET)
        assert bench.run(600 * MS) == b""
        banner = bench.run(100 * MS)
        assert banner.decode("ascii") == f"RP LIDAR System.\r\n{told}\r\n"
        assert len(banner) == 64


class TestMotor:
    @pytest.mark.parametrize(("rpm", "actual"), [(600, 600), (480, 480), (300, 480), (2000, 1200)])
    def test_speed_is_clamped_to_what_it_can_do(self, bench: Bench, rpm: int, actual: int) -> None:
        bench.send(framed(0xA8, struct.pack("<H", rpm)))
        assert bench.device.motor.target_rpm == actual

    def test_samples_are_withheld_until_it_is_stable(self) -> None:
        bench = Bench(spin_up_s=1.0)
        assert len(bench.ask(say.EXPRESS_1, 1000 * MS)) == 7
        assert bench.device.scanning
        assert len(bench.run(100 * MS)) > 5000

    def test_after_force_scan_they_are_not(self) -> None:
        bench = Bench(spin_up_s=1.0)
        packets = packets_of(0x81, bench.ask(say.FORCE_SCAN, 500 * MS)[7:])
        assert len(packets) > 7900
        turned = sum(packet[0] & 1 for packet in packets)
        assert 1 <= turned <= 4  # of five at full speed

    @pytest.mark.parametrize(
        "model", ["rplidar-old-firmware", "rplidar-a1", "rplidar-a2-no-board", "rplidar-c1-fixed"]
    )
    def test_a_motor_that_runs_by_itself_takes_no_command(self, model: str) -> None:
        bench = Bench(model)
        assert bench.device.motor_on
        for request in (say.MOTOR_OFF, say.DUTY_0, say.BOARD):
            assert bench.ask(request) == b""
            assert bench.why == "unknown to this device"
        assert bench.device.motor_on


class TestBoard:
    """A2 and A3: the motor hangs on an accessory board."""

    def test_it_tells_that_it_is_there(self) -> None:
        assert Bench("rplidar-a3").ask(say.BOARD) == bytes.fromhex("a55a04000000ff 01000000")
        bench = Bench("rplidar-s2")
        assert bench.ask(say.BOARD) == b""
        assert bench.why == "unknown to this device"

    def test_there_is_no_packet_before_the_duty_was_set_by_the_one_request_that_it_obeys(self) -> None:
        bench = Bench("rplidar-a2")
        bench.send(say.MOTOR_600)
        assert bench.why == "unknown to this device"
        assert len(bench.ask(express(3), 5 * SECOND)) == 7
        states = [bench.device.scanning]
        bench.ask(say.STOP)
        assert [*states, bench.device.scanning] == [True, False]
        bench.send(say.DUTY_660)
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
        bench.ask(say.EXPRESS_1, 100 * MS)
        bench.device.set_dtr(True, bench.now)
        assert bench.device.motor_on
        assert len(bench.run(100 * MS)) > 5_000
