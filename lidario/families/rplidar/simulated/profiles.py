"""Which devices can be simulated: those that are sold, one for each other format, and awkward ones.

**Sold**: A1, A2, A3, C1, S1, S2, S2L, S3, and by UDP S2E and T1. Where sources differ, the log of a real device
counts. The sources of the figures:

==============  =======================================================================================
model byte      logs: A1M8 0x18, A2M12 0x2C, C1M1 0x41, S1M1 0x61, S2M1 0x71, S3M1 0x81; A3M1 0x31 and T1M1 0x91
                follow from the naming rule of the vendor's SDK 2.1.0; no source has those of S2L and S2E,
                which are given the S2's
firmware        the same logs: A1 1.29 hardware 7, A2 and A3 1.32 hardware 6, S1 1.28, C1, S2 and S3 1.02,
                these of hardware 18
baud rate       launch files of the vendor's ROS driver
A1 modes        logs of three devices (issue 2 of rplidar.net, thijses/rplidar, cpane/heron): all five modes, their
                times and 12 m
A2, A3 modes    an A2M12 (dark-sorceror/hack-the-north-2026): all five modes, their times and 16 m. An A3M1 (issue
                84 of robopeak/rplidar_ros): the same rates, rounded, and 25 m
C1 modes        logs: 5000 samples a second, 16 m in Standard and 40 m in DenseBoost. 0x81 and 0x85: programs that
                read a C1. Nothing tells which mode is typical (assumed: DenseBoost)
S1 modes        the log of one device: 244 µs and 108 µs a sample, 40 m in both modes. The S-series
                interface manual, figure 3-3, prints 4600 and 9200 samples a second, and 16 m for Standard
S2 modes        rates: figure 3-3 and logs agree. Distances: a log, 30 m in both modes; figure 3-3 prints
                16 m for Standard. S2L: users run it as an S2. S2E and T1: assumed to have the S2's
S3 modes        rates and distances: rplidar_ros issue 150; figure 3-3 does not have the S3. No source has the
                response type of its DenseBoost; 0x85 is assumed
typical mode    logs: DenseBoost on the S series, Sensitivity on A1, A2 and A3
motor           SDK 2.1.0 (`checkMotorCtrlSupport`): A1 by DTR, A2 and A3 by an accessory board, S and T by
                MOTOR_SPEED_CTRL. The C1 is not decided there; one user's patch sends MOTOR_SPEED_CTRL with success
speeds          S2: a user's report of conf 0x01, 0x04 and 0x05; S1 and S3 are assumed to tell the same. C1: 8 to
                12 Hz by its data sheet. A1: 7.14 Hz in a user's report; the motor is not regulated. 660 is the
                usual duty of an accessory board
boot time       S1: users report 2 s. A1: 0.67 s (cpane/heron). The others: the manual's 500 ms and a little more
banner          A1 of firmware 1.29, A2M8 of 1.27, A2M12: as users read them; the others: by their example
==============  =======================================================================================

**Formats**: `rplidar-express`, `-hq`, `-ultra` and `-ultradense` stand for no product; each sends one more format.

**Awkward**: modes whose numbers have holes and that come without conf 0x01; 0 µs a sample (rplidar_ros issue 155);
twice the true µs a sample; another format in conf 0x75 than in the descriptor;
a response type that no host knows; an empty list of modes, on an S2 and on an A2M6 (rplidar_ros issue 168); an A2
without an accessory board, at whose motor the host has no hand; a C1 that tells and takes no speed; firmware older
than 1.24, which has no GET_LIDAR_CONF.
"""

from dataclasses import replace
from functools import partial
from typing import Any

from lidario.families.rplidar.simulated.profile import Mode, Profile
from lidario.sim.chassis import by_name


def _q8(value: float) -> int:
    return round(value * 256)


def _mode(mode_id: int, name: str, response_type: int, samples_per_s: float, metres: float, **more: int) -> Mode:
    return Mode(mode_id, name, response_type, _q8(1e6 / samples_per_s), _q8(metres), **more)


_standard = partial(_mode, 0, "Standard", 0x81)
_express = partial(_mode, 1, "Express", 0x82)
_dense = partial(_mode, 1, "DenseBoost", 0x85)


def _device(name: str, model: int, baudrate: int, *modes: Mode, **more: Any) -> Profile:
    """A device whose last mode is the typical one, unless said otherwise."""
    return Profile(name, model, baudrate, modes, **{"typical": modes[-1].id, **more})


def _s_series(name: str, model: int, standard_m: float, dense_m: float) -> Profile:
    return _device(name, model, 1_000_000, _standard(16000, standard_m), _dense(32000, dense_m), firmware=(1, 2))


_A1_RPM = 428.0
_ETHERNET = 100_000_000  # bits a second: bytes leave at once


def _five_modes(metres: float, *times_us: float) -> tuple[Mode, ...]:
    """By the time of a sample in Standard, Express, Boost and Sensitivity, and Stability."""
    standard, express, boost, stability = (1e6 / each for each in times_us)
    return (
        _standard(standard, metres), _express(express, metres), _mode(2, "Boost", 0x84, boost, metres),
        _mode(3, "Sensitivity", 0x84, boost, metres), _mode(4, "Stability", 0x84, stability, metres),
    )  # fmt: skip


