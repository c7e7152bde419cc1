"""The simulated device, in driven time: what it answers, what it discards, and what it streams."""

from __future__ import annotations

import struct
from functools import reduce
from operator import xor

import numpy as np
import pytest

from lidario.families.rplidar import FAMILY
from lidario.families.rplidar.simulated.device import PROFILES, Mode, Profile, SimulatedRplidar, make_simulated
from lidario.sim.rooms import make_world
from lidario.sim.world import World
from tests.reference import rplidar

pytestmark = pytest.mark.discards("what the simulated device discards is tested here")

MS = 1_000_000
SECOND = 1_000 * MS
STOP, RESET, SCAN, FORCE_SCAN = b"\xa5\x25", b"\xa5\x40", b"\xa5\x20", b"\xa5\x21"
GET_INFO, GET_HEALTH, GET_SAMPLERATE = b"\xa5\x50", b"\xa5\x52", b"\xa5\x59"
MOTOR_600 = bytes.fromhex("a5 a8 02 58 02 55")
MOTOR_OFF = bytes.fromhex("a5 a8 02 00 00 0f")
BOARD = bytes.fromhex("a5 ff 04 00 00 00 00 5e")
DUTY_660, DUTY_0 = bytes.fromhex("a5 f0 02 94 02 c1"), bytes.fromhex("a5 f0 02 00 00 57")
EXPRESS_1 = bytes.fromhex("a5 82 05 01 00 00 00 00 23")

SOLD = [profile.name for profile in PROFILES.values() if profile.kind == "sold"]
MODES = [(profile.name, mode.id) for profile in PROFILES.values() for mode in profile.modes]
ONE_A_FORMAT = list(
    {mode.format: (profile.name, mode.id) for profile in PROFILES.values() for mode in profile.modes}.values()
)


def framed(command: int, payload: bytes) -> bytes:
    body = bytes([0xA5, command, len(payload)]) + payload
    return body + bytes([reduce(xor, body)])


def express(mode_id: int) -> bytes:
    return framed(0x82, bytes([mode_id, 0, 0, 0, 0]))


def begin(mode: Mode) -> bytes:
    """What starts a mode: SCAN the plain one, since 0 is the legacy express scan for EXPRESS_SCAN."""
    return SCAN if mode.response_type == 0x81 else express(mode.id)


def conf(kind: int, *mode: int) -> bytes:
    return framed(0x84, struct.pack("<I", kind) + b"".join(struct.pack("<H", m) for m in mode))


class Bench:
    """A device and the time, which begins at 100 s; the motor needs no time unless a test says so."""

    def __init__(
        self, model: str = "rplidar-s2", *, world: World | None = None, spin_up_s: float = 0.0, seed: int = 0
    ) -> None:
        self.device = make_simulated(model, world=world or make_world("circle"), seed=seed)
        self.device.spin_up_s = spin_up_s
        self.now = 100 * SECOND

    def send(self, data: bytes) -> None:
        self.device.receive(data, self.now)

    def run(self, ns: int, step: int = 0) -> bytes:
        """Let time pass, and collect what the device sends meanwhile."""
        end, out = self.now + ns, b""
        while step and self.now + step < end:
            self.now += step
            out += self.device.transmit(self.now)
        self.now = end
        return out + self.device.transmit(end)

    def ask(self, data: bytes, within: int = 20 * MS) -> bytes:
        self.send(data)
        return self.run(within)

    def begin(self, mode: Mode) -> None:
        """Start a mode, with the motor first where nothing else starts it."""
        if self.device.profile.motor == "pwm":
            self.send(DUTY_660)
        self.send(begin(mode))

    @property
    def why(self) -> str:
        return self.device.log[-1].why


@pytest.fixture
def bench() -> Bench:
    return Bench()


