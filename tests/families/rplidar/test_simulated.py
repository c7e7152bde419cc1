"""The simulated device, in driven time: what it discards and responds, and the states in which it can be found."""

import struct

import pytest

from lidario.families.rplidar.simulated.device import PROFILES, Profile, make_simulated
from tests.support import simulated_rplidar as say
from tests.support.simulated_rplidar import MS, SECOND, Bench, conf, express, framed

pytestmark = pytest.mark.discards("what the simulated device discards is tested here")


@pytest.mark.parametrize("second", [say.GET_HEALTH, say.STOP, say.RESET, say.SCAN])
@pytest.mark.parametrize(
    ("first", "name"),
    [
        (say.GET_INFO, "get_info"),
        (conf(0x7F, 1), "get_lidar_conf"),
        (say.SCAN, "scan"),
        (express(1), "express_scan"),
    ],
)
def test_a_request_before_the_response_has_left_is_discarded(
    bench: Bench, first: bytes, name: str, second: bytes
) -> None:
    """While a request is unanswered, further ones are discarded, and nothing tells the host (manual)."""
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
    bench.send(say.SCAN)
    bench.run(50 * MS)
    assert bench.device.scanning


class TestDiscarding:
    @pytest.mark.parametrize(("wait", "heard"), [(0, False), (10 * MS - 1, False), (10 * MS, True)])
    def test_too_soon_after_stop(self, bench: Bench, wait: int, heard: bool) -> None:
        begin_to_scan(bench)
        bench.send(say.STOP)
        bench.run(wait)
        assert len(bench.ask(say.GET_INFO)) == (27 if heard else 0)
        assert bench.device.log[-1].obeyed is heard
        assert bench.why == ("" if heard else "within 10 ms of stop")

    @pytest.mark.parametrize(("wait", "remark"), [(5, "within 10 ms of a stop that was ignored"), (10, "")])
    def test_a_stop_in_idle_is_ignored(self, bench: Bench, wait: int, remark: str) -> None:
        bench.send(say.STOP)
        bench.run(wait * MS)
        assert len(bench.ask(say.GET_INFO)) == 27
        assert bench.device.log[-1].remark == remark

    def test_its_first_byte_counts(self, bench: Bench) -> None:
        begin_to_scan(bench)
        bench.send(say.STOP)
        bench.run(9 * MS)
        bench.send(say.GET_INFO[:1])
        bench.run(9 * MS)
        assert bench.ask(say.GET_INFO[1:]) == b""
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
        bench.send(say.RESET)
        bench.run(silence - 1)
        assert bench.ask(say.GET_INFO, 0) == b""
        assert bench.why == why
        bench.run(1)
        assert len(bench.ask(say.GET_INFO)) == 27

    def test_incomplete_after_five_seconds(self, bench: Bench) -> None:
        bench.send(say.EXPRESS_1[:4])
        bench.run(5 * SECOND)
        assert bench.device.log == []
        bench.run(1)
        assert bench.device.log[0].data == say.EXPRESS_1[:4]
        assert bench.device.log[0].name == "express_scan"
        assert bench.why == "not complete within 5 s"
        assert bench.device.log[0].at_ns == 100 * SECOND
        assert len(bench.ask(say.GET_INFO)) == 27

    @pytest.mark.parametrize(
        ("request_", "why"),
        [
            (say.EXPRESS_1[:-1] + b"\x22", "wrong checksum"),
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

    @pytest.mark.parametrize("request_", [say.GET_INFO, say.EXPRESS_1, conf(0x71, 1), say.MOTOR_600])
    def test_chunks_make_no_difference(self, request_: bytes) -> None:
        whole, pieces = Bench(), Bench()
        for byte in request_[:-1]:
            pieces.send(bytes([byte]))
        assert pieces.ask(request_[-1:]) == whole.ask(request_)
        assert pieces.device.log == whole.device.log
        assert whole.device.log[0].obeyed


def test_in_protection_stop_scans_are_refused_and_stop_is_ignored(bench: Bench) -> None:
    bench.device.protection_stop(7)
    for request in (say.SCAN, say.FORCE_SCAN, say.EXPRESS_1):
        assert bench.ask(request, SECOND) == b""
        assert bench.why == "in protection stop"
    bench.send(say.STOP)
    assert bench.why == "in protection stop"
    # So no pause follows it.
    assert bench.ask(say.GET_HEALTH)[7:] == b"\x02\x07\x00"


def test_an_overloaded_line_is_refused() -> None:
    s2 = PROFILES["rplidar-s2"]
    with pytest.raises(ValueError, match="cannot carry"):
        type(s2)("too-slow", 0x71, 115_200, s2.modes, typical=1)


def test_an_unknown_model_names_those_there_are() -> None:
    with pytest.raises(ValueError, match=r"no simulated device .*'rplidar-s9'.*rplidar-s2.*rplidar-old-firmware"):
        make_simulated("rplidar-s9")


SPEEDS = {0x01: "5802 0000", 0x04: "e001", 0x05: "b004"}
CONF = [
    *(("rplidar-s2", 0x70, (), b"\2\0"), ("rplidar-s2", 0x7C, (), b"\1\0")),
    *(("rplidar-s2", 0x75, (0,), b"\x81"), ("rplidar-s2", 0x75, (1,), b"\x85")),
    *(("rplidar-s2", 0x7F, (0,), b"Standard\0"), ("rplidar-s2", 0x7F, (1,), b"DenseBoost\0")),
    # No such mode, and none given.
    *(("rplidar-s2", 0x71, (7,), b""), ("rplidar-s2", 0x71, (), b"")),
    # The speeds of those that are sold: the typical one, the lowest and the highest.
    *((model, kind, (), bytes.fromhex(SPEEDS[kind])) for model in say.SOLD if model[8] in "st" for kind in SPEEDS),
    *(("rplidar-c1", kind, (), bytes.fromhex(text)) for kind, text in (SPEEDS | {0x05: "d002"}).items()),
    *((model, 0x01, (), bytes.fromhex("5802 9402")) for model in ("rplidar-a1", "rplidar-a2", "rplidar-a3")),
    # What logs of real devices say of their modes: microseconds a sample, and metres.
    *(
        (model, kind, (mode,), struct.pack("<I", int(figure * 256)))
        for model, mode, us, metres in [
            ("rplidar-s1", 0, 244, 40), ("rplidar-s1", 1, 108, 40), ("rplidar-s2", 0, 62.5, 30),
            ("rplidar-s2", 1, 31.25, 30), ("rplidar-s3", 0, 62.5, 16), ("rplidar-s3", 1, 31.25, 40),
            ("rplidar-a1", 0, 508, 12), ("rplidar-a1", 1, 254, 12), ("rplidar-a1", 3, 127, 12),
            ("rplidar-a1", 4, 201, 12), ("rplidar-a2", 0, 252, 16), ("rplidar-a2", 1, 126, 16),
            ("rplidar-a2", 3, 63, 16), ("rplidar-a2", 4, 100, 16), ("rplidar-a3", 3, 63, 25),
            ("rplidar-c1", 0, 200, 16), ("rplidar-c1", 1, 200, 40),
        ]
        for kind, figure in ((0x71, us), (0x74, metres))
    ),
    # Awkward devices.
    *(("rplidar-zero-us", 0x71, (1,), bytes(4)), ("rplidar-unknown-response", 0x75, (6,), b"\x8e")),
    *(("rplidar-no-modes", 0x70, (), bytes(2)), ("rplidar-no-modes", 0x7C, (), b"")),
]  # fmt: skip
"""Configuration values: model, which one, of which mode if of one, and the value."""


class TestAnswers:
    @pytest.mark.parametrize(
        ("model", "major", "firmware"),
        [
            *(("rplidar-s1", 6, "1c 01"), ("rplidar-s2", 7, "02 01"), ("rplidar-s3", 8, "02 01")),
            *(("rplidar-a1", 1, "1d 01"), ("rplidar-a2", 2, "20 01"), ("rplidar-a3", 3, "20 01")),
            *(("rplidar-c1", 4, "02 01"), ("rplidar-t1", 9, None), ("rplidar-old-firmware", 1, None)),
        ],
    )
    def test_model_and_firmware_of_devices_that_are_sold(
        self, model: str, major: int, firmware: str | None
    ) -> None:
        info = Bench(model).ask(say.GET_INFO)
        assert info[7] >> 4 == major
        assert firmware is None or info[8:10] == bytes.fromhex(firmware)

    @pytest.mark.parametrize(("model", "kind", "mode", "value"), CONF)
    def test_conf(self, model: str, kind: int, mode: tuple[int, ...], value: bytes) -> None:
        """The vendor's driver takes a response without a value for one with a value, and crashes."""
        answer = Bench(model).ask(conf(kind, *mode))
        assert answer == b"\xa5\x5a" + struct.pack("<IBI", 4 + len(value), 0x20, kind) + value

    @pytest.mark.parametrize(
        ("model", "kind"), [("rplidar-s2", 0x79), ("rplidar-s1", 0x81), ("rplidar-holes", 0x01)]
    )
    def test_a_conf_type_that_the_firmware_does_not_know(self, model: str, kind: int) -> None:
        """Silence: the vendor's driver takes any response to 0x79 for the sign of an Ethernet device."""
        bench = Bench(model)
        bench.ask(say.SCAN, 100 * MS)
        assert bytes.fromhex("0000 0020") not in bench.ask(conf(kind))
        assert bench.why == "unknown to this firmware"
        assert bench.device.scanning

    @pytest.mark.parametrize("profile", [each for each in PROFILES.values() if each.name != "rplidar-old-firmware"])
    def test_mode_numbers_run_from_zero_without_a_hole(self, profile: Profile) -> None:
        """S-series interface manual: 0 to count - 1; the profiles that break the rule are named for it."""
        ids = [mode.id for mode in profile.modes]
        without_a_hole = ids == list(range(len(ids)))
        assert without_a_hole is (profile.name not in ("rplidar-holes", "rplidar-unknown-response"))

    def test_old_firmware_tells_none(self) -> None:
        assert Bench("rplidar-old-firmware").ask(conf(0x70), SECOND) == b""

    def test_an_answer_takes_the_device_a_moment_and_the_line_its_time(self, bench: Bench) -> None:
        bench.send(say.GET_INFO)
        assert bench.run(1_500_000) == b""
        assert len(bench.run(100_000)) == 10  # ten bits a byte at 1 Mbaud
        assert bench.device.wakeup(bench.now) == bench.now + 17 * 10_000
        assert len(bench.run(170_000)) == 17
        assert bench.device.wakeup(bench.now) is None


def test_hq_scan() -> None:
    request = framed(0x83, bytes(33))
    assert Bench("rplidar-hq").ask(request)[:7] == bytes.fromhex("a55a0d03004083")
    assert Bench("rplidar-s2").ask(request) == b""