def _banner(firmware: str, hardware: int, model: int) -> bytes:
    return f"RP LIDAR System.\r\nFirmware Ver {firmware}, HW Ver {hardware}\r\nModel: {model:x}\r\n".encode()


def _a_series(name: str, model: int, metres: float) -> Profile:
    return _device(
        name, model, 256_000, *_five_modes(metres, 252, 126, 63, 100), typical=3, firmware=(1, 32), hardware=6,
        speed_conf=(600,), motor="pwm", pwm_ref=660, banner=_banner("1.32 - rtm", 6, model),
    )  # fmt: skip


def _ethernet(name: str, model: int, mac: str) -> Profile:
    return replace(_s_series(name, model, 30, 30), baudrate=_ETHERNET, mac=bytes.fromhex(mac))


_A1 = _device(
    "rplidar-a1", 0x18, 115_200, *_five_modes(12, 508, 254, 127, 201), typical=3, hardware=7, speed_conf=(600,),
    pwm_ref=660, motor="dtr", own_rpm=_A1_RPM, boot_s=0.67, banner=_banner("1.29 - rtm", 7, 0x18),
    follows="an A1M8",
)  # fmt: skip
_C1 = _device(
    "rplidar-c1", 0x41, 460_800, _standard(5000, 16), _dense(5000, 40), firmware=(1, 2), speed_conf=(600, 480, 720)
)
_A2 = _a_series("rplidar-a2", 0x2C, 16)

SOLD = (
    _s_series("rplidar-s2", 0x71, 30, 30),
    _device("rplidar-s1", 0x61, 256_000, _standard(1e6 / 244, 40), _dense(1e6 / 108, 40), firmware=(1, 28),
            boot_s=2.0),
    _s_series("rplidar-s3", 0x81, 16, 40),
    _A1,
    _A2,
    _a_series("rplidar-a3", 0x31, 25),
    _C1,
    _s_series("rplidar-s2l", 0x71, 30, 30),
    _ethernet("rplidar-s2e", 0x71, "02 00 00 00 52 E0"),
    _ethernet("rplidar-t1", 0x91, "02 00 00 00 71 00"),
)  # fmt: skip

_FORMATS = (
    _device("rplidar-express", 0x62, 256_000, _standard(4000, 16), _express(8000, 16)),
    _device("rplidar-hq", 0x72, 1_000_000, _standard(8000, 30), _mode(1, "HQ", 0x83, 10000, 30), hq_scan=True),
    _device("rplidar-ultra", 0x63, 256_000, _standard(4000, 25), _express(8000, 16),
            _mode(2, "Boost", 0x84, 16000, 25)),
    _device("rplidar-ultradense", 0x82, 1_000_000, _standard(16000, 40), _mode(1, "UltraDense", 0x86, 32000, 40)),
)  # fmt: skip

_AWKWARD = (
    _device("rplidar-holes", 0x72, 1_000_000, _mode(0, f"Standard {'with a long name ' * 5}", 0x81, 8000, 30),
            _mode(40, "HQ", 0x83, 10000, 30), speed_conf=(), oddity="mode numbers with holes, and a long name"),
    _device("rplidar-zero-us", 0x81, 1_000_000, _standard(16000, 40, reported_us_q8=0),
            _dense(32000, 40, reported_us_q8=0), oddity="says 0 µs a sample"),
    _device("rplidar-wrong-us", 0x71, 1_000_000, _standard(16000, 30, reported_us_q8=_q8(125)),
            _dense(32000, 30, reported_us_q8=_q8(62.5)), oddity="tells twice its µs a sample"),
    _device("rplidar-other-format", 0x71, 1_000_000, _standard(16000, 30),
            _dense(32000, 30, reported_type=0x84, reported_us_q8=_q8(62.5)), oddity="foretells another format"),
    _device("rplidar-unknown-response", 0x83, 1_000_000, _standard(16000, 40),
            _mode(6, "Mystery", 0x8E, 32000, 40, layout=0x85), oddity="a format unknown to hosts"),
    _device("rplidar-no-modes", 0x71, 1_000_000, _standard(16000, 30), listed=False, oddity="lists no modes"),
    replace(_A2, name="rplidar-a2-empty-list", model=0x26, baudrate=115_200,
            modes=(_standard(2000, 8), _express(4000, 8)), typical=1, firmware=(1, 27), hardware=5, listed=False,
            banner=_banner("1.27 - rc9", 5, 0x26), oddity="lists no modes"),
    replace(_A2, name="rplidar-a2-no-board", motor="fixed", oddity="no accessory board"),
    replace(_C1, name="rplidar-c1-fixed", motor="fixed", speed_conf=(), oddity="takes no speed"),
    replace(_A1, name="rplidar-old-firmware",
            modes=(_mode(0, "Express", 0x82, 4000, 12), _mode(0xFF, "Standard", 0x81, 2000, 12)), typical=0,
            firmware=(1, 20), hardware=5, has_conf=False, speed_conf=(), banner=_banner("1.20 - rtm", 5, 0x18),
            oddity="lists no modes", follows=""),
)  # fmt: skip

PROFILES: dict[str, Profile] = by_name(*SOLD, *_FORMATS, *_AWKWARD)
"""By name; the first one is what is simulated where no model is asked for."""