def packets_of(kind: int, stream: bytes) -> list[bytes]:
    """The whole packets of a stream that begins at a packet; the reference refuses damaged ones."""
    return rplidar.split(kind, stream[: len(stream) // rplidar.PACKET_BYTES[kind] * rplidar.PACKET_BYTES[kind]])


class TestOneRequestAtATime:
    """While a request is unanswered, further ones are discarded, and nothing tells the host (manual)."""

    @pytest.mark.parametrize("second", [GET_HEALTH, STOP, RESET, SCAN])
    @pytest.mark.parametrize(
        ("first", "name"),
        [
            (GET_INFO, "get_info"),
            (conf(0x7F, 1), "get_lidar_conf"),
            (SCAN, "scan"),
            (express(1), "express_scan"),
        ],
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

    def test_two_requests_in_one_piece_lose_the_second(self, bench: Bench) -> None:
        assert len(bench.ask(GET_INFO + GET_HEALTH)) == 27
        assert [each.obeyed for each in bench.device.log] == [True, False]

    def test_a_stream_is_not_a_response_that_is_waited_for(self, bench: Bench) -> None:
        bench.ask(SCAN, SECOND)
        bench.ask(GET_INFO)
        bench.ask(STOP)
        assert all(each.obeyed for each in bench.device.log)

    def test_requests_without_a_response_leave_nothing_to_wait_for(self, bench: Bench) -> None:
        bench.send(framed(0xA8, struct.pack("<H", 600)) + GET_INFO)
        assert all(each.obeyed for each in bench.device.log)

    def test_a_late_response_counts_until_it_has_left(self, bench: Bench) -> None:
        bench.device.response_delay_s = 3.0
        bench.ask(GET_INFO, SECOND)
        bench.ask(GET_INFO, 2 * SECOND)
        assert bench.why == "while the response to get_info is outstanding"
        bench.run(MS)
        bench.send(STOP)
        assert bench.device.log[-1].obeyed

    def test_a_reset_forgets_what_was_asked(self, bench: Bench) -> None:
        bench.ask(RESET, 10 * SECOND)
        assert len(bench.ask(GET_INFO)) == 27


class TestAnswers:
    def test_info(self) -> None:
        device = make_simulated("rplidar-s2", serial=bytes(range(16)))
        device.receive(GET_INFO, 0)
        answer = device.transmit(SECOND)
        assert answer == bytes.fromhex("a55a1400000004 71 02 01 12") + bytes(range(16))

    @pytest.mark.parametrize(
        ("model", "major"),
        [
            *(("rplidar-s1", 6), ("rplidar-s2", 7), ("rplidar-s3", 8), ("rplidar-old-firmware", 1)),
            *(("rplidar-a1", 1), ("rplidar-a2", 2), ("rplidar-a3", 3), ("rplidar-c1", 4), ("rplidar-t1", 9)),
        ],
    )
    def test_model_byte(self, model: str, major: int) -> None:
        assert Bench(model).ask(GET_INFO)[7] >> 4 == major

    def test_two_devices_differ_and_one_seed_is_one_device(self) -> None:
        serials = [make_simulated("rplidar-s2", seed=seed).serial for seed in (1, 2, 1)]
        assert serials[0] != serials[1]
        assert serials[0] == serials[2]

    def test_health(self, bench: Bench) -> None:
        assert bench.ask(GET_HEALTH) == bytes.fromhex("a55a0300000006 00 0000")
        bench.device.health = (1, 0x1234)
        assert bench.ask(GET_HEALTH) == bytes.fromhex("a55a0300000006 01 3412")

    def test_sample_rate(self, bench: Bench) -> None:
        assert bench.ask(GET_SAMPLERATE) == bytes.fromhex("a55a0400000015 3e00 1f00")  # 62 and 31 µs
        assert Bench("rplidar-old-firmware").ask(GET_SAMPLERATE)[7:] == struct.pack("<HH", 500, 250)

    @pytest.mark.parametrize(
        ("kind", "mode", "value"),
        [
            (0x70, (), struct.pack("<H", 2)),
            (0x7C, (), struct.pack("<H", 1)),
            (0x71, (1,), struct.pack("<I", 8000)),  # 31.25 µs
            (0x71, (0,), struct.pack("<I", 16000)),
            (0x74, (1,), struct.pack("<I", 30 * 256)),
            (0x75, (0,), b"\x81"),
            (0x75, (1,), b"\x85"),
            (0x7F, (0,), b"Standard\0"),
            (0x7F, (1,), b"DenseBoost\0"),
            (0x01, (), struct.pack("<HH", 600, 0)),
            (0x04, (), struct.pack("<H", 480)),
            (0x05, (), struct.pack("<H", 1200)),
            (0x71, (7,), b""),  # no such mode
            (0x71, (), b""),  # no mode given
        ],
    )
    def test_conf(self, bench: Bench, kind: int, mode: tuple[int, ...], value: bytes) -> None:
        answer = bench.ask(conf(kind, *mode))
        assert answer == b"\xa5\x5a" + struct.pack("<IBI", 4 + len(value), 0x20, kind) + value

    @pytest.mark.parametrize(
        ("model", "kind", "value"),
        [
            *(
                (model, kind, value)
                for model in SOLD
                if model[8] in "st"
                for kind, value in ((0x01, "5802 0000"), (0x04, "e001"), (0x05, "b004"))
            ),
            *(("rplidar-c1", 0x01, "5802 0000"), ("rplidar-c1", 0x04, "e001"), ("rplidar-c1", 0x05, "d002")),
            *((model, 0x01, "5802 9402") for model in ("rplidar-a1", "rplidar-a2", "rplidar-a3")),
        ],
    )
    def test_devices_that_are_sold_tell_their_speeds(self, model: str, kind: int, value: str) -> None:
        """The vendor's driver takes a response without a value for one with a value, and crashes."""
        assert Bench(model).ask(conf(kind))[11:] == bytes.fromhex(value)

    @pytest.mark.parametrize(
        ("model", "kind"), [("rplidar-s2", 0x79), ("rplidar-s1", 0x81), ("rplidar-holes", 0x01)]
    )
    def test_a_conf_type_that_the_firmware_does_not_know(self, model: str, kind: int) -> None:
        """Silence: the vendor's driver takes any response to 0x79 for the sign of an Ethernet device."""
        bench = Bench(model)
        bench.ask(SCAN, 100 * MS)
        assert bytes.fromhex("0000 0020") not in bench.ask(conf(kind))
        assert bench.why == "unknown to this firmware"
        assert bench.device.scanning

    @pytest.mark.parametrize("profile", [each for each in PROFILES.values() if each.name != "rplidar-old-firmware"])
    def test_mode_numbers_run_from_zero_without_a_hole(self, profile: Profile) -> None:
        """S-series interface manual: 0 to count - 1; the profiles that break the rule are named for it."""
        ids = [mode.id for mode in profile.modes]
        without_a_hole = ids == list(range(len(ids)))
        assert without_a_hole is (profile.name not in ("rplidar-holes", "rplidar-unknown-response"))

    @pytest.mark.parametrize(
        ("model", "mode", "us", "metres"),
        [
            ("rplidar-s1", 0, 244, 40),
            ("rplidar-s1", 1, 108, 40),
            ("rplidar-s2", 0, 62.5, 30),
            ("rplidar-s2", 1, 31.25, 30),
            ("rplidar-s3", 0, 62.5, 16),
            ("rplidar-s3", 1, 31.25, 40),
            ("rplidar-a1", 0, 508, 12),
            ("rplidar-a1", 1, 254, 12),
            ("rplidar-a1", 3, 127, 12),
            ("rplidar-a1", 4, 201, 12),
            ("rplidar-a2", 3, 62.5, 16),
            ("rplidar-a3", 3, 62.5, 25),
            ("rplidar-c1", 0, 200, 16),
            ("rplidar-c1", 1, 200, 40),
        ],
    )
    def test_what_logs_of_real_devices_say_of_their_modes(
        self, model: str, mode: int, us: float, metres: int
    ) -> None:
        bench = Bench(model)
        assert bench.ask(conf(0x71, mode))[11:] == struct.pack("<I", int(us * 256))
        assert bench.ask(conf(0x74, mode))[11:] == struct.pack("<I", metres * 256)

    @pytest.mark.parametrize(
        ("model", "firmware"),
        [
            *(("rplidar-s1", "1c 01"), ("rplidar-s2", "02 01"), ("rplidar-s3", "02 01"), ("rplidar-c1", "02 01")),
            *(("rplidar-a1", "1d 01"), ("rplidar-a2", "20 01"), ("rplidar-a3", "20 01")),
        ],
    )
    def test_firmware_of_devices_that_are_sold(self, model: str, firmware: str) -> None:
        assert Bench(model).ask(GET_INFO)[8:10] == bytes.fromhex(firmware)

    def test_awkward_devices(self) -> None:
        assert Bench("rplidar-zero-us").ask(conf(0x71, 1))[11:] == bytes(4)
        assert Bench("rplidar-unknown-response").ask(conf(0x75, 6))[11:] == b"\x8e"
        assert Bench("rplidar-no-modes").ask(conf(0x70))[11:] == bytes(2)
        assert Bench("rplidar-no-modes").ask(conf(0x7C))[11:] == b""
        assert Bench("rplidar-old-firmware").ask(conf(0x70), SECOND) == b""

    def test_an_answer_takes_the_device_a_moment_and_the_line_its_time(self, bench: Bench) -> None:
        bench.send(GET_INFO)
        assert bench.run(1_500_000) == b""
        assert len(bench.run(100_000)) == 10  # ten bits a byte at 1 Mbaud
        assert bench.device.wakeup(bench.now) == bench.now + 17 * 10_000
        assert len(bench.run(170_000)) == 17
        assert bench.device.wakeup(bench.now) is None

    def test_late(self, bench: Bench) -> None:
        bench.device.response_delay_s = 3.0
        assert bench.ask(GET_INFO, 3 * SECOND) == b""
        assert len(bench.run(MS)) == 27

    def test_garbled(self, bench: Bench) -> None:
        good = bench.ask(GET_HEALTH)
        bench.device.garble_responses = 1
        bad = bench.ask(GET_HEALTH)
        assert len(bad) == len(good)
        assert bad != good
        assert bench.ask(GET_HEALTH) == good

    def test_mute_hears_and_obeys_but_says_nothing(self, bench: Bench) -> None:
        bench.device.mute = True
        assert bench.ask(GET_HEALTH) == b""
        assert bench.ask(EXPRESS_1, SECOND) == b""
        assert bench.device.scanning
        bench.device.mute = False
        assert bench.run(100 * MS)


class TestDiscarding:
    @pytest.mark.parametrize("wait", [0, 5 * MS, 10 * MS - 1])
    def test_too_soon_after_stop(self, bench: Bench, wait: int) -> None:
        bench.send(STOP)
        bench.run(wait)
        assert bench.ask(GET_INFO) == b""
        assert not bench.device.log[-1].obeyed
        assert bench.why == "within 10 ms of stop"

    def test_ten_milliseconds_after_stop(self, bench: Bench) -> None:
        bench.send(STOP)
        bench.run(10 * MS)
        assert len(bench.ask(GET_INFO)) == 27

    def test_in_one_write_with_stop(self, bench: Bench) -> None:
        assert bench.ask(STOP + GET_INFO) == b""
        assert [(r.name, r.obeyed) for r in bench.device.log] == [("stop", True), ("get_info", False)]

    def test_its_first_byte_counts(self, bench: Bench) -> None:
        bench.send(STOP)
        bench.run(9 * MS)
        bench.send(GET_INFO[:1])
        bench.run(9 * MS)
        assert bench.ask(GET_INFO[1:]) == b""
        assert bench.why == "within 10 ms of stop"

    @pytest.mark.parametrize(
        ("model", "silence", "why"),
        [
            ("rplidar-s2", 600 * MS, "still booting after reset"),
            ("rplidar-s1", 2 * SECOND, "still booting after reset"),
        ],
    )
    def test_too_soon_after_reset(self, model: str, silence: int, why: str) -> None:
        bench = Bench(model)
        bench.send(RESET)
        bench.run(silence - 1)
        assert bench.ask(GET_INFO, 0) == b""
        assert bench.why == why
        bench.run(1)
        assert len(bench.ask(GET_INFO)) == 27

    def test_half_a_second_after_reset_however_fast_it_boots(self, bench: Bench) -> None:
        bench.device.boot_s = 0.0
        bench.send(RESET)
        bench.run(500 * MS - 1)
        assert bench.ask(GET_INFO, 0) == b""
        assert bench.why == "within 500 ms of reset"
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

    def test_complete_just_within_five_seconds(self, bench: Bench) -> None:
        bench.send(GET_INFO[:1])
        bench.run(5 * SECOND)
        assert len(bench.ask(GET_INFO[1:])) == 27

    def test_a_request_cut_short_swallows_the_next(self, bench: Bench) -> None:
        bench.send(EXPRESS_1[:4])
        assert bench.ask(GET_INFO) == b""
        assert bench.device.log == []

    def test_wrong_checksum(self, bench: Bench) -> None:
        assert bench.ask(EXPRESS_1[:-1] + b"\x22", SECOND) == b""
        assert bench.why == "wrong checksum"
        assert not bench.device.scanning

    @pytest.mark.parametrize("request_", [b"\xa5\x33", framed(0x99, b"xy"), b"\xa5\x90\x00\x35"])
    def test_unknown(self, bench: Bench, request_: bytes) -> None:
        assert bench.ask(request_, SECOND) == b""
        assert bench.device.log[-1].data == request_
        assert bench.why == "unknown to this device"

    def test_a_payload_of_the_wrong_length(self, bench: Bench) -> None:
        assert bench.ask(framed(0x82, b"\x01"), SECOND) == b""
        assert bench.why == "payload of 1 bytes"
        assert bench.ask(framed(0x84, b"\x70"), SECOND) == b""
        assert bench.why == "payload of 1 bytes"

    def test_noise_before_a_request(self, bench: Bench) -> None:
        assert len(bench.ask(b"\x00\x50\xa5" + GET_INFO)) == 27
        assert [r.name for r in bench.device.log] == ["get_info"]

    @pytest.mark.parametrize("request_", [GET_INFO, EXPRESS_1, conf(0x71, 1), MOTOR_600])
    def test_chunks_make_no_difference(self, request_: bytes) -> None:
        whole, pieces = Bench(), Bench()
        for byte in request_[:-1]:
            pieces.send(bytes([byte]))
        assert pieces.ask(request_[-1:]) == whole.ask(request_)
        assert pieces.device.log == whole.device.log
        assert whole.device.log[0].obeyed


class TestStream:
    @pytest.mark.parametrize(
        ("model", "request_", "descriptor"),
        [
            ("rplidar-s2", SCAN, "a55a0500004081"),
            ("rplidar-express", express(1), "a55a5400004082"),
            ("rplidar-hq", express(1), "a55a0d03004083"),
            ("rplidar-ultra", express(2), "a55a8400004084"),
            ("rplidar-s2", EXPRESS_1, "a55a5400004085"),
            ("rplidar-ultradense", express(1), "a55aaa00004086"),
            ("rplidar-holes", express(5), "a55a0d03004083"),
            ("rplidar-unknown-response", express(6), "a55a540000408e"),
            ("rplidar-old-firmware", express(0), "a55a5400004082"),
            ("rplidar-no-modes", SCAN, "a55a0500004081"),
            ("rplidar-s2", express(0), "a55a5400004082"),
        ],
    )
    def test_descriptor(self, model: str, request_: bytes, descriptor: str) -> None:
        bench = Bench(model)
        stream = bench.ask(request_, 300 * MS)
        assert stream[:7] == bytes.fromhex(descriptor)
        assert len(stream) > 1000

    def test_a_mode_the_device_lacks(self, bench: Bench) -> None:
        assert bench.ask(express(9), SECOND) == b""
        assert bench.why == "no scan mode 9"
        assert not bench.device.scanning

    @pytest.mark.exhaustive("how", sample=ONE_A_FORMAT, full=MODES)
    def test_what_is_decoded_is_what_there_is(self, how: tuple[str, int]) -> None:
        model, mode_id = how
        # A smooth world without noise: an angle wrong by 0.1° shows, as does every wrong bit of a distance.
        direction = np.radians((np.arange(32768) + 0.5) * (360.0 / 32768))
        scene = World(3000.0 + 1500.0 * np.sin(direction) + 400.0 * np.cos(3 * direction))
        bench = Bench(model, world=scene)
        mode = bench.device.profile.mode(mode_id)
        assert mode is not None
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
        mode = bench.device.profile.mode(mode_id)
        assert mode is not None
        for rpm in (600, 750):
            bench.send(framed(0xA8, struct.pack("<H", rpm)))
            bench.run(20 * MS)
            stream = bench.ask(begin(mode), 600 * MS)
            packets = packets_of(mode.format, stream[stream.index(b"\xa5\x5a") + 7 :])
            turns = rplidar.revolutions(rplidar.decode(mode.format, packets))
            assert len(turns) >= 3
            for turn in turns:
                assert len(turn) == pytest.approx(samples * 600 / rpm, abs=1.5)

    def test_standard_marks_the_first_sample_of_each_turn(self, bench: Bench) -> None:
        packets = packets_of(0x81, bench.ask(SCAN, SECOND)[7:])
        marked = [i for i, packet in enumerate(packets) if packet[0] & 1]
        np.testing.assert_allclose(np.diff(marked), 1600, atol=1)
        assert len(marked) >= 9
        for i in marked:
            before, at = rplidar.decode(0x81, packets[i - 1 : i + 1])
            assert before.angle_deg > 359.5
            assert at.angle_deg < 0.5

    @pytest.mark.parametrize(
        ("model", "mode_id"),
        [("rplidar-s2", 1), ("rplidar-express", 1), ("rplidar-ultra", 2), ("rplidar-ultradense", 1)],
    )
    def test_only_the_first_packet_of_a_stream_is_new(self, model: str, mode_id: int) -> None:
        bench = Bench(model)
        mode = bench.device.profile.mode(mode_id)
        assert mode is not None
        for _ in range(2):
            packets = packets_of(mode.format, bench.ask(express(mode_id), 400 * MS)[7:])
            new = [rplidar.is_reset(mode.format, packet) for packet in packets]
            assert new == [True] + [False] * (len(packets) - 1)
            bench.ask(STOP)

    def test_streams_begin_anywhere(self) -> None:
        starts = set()
        for seed in range(5):
            stream = Bench(seed=seed).ask(EXPRESS_1)
            starts.add(rplidar.start_q6(0x85, stream[7:91]))
        assert len(starts) == 5

    def test_the_steps_of_time_make_no_difference(self) -> None:
        world = make_world("room")
        streams = []
        for step in (0, 137_000, 13 * MS):
            bench = Bench(world=world, spin_up_s=0.3)
            bench.send(EXPRESS_1)
            streams.append(bench.run(SECOND, step=step))
        assert len(streams[0]) > 40_000
        assert streams[0] == streams[1]
        assert streams[0] == streams[2]

    def test_the_stream_leaves_at_the_samples_pace(self, bench: Bench) -> None:
        bench.send(EXPRESS_1)
        bench.run(1_500_000 + 70_000)  # the descriptor
        # A packet of 40 samples is made 1.25 ms after the first began, and needs 0.84 ms on the line.
        made = 100 * SECOND + 1_500_000 + 1_250_000
        assert bench.device.wakeup(bench.now) == made + 840_000
        assert bench.run(made - bench.now) == b""
        assert len(bench.run(840_000)) == 84
        assert len(bench.run(1_250_000 * 8)) == 84 * 8

    def test_beyond_its_reach_nothing_returns(self) -> None:
        bench = Bench("rplidar-s2", world=World(np.full(32768, 30_500.0)))  # it sees 30 m
        packets = packets_of(0x85, bench.ask(EXPRESS_1, 50 * MS)[7:])
        assert not any(sample.distance_mm for sample in rplidar.decode(0x85, packets))
        far = Bench("rplidar-s3", world=World(np.full(32768, 30_500.0)))  # it sees 40 m
        packets = packets_of(0x85, far.ask(EXPRESS_1, 50 * MS)[7:])
        assert {sample.distance_mm for sample in rplidar.decode(0x85, packets)} == {30_500.0}


class TestEndOfStream:
    def test_stop_lets_the_packet_under_way_leave_and_no_more(self, bench: Bench) -> None:
        stream = bench.ask(EXPRESS_1, 98 * MS)
        stream += bench.ask(STOP, SECOND)
        packets = packets_of(0x85, stream[7:])
        assert (len(stream) - 7) % 84 == 0
        assert len(packets) == (98 * MS - 1_500_000) // 1_250_000
        assert not bench.device.scanning
        assert bench.device.motor_on  # as the S series does
        assert bench.device.wakeup(bench.now) is None

    @pytest.mark.parametrize(
        ("request_", "answer"), [(GET_INFO, 27), (GET_HEALTH, 10), (conf(0x70), 13), (MOTOR_600, 0)]
    )
    def test_every_request_ends_it(self, bench: Bench, request_: bytes, answer: int) -> None:
        bench.ask(EXPRESS_1, 100 * MS)
        after = bench.ask(request_, SECOND)
        assert not bench.device.scanning
        assert bench.device.log[-1].obeyed
        assert len(after) % 84 < answer + 84
        assert (len(after) - answer) < 3 * 84
        assert bench.run(SECOND) == b""

    def test_even_one_that_asks_for_a_mode_it_lacks(self, bench: Bench) -> None:
        bench.ask(EXPRESS_1, 100 * MS)
        bench.ask(express(9))
        assert not bench.device.scanning

    @pytest.mark.parametrize("noise", [b"\x25", b"\xa5\x33", EXPRESS_1[:-1] + b"\x00"])
    def test_noise_does_not(self, bench: Bench, noise: bytes) -> None:
        bench.ask(EXPRESS_1, 100 * MS)
        bench.ask(noise)
        assert bench.device.scanning

    def test_a_second_scan_begins_a_new_stream(self, bench: Bench) -> None:
        bench.ask(EXPRESS_1, 100 * MS)
        after = bench.ask(SCAN, 100 * MS)
        assert bytes.fromhex("a55a0500004081") in after[: 3 * 84]

    def test_reset_ends_it_in_the_middle_of_a_packet(self, bench: Bench) -> None:
        bench.send(EXPRESS_1)
        out = bench.run(1_500_000 + 1_250_000 * 5 + 400_000)  # 40 bytes into the fifth packet
        assert (len(out) - 7) % 84 == 40
        bench.send(RESET)
        assert bench.run(5 * SECOND) == b""
        assert not bench.device.scanning
        assert not bench.device.motor_on

    def test_the_old_firmware_prints_a_banner_when_it_has_booted(self) -> None:
        bench = Bench("rplidar-old-firmware")
        bench.send(RESET)
        assert bench.run(600 * MS) == b""
        banner = bench.run(100 * MS)
        assert 56 <= len(banner) <= 63
        assert banner.isascii()


class TestMotor:
    def test_off_until_it_is_needed(self, bench: Bench) -> None:
        bench.ask(GET_INFO)
        assert not bench.device.motor_on
        bench.send(SCAN)
        assert bench.device.motor_rpm == 600

    @pytest.mark.parametrize(("rpm", "actual"), [(600, 600), (480, 480), (300, 480), (2000, 1200)])
    def test_speed_is_clamped_to_what_it_can_do(self, bench: Bench, rpm: int, actual: int) -> None:
        bench.send(framed(0xA8, struct.pack("<H", rpm)))
        assert bench.device.motor_rpm == actual

    def test_the_documented_requests(self, bench: Bench) -> None:
        bench.send(MOTOR_600)
        assert bench.device.motor_rpm == 600
        bench.send(MOTOR_OFF)
        assert not bench.device.motor_on
        assert all(request.obeyed for request in bench.device.log)

    def test_off_ends_the_stream(self, bench: Bench) -> None:
        bench.ask(EXPRESS_1, 100 * MS)
        bench.ask(MOTOR_OFF)
        assert not bench.device.scanning
        assert not bench.device.motor_on

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

    def test_there_is_no_packet_before_the_duty_was_set(self) -> None:
        bench = Bench("rplidar-a2")
        assert len(bench.ask(express(3), 5 * SECOND)) == 7
        states = [bench.device.scanning]
        bench.ask(STOP)
        assert [*states, bench.device.scanning] == [True, False]
        bench.send(DUTY_660)
        assert bench.device.motor_rpm == 600
        assert len(bench.ask(express(3), SECOND)) > 20_000

    def test_it_obeys_no_other_motor_request(self) -> None:
        bench = Bench("rplidar-a2")
        bench.send(MOTOR_600)
        assert bench.why == "unknown to this device"
        assert not bench.device.motor_on

    @pytest.mark.parametrize(("duty", "rpm"), [(0, 0), (330, 300), (2000, 600 * 1023 / 660)])
    def test_the_speed_follows_from_the_duty(self, duty: int, rpm: float) -> None:
        bench = Bench("rplidar-a2")
        bench.send(framed(0xF0, struct.pack("<H", duty)))
        assert bench.device.motor_rpm == pytest.approx(rpm)

    def test_a_restart_forgets_the_duty(self) -> None:
        bench = Bench("rplidar-a3")
        bench.send(DUTY_660)
        bench.send(RESET)
        assert not bench.device.motor_on


class TestControlLine:
    """A1: DTR is the switch of the motor."""

    def test_it_turns_while_dtr_is_cleared(self) -> None:
        bench = Bench("rplidar-a1")
        assert bench.device.motor_on
        bench.device.set_dtr(False, bench.now)
        assert bench.device.motor_on
        bench.device.set_dtr(True, bench.now)
        assert not bench.device.motor_on

    def test_a_stream_pauses_while_it_is_asserted(self) -> None:
        bench = Bench("rplidar-a1")
        bench.ask(express(3), SECOND)
        bench.device.set_dtr(True, bench.now)
        bench.run(50 * MS)
        assert bench.run(SECOND) == b""
        assert bench.device.scanning
        bench.device.set_dtr(False, bench.now)
        assert len(bench.run(SECOND)) > 9_000

    def test_it_outlasts_a_reset(self) -> None:
        bench = Bench("rplidar-a1")
        bench.device.set_dtr(True, bench.now)
        bench.ask(RESET, 2 * SECOND)
        assert not bench.device.motor_on

    def test_to_the_others_it_means_nothing(self) -> None:
        bench = Bench("rplidar-s2")
        bench.ask(EXPRESS_1, 100 * MS)
        bench.device.set_dtr(True, bench.now)
        assert bench.device.motor_on
        assert len(bench.run(100 * MS)) > 5_000


class TestRarerRequests:
    def test_hq_scan(self) -> None:
        request = framed(0x83, bytes(33))
        assert Bench("rplidar-hq").ask(request)[:7] == bytes.fromhex("a55a0d03004083")
        assert Bench("rplidar-s2").ask(request) == b""

    def test_a_new_address_is_in_force_after_a_reset(self) -> None:
        bench = Bench("rplidar-s2e")
        ask = bytes.fromhex("a58406c0cc010000002a")
        assert bench.ask(ask)[11:] == bytes(12)
        address = bytes([192, 168, 11, 3, 255, 255, 255, 0, 192, 168, 11, 1])
        told = bench.ask(framed(0x85, struct.pack("<I", 0x1CCC0) + address))
        assert told == bytes.fromhex("a55a0800000021 c0cc0100 00000000")
        assert bench.ask(ask)[11:] == bytes(12)
        bench.ask(RESET, SECOND)
        assert bench.ask(ask)[11:] == address

    def test_only_a_network_device_has_one(self) -> None:
        bench = Bench("rplidar-s2")
        assert bench.ask(bytes.fromhex("a58406c0cc010000002a")) == b""
        assert bench.ask(framed(0x85, struct.pack("<I", 0x1CCC0) + bytes(12))) == b""
        assert Bench("rplidar-s2e").ask(conf(0x79))[11:] == PROFILES["rplidar-s2e"].mac


class TestProtectionStop:
    def test_the_stream_ceases_and_scans_are_refused(self, bench: Bench) -> None:
        bench.ask(EXPRESS_1, 100 * MS)
        bench.device.protection_stop(0x8001)
        bench.run(20 * MS)
        assert bench.run(SECOND) == b""
        assert not bench.device.motor_on
        assert bench.ask(GET_HEALTH)[7:] == b"\x02\x01\x80"
        for request in (SCAN, FORCE_SCAN, EXPRESS_1):
            assert bench.ask(request, SECOND) == b""
            assert bench.why == "in protection stop"

    def test_stop_is_ignored(self, bench: Bench) -> None:
        bench.device.protection_stop(7)
        bench.send(STOP)
        assert bench.why == "in protection stop"
        # So no pause follows it.
        assert bench.ask(GET_HEALTH)[7:] == b"\x02\x07\x00"

    def test_reset_cures_it(self, bench: Bench) -> None:
        bench.device.protection_stop(7)
        bench.ask(RESET, SECOND)
        assert bench.ask(GET_HEALTH)[7:] == bytes(3)
        assert len(bench.ask(EXPRESS_1, 100 * MS)) > 1000

    def test_or_does_not(self, bench: Bench) -> None:
        bench.device.faults_cleared_by_reset = False
        bench.device.protection_stop(7)
        bench.ask(RESET, SECOND)
        assert bench.ask(GET_HEALTH)[7:] == b"\x02\x07\x00"


class TestLeftOvers:
    @pytest.mark.parametrize(("model", "mode_id"), MODES)
    def test_it_is_found_streaming_in_the_middle_of_a_packet(self, model: str, mode_id: int) -> None:
        bench = Bench(model)
        mode = bench.device.profile.mode(mode_id)
        assert mode is not None
        bench.device.begin_streaming(mode_id, bench.now)
        assert bench.device.scanning
        assert bench.device.motor_on
        size = mode.packet[0]
        stream = bench.run(20 * mode.period_ns + mode.period_ns // 2)
        cut = size - size * 2 // 5
        packets = packets_of(mode.format, stream[cut:])
        assert len(packets) >= 19
        if mode.format in rplidar.CAPSULE_TYPES:
            assert not any(rplidar.is_reset(mode.format, packet) for packet in packets)

    def test_a_mode_it_lacks(self, bench: Bench) -> None:
        with pytest.raises(ValueError, match="no scan mode 9"):
            bench.device.begin_streaming(9, 0)


def test_every_profile_has_an_honest_name_and_a_line_that_can_carry_it() -> None:
    for name, profile in PROFILES.items():
        assert profile.name == name
        assert profile.listed is False or profile.mode(profile.typical) is not None
        for mode in profile.modes:
            size, samples = mode.packet
            assert size * 10 / profile.baudrate < samples * mode.us_q8 / 256e6


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
    with pytest.raises(ValueError, match=r"'rplidar-s9'.*rplidar-s2.*rplidar-old-firmware"):
        make_simulated("rplidar-s9")


def test_a_serial_number_has_sixteen_bytes() -> None:
    with pytest.raises(ValueError, match="16 bytes"):
        SimulatedRplidar(PROFILES["rplidar-s2"], serial=b"short")
